"""Simplification that provably keeps what a tree does, in every situation that can be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from coevo.tree.functions import FunctionSet, Situations
from coevo.tree.situations import condition_groups
from coevo.tree.text import Tree

__all__ = ["kept_nodes", "simplify"]


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
    return Tree(tuple(tree.names[node] for node in kept_nodes(tree, functions)))


def kept_nodes(tree: Tree, functions: FunctionSet | None = None) -> list[int]:
    """Return which nodes of a tree ``simplify`` leaves, in prefix order: they are the simplified tree."""
    groups, number = condition_groups(tree.names, functions)
    return _kept(tree, number, groups)


def _kept(tree: Tree, number: Mapping[str, int], groups: Sequence[Situations]) -> list[int]:
    """Return the nodes of the simplified tree.

    Trees may be deeper than Python's stack, so branches wait on a stack of this function: to be looked at with what
    each group of conditions can still be, or, as the node of a question, for their two halves to be done.
    """
    waiting: list[tuple[int, Mapping[int, Situations]] | int] = [(0, {})]
    done: list[list[int]] = []
    while waiting:
        item = waiting.pop()
        if isinstance(item, int):
            right, left = done.pop(), done.pop()
            same = [tree.names[node] for node in left] == [tree.names[node] for node in right]
            done.append(left if same else [item, *left, *right])
            continue
        at, known = item
        name = tree.names[at]
        if not tree.second[at]:
            done.append([at])
            continue
        group = number[name]
        possible = known.get(group, groups[group])
        yes = tuple(situation for situation in possible if name in situation)
        no = tuple(situation for situation in possible if name not in situation)
        first, second = at + 1, tree.second[at]
        if not no:
            waiting.append((first, known))
        elif not yes:
            waiting.append((second, known))
        else:
            waiting += [at, (second, {**known, group: no}), (first, {**known, group: yes})]
    return done[0]
