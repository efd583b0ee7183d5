"""How much the trees of a population differ."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from coevo.tree import FunctionSet, compile_program

__all__ = ["distinct_trees", "evenness", "top_of"]

_TOP = 3  # levels of nodes that are the top of a tree


def distinct_trees(trees: Sequence[NDArray[np.uint8]]) -> float:
    """Return the share of trees that are different, from 1 / population to 1.

    Args:
        trees: (nodes,) codes in prefix order, each.

    Example:
        >>> import numpy as np
        >>> from analysis.diversity import distinct_trees
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
        >>> from analysis.diversity import evenness
        >>> evenness([(0,), (1,), (2,), (3,)]), evenness([(0,), (0,)]), evenness([(0,), (0,), (1,), (1,)])
        (1.0, 0.0, 0.5)
    """
    shares = np.array(list(Counter(tops).values())) / len(tops)
    return abs(float(-(shares * np.log(shares)).sum() / np.log(len(tops)))) if len(tops) > 1 else 0.0
