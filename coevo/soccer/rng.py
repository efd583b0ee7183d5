"""Random numbers inside compiled games: one stream a game, from one 64-bit seed (splitmix64; coevo.seeds)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import helper

__all__ = ["below", "normal", "uniform"]


@helper
def uniform(rng: NDArray[np.uint64]) -> float:
    """Draw from [0, 1); ``rng`` is the (1,) uint64 state of the stream and moves on."""
    rng[0] += np.uint64(0x9E3779B97F4A7C15)
    z = rng[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@helper
def below(rng: NDArray[np.uint64], n: int) -> int:
    """Draw an integer from 0 to n - 1."""
    return int(uniform(rng) * n)


@helper
def normal(rng: NDArray[np.uint64]) -> float:
    """Draw from the standard normal distribution (Box and Muller)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(rng)))
    return radius * math.cos(2.0 * math.pi * uniform(rng))
