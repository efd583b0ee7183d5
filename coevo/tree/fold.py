"""Fold a tree by how it was used, so that a large one can be read: what never mattered becomes one part."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from coevo.tree.nodes import Nodes

__all__ = ["FOLD", "Part", "Steps", "fold_tree"]

# How often each node of a tree was passed, (nodes,).
Steps = Sequence[int] | NDArray[np.int64]

FOLD = 0.005  # share of all steps; a branch that carried less is folded unless one says otherwise


@dataclass(frozen=True)
class Part:
    """A node of a tree as it is shown, or a branch that is shown as one.

    Attributes:
        kind: a ``question`` or a ``terminal`` is one node. A branch is ``unused`` if no step passed it, ``same`` if all
            steps that did came to one terminal, ``rare`` if few steps passed it.
        node: the node's number in the tree, or of a branch its root's.
        name: the name of that node; of ``same`` the terminal's.
        parent: place of its question among the parts, -1 for the first.
        answer: ``yes`` or ``no``, the answer of that question that leads here; empty for the first.
        depth: of the node in the tree.
        nodes: how many nodes of the tree it stands for.
        steps: how many passed; None if nothing was counted.
        use: steps by terminal, most first; only of ``rare``.
    """

    kind: Literal["question", "terminal", "unused", "same", "rare"]
    node: int
    name: str
    parent: int
    answer: str
    depth: int
    nodes: int
    steps: int | None
    use: tuple[tuple[str, int], ...] = ()


def fold_tree(tree: Nodes, steps: Steps | None = None, share: float | None = FOLD) -> tuple[Part, ...]:
    """Return the parts of a tree in prefix order.

    Args:
        tree: any tree.
        steps: (nodes,) how often each node was passed; without it, or if nothing was counted, all nodes are shown.
        share: branches below this share of all steps are folded; None shows all nodes.

    Example:
        >>> from coevo.tree import parse
        >>> tree = parse("IF_ball_is_lost(IF_ball_is_left(shoot, IF_r1_is_left(avoid, search)), shoot)")
        >>> [(part.kind, part.nodes, part.steps) for part in fold_tree(tree, [10, 0, 0, 0, 0, 0, 10])]
        [('same', 7, 10)]
        >>> [(part.kind, part.nodes, part.steps) for part in fold_tree(tree, [10, 7, 0, 7, 1, 6, 3])]
        [('question', 1, 10), ('question', 1, 7), ('terminal', 1, 0), ('question', 1, 7), ('terminal', 1, 1), \
('terminal', 1, 6), ('terminal', 1, 3)]
    """
    counted = steps is not None and int(steps[0]) > 0
    uses, sizes = _branches(tree, steps if counted else None)
    parts: list[Part] = []
    stack = [(0, -1, "")]
    while stack:
        node, parent, answer = stack.pop()
        passed = int(steps[node]) if steps is not None and counted else None
        of_all = (tree.names[node], parent, answer, tree.depths[node])
        if not tree.second[node]:
            parts.append(Part("terminal", node, *of_all, 1, passed))
        elif passed is None or steps is None or share is None:
            parts.append(Part("question", node, *of_all, 1, passed))
        elif passed == 0:
            parts.append(Part("unused", node, *of_all, sizes[node], passed))
        elif len(uses[node]) == 1:
            (terminal,) = uses[node]
            parts.append(Part("same", node, terminal, *of_all[1:], sizes[node], passed))
        elif parent >= 0 and passed < share * int(steps[0]):
            use = tuple(sorted(uses[node].items(), key=lambda item: (-item[1], item[0])))
            parts.append(Part("rare", node, *of_all, sizes[node], passed, use))
        else:
            parts.append(Part("question", node, *of_all, 1, passed))
        if parts[-1].kind == "question":
            here = len(parts) - 1
            stack += [(tree.second[node], here, "no"), (node + 1, here, "yes")]
    return tuple(parts)


def _branches(tree: Nodes, steps: Steps | None) -> tuple[list[Counter[str]], list[int]]:
    """Return for each node the steps by terminal that its branch was used for, and how many nodes that has."""
    uses: list[Counter[str]] = [Counter() for _ in tree.names]
    sizes = [1] * tree.nodes
    for node in range(tree.nodes - 1, -1, -1):
        second = tree.second[node]
        if second:
            sizes[node] += sizes[node + 1] + sizes[second]
            uses[node] = uses[node + 1] + uses[second]
        elif steps is not None and steps[node]:
            uses[node][tree.names[node]] = int(steps[node])
    return uses, sizes
