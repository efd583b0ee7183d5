"""Who plays with whom."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["random_groups"]

_GROUPING = 2


def random_groups(population: int, robots: int, *, seed: int, generation: int) -> NDArray[np.int64]:
    """Return (population, robots): row g holds the individuals of group g, each individual in exactly one group."""
    random = np.random.default_rng(np.random.SeedSequence([seed, _GROUPING, generation]))
    return np.stack([random.permutation(population) for _ in range(robots)], axis=1).astype(np.int64)
