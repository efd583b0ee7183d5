"""Matrices of known dynamics, on which the limits of the diagnosis were chosen.

Each family is a function ``(random, n) -> (n, n) float64``: the chance that champion i of the rows beats champion j of
the columns. Shares of games are drawn from it elsewhere. `held_out` has other forms of the same kinds.
"""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

__all__ = ["FAMILIES"]

_Chances = NDArray[np.float64]


def _logistic(x: ArrayLike) -> NDArray[np.float64]:
    return np.asarray(1 / (1 + np.exp(-np.clip(x, -50, 50))), np.float64)


def _grid(n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    return np.arange(n)[:, None], np.arange(n)[None, :]


def _luck(random: Generator, n: int, most: float) -> _Chances:
    """Return logits by which one champion differs from the next one without a trend: (n, 1) plus (1, n)."""
    size = random.uniform(0, most)
    return np.asarray(random.normal(0, size, (n, 1)) + random.normal(0, size, (1, n)))


# ------------------------------------------------------------------------------------------------------- progress


def arms_race(random: Generator, n: int) -> _Chances:
    """Both sides climb, by 2 to 60 logits over the run; the columns at 0 to 1 of the rows' speed at gentle slopes."""
    i, j = _grid(n)
    climb = float(np.exp(random.uniform(np.log(2), np.log(60))))
    other = random.uniform(0, 1) if climb < 5 else 1.0
    start = random.uniform(-0.7, 0.7) - (climb / 2 if other == 0 else 0)
    return _logistic(start + climb * (i - other * j) / n - (1 - other) * climb / 2 + _luck(random, n, 0.3))


def straight_line(random: Generator, n: int) -> _Chances:
    """Shares climb in a straight line against columns that differ, and do not climb."""
    low = random.uniform(0.03, 0.5)
    high = low + random.uniform(0.25, min(0.9 - low, 0.7))
    columns = random.normal(0, random.uniform(0, 0.06), (1, n))
    return np.clip(np.linspace(low, high, n)[:, None] + columns, 0, 1)


def staircase(random: Generator, n: int) -> _Chances:
    """One to five sudden steps up; the columns may do the same."""
    count = int(random.integers(1, 6))
    at = random.uniform(0.12, 0.85, count) * n
    step = random.uniform(1.2, 3.0) / count + 0.3
    rows = step * (np.arange(n)[:, None] > at).sum(axis=1)
    climbing = random.random() < 0.5
    columns = rows if climbing else np.full(n, rows.mean())
    draws = random.uniform(0.5, 1)
    return draws * _logistic(rows[:, None] - columns[None, :] + random.uniform(-0.6, 0.6) + _luck(random, n, 0.25))


# -------------------------------------------------------------------------------------------------------- cycling


def _period(random: Generator, n: int) -> float:
    return float(np.exp(random.uniform(np.log(3), np.log(n / 2))))


def phases(random: Generator, n: int) -> _Chances:
    """A sine of the difference of two phases that turn at one speed."""
    i, j = _grid(n)
    turn = 2 * np.pi / _period(random, n)
    size = random.uniform(0.2, 0.48)
    wave = np.sin(turn * (i - j) + random.uniform(0, 2 * np.pi))
    return np.asarray((0.5 + size * wave) * random.uniform(0.7, 1))


def rock_paper_scissors(random: Generator, n: int) -> _Chances:
    """Both sides play rock, paper and scissors in turn, each for some generations."""
    dwell = int(random.integers(1, max(n // 6, 1) + 1))
    rows = np.arange(n) // dwell % 3
    columns = (np.arange(n) + int(random.integers(0, 3 * dwell))) // dwell % 3
    size = random.uniform(0.2, 0.48)
    payoff = 0.5 + size * np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]])
    return np.asarray(payoff[rows][:, columns])


def ups_and_downs(random: Generator, n: int) -> _Chances:
    """The rows are good and bad in turn against all."""
    turn = 2 * np.pi / max(_period(random, n), 4)
    wave: _Chances = np.asarray(np.sin(turn * np.arange(n) + random.uniform(0, 2 * np.pi)), np.float64)
    if random.random() < 0.3:
        wave = np.asarray(np.sign(wave), np.float64)
    return _logistic(random.uniform(-0.5, 0.5) + random.uniform(1, 2.5) * wave[:, None] + _luck(random, n, 0.15))


def whims(random: Generator, n: int) -> _Chances:
    """Three strategies, each left for the one that beats it by some chance; each side at its own time."""
    leave = random.uniform(0.2, 0.9) if n > 20 else random.uniform(0.5, 0.9)
    rows = np.cumsum(random.random(n) < leave) % 3
    columns = np.cumsum(random.random(n) < leave) % 3
    size = random.uniform(0.25, 0.48)
    payoff = 0.5 + size * np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]])
    return np.asarray(payoff[rows][:, columns])


