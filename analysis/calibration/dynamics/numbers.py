"""Small co-evolutions whose dynamics are known: games of numbers after Watson and Pollack (2001).

Two populations play a game whose rules fix what must happen: the chance to win is a function of two numbers. Selection
and mutation are real, so champions are as lucky and as uneven as those of a run; the matrix is exact, without games.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

__all__ = ["GAMES", "coevolve"]

_Numbers = NDArray[np.float64]
_Game = Callable[[_Numbers, _Numbers], _Numbers]


def coevolve(
    game: _Game,
    random: Generator,
    *,
    starts: tuple[float, float] = (0.0, 0.0),
    steps: tuple[float, float] = (0.3, 0.3),
    biases: tuple[float, float] = (0.0, 0.0),
    selection: bool = True,
    generations: int = 60,
    population: int = 20,
    opponents: int = 10,
) -> _Numbers:
    """Co-evolve two populations of numbers, and return the chances of all champions against each other.

    Args:
        game: chance that a number of the first side (a, 1) wins against one of the second (1, b), as (a, b).
        random: all randomness.
        starts: where either population starts; steps, biases: standard deviation and mean of a mutation there.
        selection: choose parents in tournaments of two; without it heredity is off as well, and nothing accumulates.
        generations, population, opponents: sizes; each individual meets so many of the other side.

    Returns:
        (generations, generations): champions of the first side in rows.
    """
    sides = [start + random.normal(0, step, population) for start, step in zip(starts, steps, strict=True)]
    champions: list[list[float]] = [[], []]
    for _ in range(generations):
        pairs = [random.choice(sides[1 - side], opponents, replace=False) for side in (0, 1)]
        fitness = [
            game(sides[0][:, None], pairs[0][None, :]).mean(axis=1),
            1 - game(pairs[1][:, None], sides[1][None, :]).mean(axis=0),
        ]
        for side in (0, 1):
            best = np.flatnonzero(fitness[side] == fitness[side].max())
            champions[side].append(float(sides[side][random.choice(best)]))
            if selection:
                one, two = random.integers(population, size=(2, population))
                parents = np.where(fitness[side][one] >= fitness[side][two], one, two)
                sides[side] = sides[side][parents] + random.normal(biases[side], steps[side], population)
            else:
                sides[side] = starts[side] + random.normal(biases[side], steps[side], population)
    return np.asarray(game(np.array(champions[0])[:, None], np.array(champions[1])[None, :]))


def _greater(a: _Numbers, b: _Numbers) -> _Numbers:
    """The greater number wins more often."""
    return np.asarray(1 / (1 + np.exp(-np.clip(a - b, -50, 50))))


def _clock(a: _Numbers, b: _Numbers) -> _Numbers:
    """Numbers on a clock: who is ahead by less than half a turn wins more often; no number is best."""
    return np.asarray(0.5 + 0.45 * np.sin(a - b))


def _near(a: _Numbers, b: _Numbers) -> _Numbers:
    """Who is near the other catches it: the first side pursues, the second flees along an endless line."""
    return np.asarray(0.05 + 0.9 * np.exp(-0.5 * (a - b) ** 2))


def greater_number(random: Generator) -> _Numbers:
    """One dimension, transitive: an arms race."""
    step = random.uniform(0.1, 0.4)
    return coevolve(_greater, random, steps=(step, step), generations=int(random.integers(20, 80)))


def numbers_on_a_clock(random: Generator) -> _Numbers:
    """Intransitive: both sides go round and round."""
    step = random.uniform(0.3, 0.5)
    return coevolve(_clock, random, steps=(step, step), generations=int(random.integers(50, 100)))


def pursuit(random: Generator) -> _Numbers:
    """Only where the opponent stands now counts (focusing): it goes on and on, and those of the past are lost."""
    away = random.uniform(0.1, 0.3)
    return coevolve(_near, random, steps=(0.5, 0.1), biases=(0.0, away), generations=int(random.integers(40, 80)))


def far_apart(random: Generator) -> _Numbers:
    """The greater number wins, but one side starts so far ahead that selection sees no difference."""
    ahead = float(random.choice([-1.0, 1.0])) * random.uniform(10, 20)
    return coevolve(_greater, random, starts=(ahead, 0.0), steps=(0.1, 0.1), generations=int(random.integers(20, 80)))


def no_selection(random: Generator) -> _Numbers:
    """The greater number wins, but nobody is selected."""
    return coevolve(_greater, random, selection=False, generations=int(random.integers(20, 80)))


GAMES = {
    "progress": greater_number,
    "cycling": numbers_on_a_clock,
    "forgetting": pursuit,
    "disengagement": far_apart,
    "stagnation": no_selection,
}
