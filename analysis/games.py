"""Play games of a setting between given trees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from coevo.config import RunSettings
from coevo.game import Arena, Outcome, SoccerGame
from coevo.seeds import RunStream, game_seeds
from coevo.tree import Program, Tree, compile_program, tree_codes

__all__ = ["play", "programs_of", "unseen_seeds"]


def unseen_seeds(seed: int, games: int) -> NDArray[np.uint64]:
    """Return seeds of games that no evolution plays."""
    return game_seeds(seed, RunStream.UNSEEN, count=games)


def programs_of(settings: RunSettings, trees: Sequence[Tree | None]) -> list[Program | None]:
    """Return flat programs of a team's trees, None for robots that stand."""
    game = SoccerGame(settings)
    programs: list[Program | None] = []
    for robot, tree in enumerate(trees):
        functions = game.function_set(robot)
        programs.append(None if tree is None else compile_program(tree_codes(tree, functions), functions))
    return programs


def play(arena: Arena, trees: Sequence[Tree | None], *, games: int, seed: int) -> Outcome:
    """Play ``games`` unseen games; the same seed is the same games for every team.

    Example:
        >>> from analysis.games import play
        >>> from coevo.game import Arena
        >>> from coevo.recipes import read_experiment
        >>> from coevo.tree import parse
        >>> arena = Arena(read_experiment("two-learners"))
        >>> both = [parse("IF_ball_is_lost(search, pass)"), parse("shoot")]
        >>> alone = [parse("search"), parse("search")]
        >>> play(arena, both, games=40, seed=1).goals_of(0) > play(arena, alone, games=40, seed=1).goals_of(0)
        True
    """
    return arena.play(programs_of(arena.settings, trees), unseen_seeds(seed, games))
