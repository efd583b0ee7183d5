"""Simplification that provably keeps what a tree does, in every situation that can be seen."""

from __future__ import annotations

from coevo.tree.functions import CATEGORIES
from coevo.tree.text import Tree

__all__ = ["simplify"]

# What can be true of one object at a time: it is lost, or one of three positions with one of three sizes.
_SIGHTS = frozenset({("lost", "lost")} | {(p, s) for p in CATEGORIES[:3] for s in CATEGORIES[3:6]})
_Sights = frozenset[tuple[str, str]]


def simplify(tree: Tree) -> Tree:
    """Return a smaller tree with the same skill in every situation.

    A branch is taken out when its condition is already decided by the conditions above it (an object that is
    lost is not left; one that is neither small nor medium, and is visible, is large), or when both of its branches
    are the same.
    """
    return Tree(tuple(_simplify(tree, 0, {})))


def _simplify(tree: Tree, at: int, known: dict[str, _Sights]) -> list[str]:
    name = tree.names[at]
    if not name.startswith("IF_"):
        return [name]
    thing, category = name[3:].rsplit("_is_", 1)
    sights = known.get(thing, _SIGHTS)
    yes = frozenset(sight for sight in sights if category in sight)
    no = sights - yes
    first, second = at + 1, tree.second[at]
    if not no:
        return _simplify(tree, first, known)
    if not yes:
        return _simplify(tree, second, known)
    left = _simplify(tree, first, {**known, thing: yes})
    right = _simplify(tree, second, {**known, thing: no})
    if left == right:
        return left
    return [name, *left, *right]
