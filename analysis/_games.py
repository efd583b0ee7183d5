"""Play games of a setting between given trees, and say how sure the result is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from coevo.game import Arena, Outcome
from coevo.soccer.rng import game_seed
from coevo.tree import Program, Tree, compile_program, function_set, tree_codes

__all__ = ["mean_interval", "play", "programs_of", "unseen_seeds"]

_UNSEEN = 5


def unseen_seeds(seed: int, games: int) -> NDArray[np.uint64]:
    """Return seeds of games that no evolution plays."""
    return np.array([game_seed(seed, _UNSEEN, game) for game in range(games)], np.uint64)


def programs_of(trees: Sequence[Tree | None]) -> list[Program | None]:
    """Return flat programs of a team's trees, None for robots that stand."""
    robots = len(trees)
    programs: list[Program | None] = []
    for robot, tree in enumerate(trees):
        functions = function_set(robot, robots)
        programs.append(None if tree is None else compile_program(tree_codes(tree, functions), functions))
    return programs


def play(arena: Arena, trees: Sequence[Tree | None], *, games: int, seed: int) -> Outcome:
    """Play ``games`` unseen games; the same seed is the same games for every team."""
    return arena.play(programs_of(trees), unseen_seeds(seed, games))


def mean_interval(values: Sequence[float] | NDArray[np.float64]) -> tuple[float, float, float]:
    """Return the mean of independent values and its 95 % confidence interval by Student's t."""
    data = np.asarray(values, np.float64)
    mean = float(data.mean())
    if len(data) < 2 or float(data.std()) == 0.0:
        return mean, mean, mean
    half = float(stats.t.ppf(0.975, len(data) - 1)) * float(data.std(ddof=1)) / float(np.sqrt(len(data)))
    return mean, mean - half, mean + half
