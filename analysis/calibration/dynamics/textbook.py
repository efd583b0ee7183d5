"""The ten lines that anyone would write first for each kind, with wide ranges; the diagnosis was tuned on these too.

Each family is a function ``(random, n) -> (n, n) float64``: the chance that champion i of the rows beats champion j of
the columns.
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
    i, j = np.indices((n, n))
    return i, j


# ------------------------------------------------------------------------------------------------------- progress


def newer_wins(random: Generator, n: int) -> _Chances:
    """The newer champion wins, with one chance or always."""
    i, j = _grid(n)
    high = random.uniform(0.65, 1)
    return np.where(i > j, high, np.where(i == j, 0.5, 1 - high))


def linear_gap(random: Generator, n: int) -> _Chances:
    """The share is a straight line of the gap in generations, and of one's own age."""
    i, j = _grid(n)
    return np.clip(0.5 + random.uniform(0.3, 2) * (i - random.uniform(0, 1) * (j - n / 2) - n / 2) / n, 0, 1)


def s_curve(random: Generator, n: int) -> _Chances:
    """A logistic rise between two levels against opponents that stay."""
    time = _grid(n)[0] / (n - 1)
    low, high = random.uniform(0, 0.4), random.uniform(0.6, 0.94)
    return low + (high - low) * _logistic(random.uniform(5, 40) * (time - random.uniform(0.25, 0.7)))


def ratings_with_drift(random: Generator, n: int) -> _Chances:
    """Ratings that walk at random, more up than down; the columns climb at another speed."""
    rows = random.normal(1, random.uniform(0, 1.0), n).cumsum() / n
    columns = random.normal(1, random.uniform(0, 1.0), n).cumsum() / n * random.uniform(0, 1.3)
    climb = random.uniform(2, 5)
    return _logistic(climb * (rows[:, None] - rows.mean() - columns[None, :] + columns.mean()))


# -------------------------------------------------------------------------------------------------------- cycling