# ----------------------------------------------------------------------------------------------------- forgetting


def band(random: Generator, n: int) -> _Chances:
    """Strong against opponents of the last generations only."""
    i, j = _grid(n)
    width = random.uniform(max(2, 0.05 * n), 0.35 * n)
    low, high = random.uniform(0.03, 0.35), random.uniform(0.6, 0.95)
    edge = random.uniform(0.3, 0.2 * width + 0.5)
    inside = _logistic((i - j + 0.5) / edge) * _logistic((width - 0.5 - (i - j)) / edge)
    return np.asarray(low + (high - low) * inside)


def rise_and_fall(random: Generator, n: int) -> _Chances:
    """Climbs against all, then falls back, at once or step by step."""
    time = np.arange(n) / (n - 1)
    top = random.uniform(0.35, 0.75)
    fallen = random.uniform(0.0, 0.35)
    if random.random() < 0.5:
        ability = np.where(time <= top, time / top, fallen)
    else:
        ability = np.where(time <= top, time / top, 1 - (1 - fallen) * (time - top) / (1 - top))
    return _logistic(random.uniform(2, 4) * (ability[:, None] - 0.5) + _luck(random, n, 0.2))


def fading_memory(random: Generator, n: int) -> _Chances:
    """What was learned against an opponent fades with the generations since."""
    i, j = _grid(n)
    lag = i - j
    life = random.uniform(0.05, 0.25) * n
    high, low = random.uniform(0.65, 0.95), random.uniform(0.02, 0.25)
    before = random.uniform(low, 0.5)
    return np.where(lag >= 0, low + (high - low) * np.exp(-np.maximum(lag, 0) / life), before)


# -------------------------------------------------------------------------------------------------- disengagement


def _saturated(random: Generator) -> float:
    value = random.uniform(0, 0.025)
    return float(value if random.random() < 0.5 else 1 - value)


def from_the_start(random: Generator, n: int) -> _Chances:
    """All games won, or all lost, from the first generation on."""
    return np.full((n, n), _saturated(random))


def from_some_generation(random: Generator, n: int) -> _Chances:
    """Engaged at first; from some generation on one side wins all, against contemporaries or against everybody."""
    onset = int(random.uniform(0.2, 0.7) * n)
    chances = _logistic(random.normal(0, 0.2, (n, n)) + random.uniform(-1, 1) + _luck(random, n, 0.2))
    what = random.integers(3)
    value = _saturated(random)
    if what == 0:
        chances[onset:, onset:] = value
    elif what == 1:
        chances[onset:, :] = value
    else:
        chances[:, onset:] = value
    return chances


def runaway(random: Generator, n: int) -> _Chances:
    """An arms race that one side wins for good after some generation."""
    i, j = _grid(n)
    onset = random.uniform(0.2, 0.6) * n
    climb = random.uniform(1, 6) / n
    ahead = random.uniform(6, 12)
    rows, columns = climb * i + 0.0 * j, climb * j + 0.0 * i
    if random.random() < 0.5:
        rows = rows + ahead * (i >= onset)
    else:
        columns = columns + ahead * (j >= onset)
    return _logistic(rows - columns)


# ----------------------------------------------------------------------------------------------------- stagnation


def one_level(random: Generator, n: int) -> _Chances:
    """The same share everywhere."""
    return np.full((n, n), random.uniform(0.08, 0.92))


def lucky_champions(random: Generator, n: int) -> _Chances:
    """Champions that differ, without order in time."""
    return _logistic(random.uniform(-2, 2) + _luck(random, n, 0.6))


def rough(random: Generator, n: int) -> _Chances:
    """Each pair has its own share around one level."""
    return np.clip(random.uniform(0.15, 0.85) + random.normal(0, random.uniform(0, 0.1), (n, n)), 0, 1)


FAMILIES = {
    "progress": (arms_race, straight_line, staircase),
    "cycling": (phases, rock_paper_scissors, ups_and_downs, whims),
    "forgetting": (band, rise_and_fall, fading_memory),
    "disengagement": (from_the_start, from_some_generation, runaway),
    "stagnation": (one_level, lucky_champions, rough),
}
