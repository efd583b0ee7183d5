"""Opponents that do not evolve: the champions of a finished run, or trees that somebody typed, as teams to be met.

``evaluation.against`` names a run, and ``with_opponents`` puts its champions there. So they stand in ``config.toml`` of
the run that meets them, which needs the other folder no more, and can be repeated from its settings alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from coevo.config import EvolutionSettings
from coevo.errors import InputError
from coevo.game import Game
from coevo.run import open_run
from coevo.tree import Tree, parse, tree_codes

__all__ = ["check_opponents", "frozen_codes", "with_opponents"]

_S = TypeVar("_S", bound=EvolutionSettings)
_KEY = "evaluation.against"


def with_opponents(settings: _S) -> _S:
    """Return settings in which the opponents that do not evolve are trees: the last champions of the run they name.

    Raises:
        InputError: there is no such run, it is not finished, or lacks a robot that evolves here.
    """
    named = settings.evaluation.against
    if not isinstance(named, str) or not named:
        return settings
    try:
        run = open_run(Path(named))
    except InputError as error:
        raise InputError(f"{_KEY}: expected the folder of a finished run; {error}") from None
    if not run.is_finished:
        raise InputError(f"{_KEY}: {named} is not finished; bring it to its end with 'coevo resume {named}'")
    found = {robot: str(run.champion_tree(robot, run.finished - 1)) for robot in run.evolving.values()}
    evaluation = msgspec.structs.replace(settings.evaluation, against=found)
    return msgspec.structs.replace(settings, evaluation=evaluation)


def check_opponents(settings: EvolutionSettings, game: Game) -> None:
    """Refuse opponents that cannot be met in a game.

    Raises:
        InputError: says what was expected.
    """
    _trees(settings, game)


def frozen_codes(settings: EvolutionSettings, game: Game) -> dict[int, NDArray[np.uint8]]:
    """Return the opponents that do not evolve as node codes, by the number of the role; nothing if there are none.

    Raises:
        InputError: as of ``check_opponents``.
    """
    return {role: tree_codes(tree, game.function_set(role)) for role, tree in _trees(settings, game).items()}


def _trees(settings: EvolutionSettings, game: Game) -> dict[int, Tree]:
    against = settings.evaluation.against
    if not against:
        return {}
    if isinstance(against, str):
        raise InputError(
            f"{_KEY} names the run {against}, whose champions have to be put there first: use"
            " coevo.evolution.opponents.with_opponents(settings)"
        )
    evolving = {role.name: number for number, role in enumerate(game.roles) if role.evolves}
    if len({game.roles[number].team for number in evolving.values()}) < 2:
        raise InputError(f"{_KEY}: expected a game in which two teams evolve, but only {', '.join(evolving)} do")
    if set(against) != set(evolving):
        got = ", ".join(against)
        raise InputError(
            f"{_KEY}: expected a tree for each robot that evolves ({', '.join(evolving)}), got trees for {got}"
        )
    found = {}
    for name, number in evolving.items():
        try:
            found[number] = parse(against[name], game.function_set(number))
        except InputError as error:
            raise InputError(f"{_KEY}.{name}: {str(error).removeprefix('tree: ')}") from None
    return found
