"""From settings to the game that they are about: the one place that knows which games there are."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias

from coevo.config import EvolutionSettings, ForeignSettings, GPSettings, RunSettings
from coevo.errors import InputError, nearest_name
from coevo.game.arena import warm_up
from coevo.game.contract import Game, check_game
from coevo.game.soccer import SoccerGame
from coevo.kept import with_kept_skills
from coevo.plugins import load_callable, own_failure
from coevo.tree import Tree, parse

__all__ = [
    "Creation",
    "DecisionTable",
    "check_playable",
    "creations",
    "make_game",
    "own_references",
    "prepare",
]

DecisionTable: TypeAlias = tuple[tuple[str, ...], ...]  # lists of questions, asked one after the other
_MOST_LEAVES = 1024


class Creation(NamedTuple):
    """What the first population of a role is made of.

    start: given trees, which take the first places.
    table: the questions of the decision tables that new trees are; without them they are drawn as a whole.
    """

    start: Sequence[Tree] = ()
    table: DecisionTable = ()


def make_game(settings: EvolutionSettings, folders: Sequence[Path] = ()) -> Game:
    """Return the game of an experiment.

    Args:
        settings: the experiment.
        folders: where a game of one's own is looked for, before what is installed; the first may be that of a run,
            whose skills are then those that it has kept.

    Raises:
        InputError: there is no such game, or it breaks the contract.

    Example:
        >>> from coevo.game import make_game
        >>> from coevo.recipes import read_experiment
        >>> game = make_game(read_experiment("three-learners"))
        >>> [(role.name, role.team) for role in game.roles]
        [('r0', 0), ('r1', 0), ('r2', 1)]
        >>> len(game.function_set(0).functions)
        35
    """
    if isinstance(settings, RunSettings):
        return SoccerGame(with_kept_skills(settings, folders))
    assert isinstance(settings, ForeignSettings)
    reference = str(settings.game["kind"])
    factory = load_callable(reference, "game.kind", folders)
    try:
        game: Game = factory({key: value for key, value in settings.game.items() if key != "kind"})
        check_game(game, f"the game {reference}")
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever its author did
        raise own_failure(f"making the game {reference}", error) from None
    return game


def check_playable(settings: EvolutionSettings, folders: Sequence[Path] = ()) -> Game:
    """Make the game of an experiment with all that it needs to be played, so that what is wrong is told beforehand.

    Raises:
        InputError: as of ``make_game``; or a skill, a condition or a given tree cannot be used.
    """
    game = make_game(settings, folders)
    creations(settings.gp, game)
    if isinstance(game, SoccerGame):
        assert game.arena.bank
    return game


def creations(settings: GPSettings, game: Game) -> dict[int, Creation]:
    """Return what the first populations are made of, by the number of the role that evolves.

    Raises:
        InputError: there is no such role, it does not evolve, a given tree is none of its trees, it cannot ask one of
            the questions of its table or asks it twice in a list, or a table has more than 1,024 leaves or is deeper
            than crossovers may be.
    """
    start, tables = _start_trees(settings, game), _decision_tables(settings, game)
    evolving = [number for number, role in enumerate(game.roles) if role.evolves]
    return {role: Creation(start.get(role, ()), tables.get(role, ())) for role in evolving}


def _start_trees(settings: GPSettings, game: Game) -> dict[int, list[Tree]]:
    found: dict[int, list[Tree]] = {}
    for name, texts in settings.start.items():
        role = _evolving(game, name, "gp.start")
        functions = game.function_set(role)
        for place, text in enumerate(texts):
            try:
                found.setdefault(role, []).append(parse(text, functions))
            except InputError as error:
                raise InputError(f"gp.start.{name}.{place}: {str(error).removeprefix('tree: ')}") from None
    return found


def _decision_tables(settings: GPSettings, game: Game) -> dict[int, DecisionTable]:
    found: dict[int, DecisionTable] = {}
    for name, table in settings.decision_tables.items():
        role, key = _evolving(game, name, "gp.decision_tables"), f"gp.decision_tables.{name}"
        functions = game.function_set(role).functions
        for place, questions in enumerate(table):
            for at, question in enumerate(questions):
                if question in questions[:at]:
                    raise InputError(f"{key}.{place}: asks {question!r} twice, which never holds the second time")
                if question not in functions:
                    raise InputError(
                        f"{key}.{place}: {question!r} is no question of {name}."
                        f"{nearest_name(question, functions)} Known: {', '.join(functions)}"
                    )
        leaves = math.prod(len(questions) + 1 for questions in table)
        if leaves > _MOST_LEAVES:
            raise InputError(f"{key}: expected a table of at most {_MOST_LEAVES:,} leaves, got {leaves:,}")
        depth = sum(map(len, table))
        if depth > settings.crossover_depth_max:
            raise InputError(
                f"{key}: expected at most gp.crossover_depth_max = {settings.crossover_depth_max} questions one after"
                f" the other, or no child of a crossover would be kept, got {depth}"
            )
        found[role] = table
    return found


def _evolving(game: Game, name: str, key: str) -> int:
    """Return the number of the role of this name, which evolves."""
    names = {role.name: number for number, role in enumerate(game.roles) if role.evolves}
    if name not in names:
        raise InputError(
            f"{key}: {name!r} is no role that evolves.{nearest_name(name, names)} Known: {', '.join(names)}"
        )
    return names[name]


def prepare(settings: EvolutionSettings, tell: Callable[[str], None]) -> None:
    """Make ready what takes long once, before workers need it; ``tell`` receives a line about it."""
    if isinstance(settings, RunSettings):
        warm_up(settings, tell)


def own_references(settings: EvolutionSettings) -> list[str]:
    """Return every ``module:name`` of the settings."""
    references = [str(settings.game["kind"])] if isinstance(settings, ForeignSettings) else []
    return references + ([settings.fitness.kind] if ":" in settings.fitness.kind else [])
