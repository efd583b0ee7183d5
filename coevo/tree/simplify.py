"""Simplification that provably keeps what a tree does, in every situation that can be."""

from __future__ import annotations

from collections.abc import Mapping

from coevo.tree.functions import FunctionSet, Situations
from coevo.tree.text import Tree
from coevo.vocabulary import CATEGORIES, PREFIX, is_standard

__all__ = ["object_situations", "simplify"]


def object_situations(thing: str) -> Situations:
    """Return what can be seen of an object, in words of Table 6.1: it is lost, or in one place with one size."""
    sights = [("lost",), *((place, size) for place in CATEGORIES[:3] for size in CATEGORIES[3:6])]
    return tuple(frozenset(f"{PREFIX}{thing}_is_{category}" for category in sight) for sight in sights)


def simplify(tree: Tree, functions: FunctionSet | None = None) -> Tree:
    """Return a smaller tree with the same terminal in every situation.

    A branch is taken out when its condition is already decided by the conditions above it (an object that is
    lost is not left; one that is neither small nor medium, and is visible, is large), or when both of its branches
    are the same.

    Args:
        tree: any tree.
        functions: says which conditions depend on each other; without it they are those of Table 6.1. Every other
            condition is a question of its own, decided where it is asked again below itself.

    Example:
        >>> from coevo.tree import parse, simplify
        >>> print(simplify(parse("IF_ball_is_lost(IF_ball_is_left(shoot, search), avoid)")))
        IF_ball_is_lost(search, avoid)
    """
    if functions is not None:
        groups = functions.situations
    else:
        asked = {
            name[len(PREFIX) :].rsplit("_is_", 1)[0] for name in tree.names if "_is_" in name and is_standard(name)
        }
        groups = tuple(object_situations(thing) for thing in sorted(asked))
    number = {name: n for n, group in enumerate(groups) for situation in group for name in situation}
    alone = sorted({name for name in tree.names if name.startswith(PREFIX)} - number.keys())
    groups += tuple((frozenset({name}), frozenset[str]()) for name in alone)
    number |= {name: len(groups) - len(alone) + n for n, name in enumerate(alone)}
    return Tree(tuple(_simplify(tree, 0, number, dict(enumerate(groups)))))


def _simplify(tree: Tree, at: int, number: Mapping[str, int], known: Mapping[int, Situations]) -> list[str]:
    """Return the names of a branch, where ``known`` holds what each group of conditions can still be."""
    name = tree.names[at]
    if not tree.second[at]:
        return [name]
    group = number[name]
    yes = tuple(situation for situation in known[group] if name in situation)
    no = tuple(situation for situation in known[group] if name not in situation)
    first, second = at + 1, tree.second[at]
    if not no:
        return _simplify(tree, first, number, known)
    if not yes:
        return _simplify(tree, second, number, known)
    left = _simplify(tree, first, number, {**known, group: yes})
    right = _simplify(tree, second, number, {**known, group: no})
    if left == right:
        return left
    return [name, *left, *right]
