"""Who plays with whom."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coevo.seeds import RunStream, generator

__all__ = ["random_groups"]


def random_groups(population: int, robots: int, *, seed: int, generation: int) -> NDArray[np.int64]:
    """Return (population, robots): row g holds the individuals of group g, each individual in exactly one group."""
    random = generator(seed, RunStream.GROUPING, generation)
    return np.stack([random.permutation(population) for _ in range(robots)], axis=1).astype(np.int64)
