"""What is measured of each generation besides fitness: how its trees differ, how far to trust fitness, passes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from coevo.records import GenerationRecord
from coevo.tree import FunctionSet, compile_program

__all__ = ["MEASURES", "distinct_trees", "evenness", "measure_lines", "measures_of", "repeatability", "top_of"]

MEASURES = ("generation", "robot", "repeatability", "diversity_trees", "diversity_tops", "passes")
_TOP = 3  # levels of nodes that are the top of a tree


def distinct_trees(trees: Sequence[NDArray[np.uint8]]) -> float:
    """Return the share of trees that are different, from 1 / population to 1.

    Args:
        trees: (nodes,) codes in prefix order, each.

    Example:
        >>> import numpy as np
        >>> from coevo.measures import distinct_trees
        >>> distinct_trees([np.array([0, 1, 2]), np.array([0, 1, 2]), np.array([1]), np.array([2])])
        0.75
    """
    return len({tree.tobytes() for tree in trees}) / len(trees)


def top_of(tree: NDArray[np.uint8], functions: FunctionSet) -> tuple[int, ...]:
    """Return the codes of a tree's nodes in its three topmost levels, in prefix order.

    Args:
        tree: (nodes,) codes in prefix order.
        functions: what it is made of.
    """
    program = compile_program(tree, functions)
    found: list[int] = []

    def walk(node: int, levels: int) -> None:
        if levels:
            found.append(int(tree[node]))
            if program.codes[node] >= 0:
                walk(node + 1, levels - 1)
                walk(int(program.second[node]), levels - 1)

    walk(0, _TOP)
    return tuple(found)


def evenness(tops: Sequence[tuple[int, ...]]) -> float:
    """Return the entropy of what individuals are, as a share of the greatest: 0 if all are equal, 1 if none are.

    Of the tops of trees it says how far a population has gone back to one ancestor: near the root trees change seldom,
    so that a population converges from the root down (McPhee and Hopper 1999, "Analysis of genetic diversity through
    population history"). Copies that differ somewhere below count as different trees, and as one top.

    Example:
        >>> from coevo.measures import evenness
        >>> evenness([(0,), (1,), (2,), (3,)]), evenness([(0,), (0,)]), evenness([(0,), (0,), (1,), (1,)])
        (1.0, 0.0, 0.5)
    """
    shares = np.array(list(Counter(tops).values())) / len(tops)
    return min(abs(float(-(shares * np.log(shares)).sum() / np.log(len(tops)))), 1.0) if len(tops) > 1 else 0.0


def repeatability(rounds: NDArray[np.float64]) -> float:
    """Return which share of the variance of fitness another evaluation of the same size would find again.

    The intraclass correlation of the mean over rounds, ICC(C, k) of McGraw and Wong (1996, "Forming inferences about
    some intraclass correlation coefficients"): 1 if the rounds agree about every difference, 0 if they agree about
    none; below 0 they agree less than by chance. What a round does to all individuals alike, such as common starts or
    opponents that are hard for everybody, is no disagreement.

    Args:
        rounds: (population, rounds) fitness by each round alone.

    Returns:
        NaN of fewer than two rounds or individuals, or if all individuals are equal.

    Example:
        >>> import numpy as np
        >>> from coevo.measures import repeatability
        >>> repeatability(np.array([[1.0, 2.0], [2.0, 3.0], [5.0, 6.0]]))  # every difference twice
        1.0
    """
    individuals, times = rounds.shape
    if min(individuals, times) < 2:
        return float("nan")
    own = rounds.mean(axis=1)
    between = times * own.var(ddof=1)
    rest = rounds - own[:, None] - rounds.mean(axis=0) + rounds.mean()
    within = (rest**2).sum() / ((individuals - 1) * (times - 1))
    return float(1.0 - within / between) if between > 0.0 else float("nan")


def measures_of(record: GenerationRecord, functions: FunctionSet, games: int) -> dict[str, float]:
    """Return what is measured of one role in one generation, by name; NaN for what cannot be.

    ``repeatability``; ``diversity_trees``, the share of different trees; ``diversity_tops``, how different they are
    near the root; ``passes``, a game, in the mean over individuals.

    Args:
        record: its individuals.
        functions: what its trees are made of.
        games: that each individual played.
    """
    passes = record.counts.get("passes")
    return {
        "repeatability": float("nan") if record.rounds is None else repeatability(record.rounds),
        "diversity_trees": distinct_trees(record.codes),
        "diversity_tops": evenness([top_of(tree, functions) for tree in record.codes]),
        "passes": float("nan") if passes is None else float(passes.mean()) / games,
    }


def measure_lines(
    generation: int, records: Sequence[GenerationRecord], functions: Mapping[int, FunctionSet], games: int
) -> list[str]:
    """Return the lines of a generation in measures.csv; empty where something cannot be measured."""
    lines = []
    for record in records:
        measured = measures_of(record, functions[record.role], games)
        values = [measured[name] for name in MEASURES[2:]]
        lines.append(",".join([str(generation), record.robot, *("" if np.isnan(v) else str(v) for v in values)]))
    return lines
