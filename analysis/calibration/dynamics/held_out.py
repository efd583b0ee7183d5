"""Matrices of known dynamics on which nothing was tuned: other forms than those of `tuned`, written beforehand.

Each family is a function ``(random, n) -> (n, n) float64``: the chance that champion i of the rows beats champion j of
the columns.
"""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

__all__ = ["FAMILIES"]

_Chances = NDArray[np.float64]


def _probit(x: NDArray[np.float64]) -> _Chances:
    from scipy.special import ndtr

    return np.asarray(ndtr(x), np.float64)


# ------------------------------------------------------------------------------------------------------- progress


def saturating(random: Generator, n: int) -> _Chances:
    """Shares approach a level exponentially, and stay there."""
    time = np.arange(n)[:, None] / n
    low = random.uniform(0.02, 0.4)
    high = random.uniform(low + 0.25, 0.9)
    life = random.uniform(0.1, 0.5)
    harder = random.uniform(0, 0.1) * np.arange(n)[None, :] / n
    return np.clip(high - (high - low) * np.exp(-time / life) - harder, 0, 1)


def random_gains(random: Generator, n: int) -> _Chances:
    """Rows and columns gain by random amounts, each its own; many gains are zero; the link is a normal distribution."""

    def ability() -> NDArray[np.float64]:
        gains = random.gamma(0.5, 1.0, n)
        return np.asarray(gains.cumsum() / gains.sum())

    climb = random.uniform(1, 10)
    return _probit(climb * (ability()[:, None] - ability()[None, :]) + random.uniform(-0.5, 0.5))


def growing_strength(random: Generator, n: int) -> _Chances:
    """Strengths that grow by a factor a generation, drawn games besides (Bradley and Terry; Davidson)."""
    i, j = np.arange(n)[:, None], np.arange(n)[None, :]
    rows = np.exp(random.uniform(1.5, 8) * i / n) * random.lognormal(0, 0.1, (n, 1))
    columns = np.exp(random.uniform(0, 1.5) * j / n) * random.lognormal(0, 0.1, (1, n)) * np.sqrt(rows.max())
    return np.asarray(rows / (rows + columns + random.uniform(0, 1.5) * np.sqrt(rows * columns)))