def matching_pennies(random: Generator, n: int) -> _Chances:
    """Two strategies in turn: one side wants the same, the other wants the opposite."""
    i, j = _grid(n)
    dwell = int(random.integers(1, max(1, n // 5) + 1))
    same = (i // dwell) % 2 == (j // dwell) % 2
    high = random.uniform(0.65, 1)
    return np.where(same, high, 1 - high)


def both_swing(random: Generator, n: int) -> _Chances:
    """The abilities of both sides swing, the one behind the other, with a small trend."""
    i, j = _grid(n)
    turn = 2 * np.pi / random.uniform(3, max(3.5, n / 2))
    phase = random.uniform(0, 2 * np.pi)
    swing = np.sin(turn * i + phase) - random.uniform(0, 1) * np.sin(turn * j + phase - random.uniform(0, np.pi))
    return _logistic(np.float64(random.uniform(0.8, 2.5)) * swing + random.uniform(0, 0.5) * (i - j) / n)


def ring(random: Generator, n: int) -> _Chances:
    """Three to six strategies in a ring, each beating the one before it; a generation moves on by one or rests."""
    kinds = int(random.integers(3, 7))
    dwell = int(random.integers(1, max(1, n // (2 * kinds)) + 1))
    i, j = _grid(n)
    apart = (i // dwell - j // dwell + int(random.integers(kinds))) % kinds
    size = random.uniform(0.2, 0.5)
    return np.asarray(0.5 + size * (apart == 1) - size * (apart == kinds - 1), np.float64)


def wandering_phase(random: Generator, n: int) -> _Chances:
    """Phases that turn with a speed that varies, one for both sides."""
    turn = 2 * np.pi / random.uniform(3, max(3.5, n / 3))
    phase = (turn * (1 + random.uniform(0, 0.3) * random.normal(0, 1, n))).cumsum()
    return np.asarray(0.5 + random.uniform(0.15, 0.5) * np.sin(phase[:, None] - phase[None, :] + random.uniform(0, 6)))


def boom_and_bust(random: Generator, n: int) -> _Chances:
    """The rows grow faster and faster, and crash, over and over; against all, or against each opponent at its time."""
    i, j = _grid(n)
    time = (i - (j if random.random() < 0.3 else 0)) / random.uniform(3, max(3.5, n / 2.2)) + random.random()
    growth = random.uniform(0.5, 3)
    low, high = random.uniform(0, 0.25), random.uniform(0.6, 1)
    return np.asarray(low + (high - low) * np.expm1(growth * (time % 1)) / np.expm1(growth), np.float64)


# ----------------------------------------------------------------------------------------------------- forgetting


def short_reach(random: Generator, n: int) -> _Chances:
    """Beats newer opponents as in an arms race, but those of more than some generations ago hardly."""
    i, j = _grid(n)
    reach = random.uniform(max(2, 0.08 * n), 0.4 * n)
    chances = _logistic(random.uniform(0.3, 3) * (i - j + 0.5))
    return np.where(i - j > reach, random.uniform(0.02, 0.3), chances)


def linear_decay(random: Generator, n: int) -> _Chances:
    """What is won against an opponent falls in a straight line with the generations since."""
    i, j = _grid(n)
    high = random.uniform(0.6, 0.95)
    newer = random.uniform(0.2, high)
    return np.where(i >= j, np.maximum(high - random.uniform(0.4, 1.5) * (i - j) / n, 0.05), newer)


def skills_overwritten(random: Generator, n: int) -> _Chances:
    """Each opponent asks for one skill; a champion has the last few only."""
    i, j = _grid(n)
    each = int(random.integers(1, max(1, n // 8) + 1))
    kept = int(random.integers(1, 4))
    has = (j // each <= i // each) & (j // each > i // each - kept)
    return np.where(has, random.uniform(0.6, 1), random.uniform(0, 0.25))


def late_collapse(random: Generator, n: int) -> _Chances:
    """A level or an arms race until late, then early opponents are no longer beaten."""
    i, j = _grid(n)
    climb = random.uniform(0, 1.5)
    chances = _logistic(climb * (i - j) / n + random.uniform(0.3, 1.5))
    lost = (i > random.uniform(0.5, 0.8) * n) & (j < random.uniform(0.35, 0.7) * n)
    return np.where(lost, random.uniform(0.02, 0.2), chances)


# -------------------------------------------------------------------------------------------------- disengagement


def never_engaged(random: Generator, n: int) -> _Chances:
    """So far apart that the difference of champions does not show."""
    i, j = _grid(n)
    side = random.choice([-1.0, 1.0])
    return _logistic(side * random.uniform(4, 9) + random.normal(0, 0.3, (n, 1)) + 0.5 * (i - j) / n)


def late_block(random: Generator, n: int) -> _Chances:
    """An even or rising start, and from some generation on the same outcome always."""
    i, j = _grid(n)
    onset = random.uniform(0.2, 0.72) * n
    start = _logistic(random.uniform(0, 2) * (i - j) / n + random.uniform(-1, 1))
    end = float(random.choice([0.0, 1.0, 0.02, 0.98]))
    later = [(i >= onset) & (j >= onset), i >= onset, j >= onset, np.maximum(i, j) >= onset][int(random.integers(4))]
    return np.where(later, end, start)


# ----------------------------------------------------------------------------------------------------- stagnation


def any_share(random: Generator, n: int) -> _Chances:
    """Each pair has its own share, spread evenly around a level."""
    level, spread = random.uniform(0.2, 0.8), random.uniform(0, 0.2)
    return np.asarray(random.uniform(level - spread, level + spread, (n, n)))


def level_with_luck(random: Generator, n: int) -> _Chances:
    """One level; champions and opponents differ a little, and a trend of no weight is in it."""
    i, _ = _grid(n)
    trend = random.uniform(-0.02, 0.02)
    luck = random.normal(0, random.uniform(0, 0.08), (n, 1)) + random.normal(0, random.uniform(0, 0.08), (1, n))
    return np.clip(random.uniform(0.1, 0.9) + trend * i / n + luck, 0.05, 0.95)


FAMILIES = {
    "progress": (newer_wins, linear_gap, s_curve, ratings_with_drift),
    "cycling": (matching_pennies, both_swing, ring, wandering_phase, boom_and_bust),
    "forgetting": (short_reach, linear_decay, skills_overwritten, late_collapse),
    "disengagement": (never_engaged, late_block),
    "stagnation": (any_share, level_with_luck),
}
