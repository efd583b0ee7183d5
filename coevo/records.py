"""What a generation leaves behind: its individuals, its lines in the table of generations, and what comes next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Checkpoint", "GenerationRecord", "best_first", "columns", "table_lines"]


def best_first(fitness: NDArray[np.float64], depth: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the indices of individuals from best to worst: by fitness, then depth, then index; all (population,)."""
    return np.lexsort((np.arange(len(fitness)), depth, fitness)).astype(np.int64)


@dataclass(frozen=True)
class GenerationRecord:
    """All individuals of one role in one generation.

    role: its number. robot: its name, as in the column of this name.
    codes: per individual its tree, (nodes,) uint8 in prefix order.
    group: (population,) int64, which group it played in. fitness: (population,) float64.
    counts: by name (population,) int64, summed over its games, in the order of the game's counts.
    depth, nodes: (population,) int64.
    """

    role: int
    robot: str
    codes: Sequence[NDArray[np.uint8]]
    group: NDArray[np.int64]
    fitness: NDArray[np.float64]
    counts: Mapping[str, NDArray[np.int64]]
    depth: NDArray[np.int64]
    nodes: NDArray[np.int64]

    @property
    def order(self) -> NDArray[np.int64]:
        """(population,) indices, as of ``best_first``."""
        return best_first(self.fitness, self.depth)


@dataclass(frozen=True)
class Checkpoint:
    """What is needed to go on: the number of the next generation, and per role its population's codes."""

    generation: int
    populations: Mapping[int, Sequence[NDArray[np.uint8]]]


def columns(counts: Sequence[str]) -> list[str]:
    """Return the columns of generations.csv."""
    sizes = [f"{size}_{which}" for size in ("depth", "nodes") for which in ("best", "mean", "worst")]
    return ["generation", "robot", "fitness_best", "fitness_mean", "fitness_worst", *counts, *sizes]


def table_lines(generation: int, records: Sequence[GenerationRecord]) -> list[str]:
    """Return the lines of a generation in generations.csv."""
    lines = []
    for record in records:
        best, worst = int(record.order[0]), int(record.order[-1])
        row: list[Any] = [generation, record.robot]
        row += [float(record.fitness[best]), float(record.fitness.mean()), float(record.fitness[worst])]
        row += [int(values[best]) for values in record.counts.values()]
        for sizes in (record.depth, record.nodes):
            row += [int(sizes[best]), float(sizes.mean()), int(sizes[worst])]
        lines.append(",".join(str(value) for value in row))
    return lines