def breakthroughs(random: Generator, n: int) -> _Chances:
    """Long rests, and a few breakthroughs of either side; drawn games scale all shares down."""
    ability = [np.interp(np.arange(n), np.sort(random.uniform(0, n, 8)), np.arange(8) // 2 * 2) for _ in range(2)]
    climb = random.uniform(1, 3) / 6
    gap = climb * (ability[0][:, None] - random.uniform(0, 1) * ability[1][None, :])
    return np.asarray(random.uniform(0.5, 1) * _probit(gap - gap.mean() + random.normal(0, 0.1, (n, 1))))


# -------------------------------------------------------------------------------------------------------- cycling


def turning_mixtures(random: Generator, n: int) -> _Chances:
    """Mixtures of three to five pure strategies turn on a simplex, each side at its own phase and nearly one speed."""
    kinds = int(random.choice([3, 5]))
    apart = np.arange(kinds)[:, None] - np.arange(kinds)[None, :]
    payoff = np.sin(2 * np.pi * apart / kinds) / np.sin(2 * np.pi / kinds)
    period = np.exp(random.uniform(np.log(4), np.log(max(4.5, 0.45 * n))))
    sharp = random.uniform(1, 4)

    def mixtures(speed: float) -> NDArray[np.float64]:
        angle = 2 * np.pi * (speed * np.arange(n)[:, None] / period + random.random())
        weight = np.exp(sharp * np.cos(angle - 2 * np.pi * np.arange(kinds) / kinds))
        return np.asarray(weight / weight.sum(axis=1, keepdims=True))

    size = random.uniform(0.4, 0.5) if sharp < 2 else random.uniform(0.25, 0.5)
    game = mixtures(1.0) @ payoff @ mixtures(random.uniform(0.9, 1.1)).T
    return np.asarray(np.clip(0.5 + size * game, 0, 1), np.float64)


def sawtooth(random: Generator, n: int) -> _Chances:
    """The rows gain step by step against an opponent, and lose it all at once, again and again."""
    period = random.uniform(3, max(3.5, 0.45 * n))
    shift = random.random()
    lag = np.arange(n)[:, None] - random.choice([0.0, 1.0]) * np.arange(n)[None, :]
    low, high = random.uniform(0.02, 0.25), random.uniform(0.65, 0.98)
    return np.asarray(low + (high - low) * ((lag / period + shift) % 1))


def irregular_turns(random: Generator, n: int) -> _Chances:
    """Three strategies in turn that last for times of random length."""
    dwell = random.uniform(1.5, max(1.6, n / 12))

    def strategies() -> NDArray[np.int64]:
        lengths = 1 + random.poisson(dwell - 1, n)
        turns = np.repeat(np.arange(n), lengths)[:n] + int(random.integers(3))
        return np.asarray(turns % 3)

    beats = np.array([[0.5, 0.1, 0.9], [0.9, 0.5, 0.1], [0.1, 0.9, 0.5]])
    weak = random.uniform(0.6, 1)
    return np.asarray(0.5 + weak * (beats[strategies()][:, strategies()] - 0.5))


def counters(random: Generator, n: int) -> _Chances:
    """Each side answers what the other played some generations ago, in a ring of strategies (a delayed best answer)."""
    kinds = int(random.integers(3, 6))
    delay = int(random.integers(1, max(1, n // 12) + 1))
    rows, columns = np.zeros(n, int), np.zeros(n, int)
    for t in range(delay, n):
        rows[t] = (columns[t - delay] + 1) % kinds
        columns[t] = (rows[t - delay] + 1) % kinds
    ahead = (rows[:, None] - columns[None, :]) % kinds
    chance = np.full(kinds, 0.5)
    chance[1], chance[-1] = random.uniform(0.7, 1), random.uniform(0, 0.3)
    return np.asarray(chance[ahead])


# ----------------------------------------------------------------------------------------------------- forgetting


def epochs(random: Generator, n: int) -> _Chances:
    """Opponents come in epochs; a champion knows those of its own epoch, and of the one before a little."""
    count = int(random.integers(3, max(4, min(n // 3, 9)) + 1))
    epoch = np.minimum(np.arange(n) * count // n, count - 1)
    apart = epoch[:, None] - epoch[None, :]
    known = np.select([apart == 0, apart == 1], [1.0, random.uniform(0.2, 0.7)], 0.0)
    low, high = random.uniform(0.05, 0.3), random.uniform(0.65, 0.95)
    return np.asarray(low + (high - low) * known)


def focused(random: Generator, n: int) -> _Chances:
    """Best against those of some generations ago, worse the farther in time (a bell in the lag)."""
    lag = np.arange(n)[:, None] - np.arange(n)[None, :]
    width = random.uniform(max(1.5, 0.05 * n), 0.2 * n)
    base = random.uniform(0.05, 0.3)
    bell = np.exp(-0.5 * ((lag - random.uniform(0, 0.1) * n) / width) ** 2)
    return np.asarray(base + random.uniform(0.4, 0.65) * bell)


def lost_ground(random: Generator, n: int) -> _Chances:
    """Holds a level, and loses it late: against early opponents only, or slowly against all."""
    i, j = np.arange(n)[:, None] / n, np.arange(n)[None, :] / n
    high = random.uniform(0.55, 0.95)
    loss = random.uniform(0.3, high - 0.05)
    if random.random() < 0.5:
        lost = (i > random.uniform(0.5, 0.8)) & (j < random.uniform(0.3, 0.7)) & (j < i)
        return np.where(lost, high - loss, high)
    return np.asarray(high - loss * _probit((i - random.uniform(0.4, 0.7)) / random.uniform(0.05, 0.25)) + 0 * j)


def power_law_of_forgetting(random: Generator, n: int) -> _Chances:
    """What was learned against an opponent is lost as a power of the time since; new opponents are half known."""
    lag = np.arange(n)[:, None] - np.arange(n)[None, :]
    high, low = random.uniform(0.7, 1), random.uniform(0, 0.15)
    kept = (1 + np.maximum(lag, 0) / random.uniform(0.5, 0.06 * n + 1)) ** -random.uniform(0.7, 1.5)
    return np.where(lag >= 0, low + (high - low) * kept, random.uniform(0.3, 0.6) * (high + low))


# -------------------------------------------------------------------------------------------------- disengagement


def outclassed(random: Generator, n: int) -> _Chances:
    """Strengths so far apart that hardly a game is lost, from the start; each pair a little different."""
    chances = random.beta(0.3, 40, (n, n))
    return np.asarray(chances if random.random() < 0.5 else 1 - chances)


def drifting_apart(random: Generator, n: int) -> _Chances:
    """Even at first, then one side leaves the other behind within a few generations (normal link)."""
    time = np.arange(n) / n
    onset, steep = random.uniform(0.15, 0.55), random.uniform(0.02, 0.08)
    gap = random.uniform(2.5, 5) * _probit((time - onset) / steep)
    sign = 1 if random.random() < 0.5 else -1
    if random.random() < 0.5:
        return _probit(sign * np.maximum(gap[:, None], gap[None, :]) + random.normal(0, 0.15, (n, 1)))
    return _probit(sign * (gap[:, None] if random.random() < 0.5 else gap[None, :]) + np.zeros((n, n)))


def quiet_end(random: Generator, n: int) -> _Chances:
    """Any play in an early corner, and exactly all or nothing outside of it."""
    onset = max(2, int(random.uniform(0.1, 0.6) * n))
    chances = np.full((n, n), float(random.integers(2)))
    chances[:onset, :onset] = random.uniform(0.2, 0.8) + random.uniform(-0.15, 0.15, (onset, 1))
    return chances


def one_sided_end(random: Generator, n: int) -> _Chances:
    """Changing fortunes without order at first, then one side loses every game but a stray one."""
    onset = int(random.uniform(0.25, 0.7) * n)
    chances = np.clip(random.normal(random.uniform(0.3, 0.7), 0.08, (n, n)), 0, 1)
    stray = random.uniform(0, 0.02) * random.random((n, n))
    later = np.arange(n) >= onset
    either = later[:, None] | later[None, :] if random.random() < 0.5 else later[:, None] & later[None, :]
    return np.where(either, stray if random.random() < 0.5 else 1 - stray, chances)


# ----------------------------------------------------------------------------------------------------- stagnation


def uneven_strengths(random: Generator, n: int) -> _Chances:
    """Strengths drawn anew each generation from one gamma distribution (Bradley and Terry)."""
    shape = random.uniform(4, 40)
    rows = random.gamma(shape, 1 / shape, (n, 1)) * np.exp(random.uniform(-1.5, 1.5))
    return np.asarray(rows / (rows + random.gamma(shape, 1 / shape, (1, n))))


def short_memory(random: Generator, n: int) -> _Chances:
    """Champions wander a little about one level, and come back within one or two generations."""
    ability = np.zeros(n)
    keep = random.uniform(0, 0.5)
    for t in range(1, n):
        ability[t] = keep * ability[t - 1] + random.normal(0, 0.04)
    return np.clip(random.uniform(0.2, 0.8) + ability[:, None] + random.normal(0, 0.03, (1, n)), 0, 1)


def only_the_others(random: Generator, n: int) -> _Chances:
    """The rows stay as they are; the columns get better or worse a little, or differ."""
    change = random.uniform(-0.2, 0.2)
    level = random.uniform(0.3, 0.7)
    return np.clip(level + change * np.arange(n)[None, :] / n + random.normal(0, 0.02, (n, n)), 0, 1)


def trapped(random: Generator, n: int) -> _Chances:
    """One strategy is kept; what changes about it does not matter (drawn games included)."""
    return np.clip(random.uniform(0.07, 0.9) + random.laplace(0, 0.02, (n, 1)) + np.zeros((1, n)), 0, 1)


FAMILIES = {
    "progress": (saturating, random_gains, growing_strength, breakthroughs),
    "cycling": (turning_mixtures, sawtooth, irregular_turns, counters),
    "forgetting": (epochs, focused, lost_ground, power_law_of_forgetting),
    "disengagement": (outclassed, drifting_apart, quiet_end, one_sided_end),
    "stagnation": (uneven_strengths, short_memory, only_the_others, trapped),
}
