"""Small trees of a role: all of them, those near a given one, and which of them do the same."""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Iterable, Iterator, Sequence

from coevo.seeds import RunStream, generator
from coevo.tree import FunctionSet, Situations, Tree
from coevo.tree.situations import condition_groups

__all__ = ["behaviour", "distinct", "neighbours", "small_trees"]

_TRIES = 20  # for each tree that is drawn, before it is believed that there are no others


def behaviour(tree: Tree, functions: FunctionSet) -> Hashable:
    """Return what a tree does: equal for two trees if and only if they choose alike in every situation.

    It is the tree's decision diagram over the groups of situations in their order, without questions that change
    nothing (R. E. Bryant, "Graph-based algorithms for Boolean function manipulation", IEEE Transactions on Computers
    35, 1986): there is one such diagram for each function.

    Args:
        tree: any small tree; the time grows with the number of its different branches.
        functions: what it is made of; says which conditions depend on each other.

    Example:
        >>> from analysis.baselines.trees import behaviour
        >>> from coevo.game import SoccerGame
        >>> from coevo.recipes import read_experiment
        >>> from coevo.tree import parse
        >>> functions = SoccerGame(read_experiment("two-learners")).function_set(0)
        >>> first = parse("IF_ball_is_lost(search, IF_r1_is_lost(shoot, pass))")
        >>> second = parse("IF_r1_is_lost(IF_ball_is_lost(search, shoot), IF_ball_is_lost(search, pass))")
        >>> behaviour(first, functions) == behaviour(second, functions)
        True
    """
    groups, number = condition_groups(tree.names, functions)
    asked = {number[name] for name in tree.names if name in number}
    labels = {at: ("", at) for at in asked if at < len(functions.situations)}
    labels |= {number[name]: (name, 0) for name in tree.names if number.get(name, -1) >= len(functions.situations)}
    order = sorted(asked, key=lambda at: labels[at])
    return _diagram(tree.names, order, groups, number, labels)


def _diagram(
    names: tuple[str, ...],
    order: Sequence[int],
    groups: Sequence[Situations],
    number: dict[str, int],
    labels: dict[int, tuple[str, int]],
) -> Hashable:
    if not order:
        return names[0]
    known: dict[tuple[str, ...], Hashable] = {}
    found = []
    for situation in groups[order[0]]:
        left = _answered(Tree(names), order[0], situation, number)
        if left not in known:
            known[left] = _diagram(left, order[1:], groups, number, labels)
        found.append(known[left])
    return found[0] if len(set(found)) == 1 else (labels[order[0]], tuple(found))


def _answered(tree: Tree, group: int, situation: frozenset[str], number: dict[str, int]) -> tuple[str, ...]:
    """Return the names of what is left of a tree where the questions of one group are answered."""
    left: list[str] = []
    waiting = [0]
    while waiting:
        node = waiting.pop()
        while number.get(tree.names[node]) == group:
            node = node + 1 if tree.names[node] in situation else tree.second[node]
        left.append(tree.names[node])
        if tree.second[node]:
            waiting += [tree.second[node], node + 1]
    return tuple(left)


def distinct(trees: Iterable[Tree], functions: FunctionSet) -> list[Tree]:
    """Return the trees that do not do the same as an earlier one."""
    return list({behaviour(tree, functions): tree for tree in reversed(list(trees))}.values())[::-1]


def small_trees(functions: FunctionSet, depth: int = 1, limit: int | None = None, *, seed: int = 0) -> list[Tree]:
    """Return small trees of a role, each behaviour once, by a tree as shallow as possible.

    Args:
        functions: what they are made of.
        depth: the deepest; of 0 the terminals, of 1 those and ``IF_a_is_b(s1, s2)``, of 2 questions over both.
        limit: how many at most; without it all, of which there are millions from depth 2 on in soccer. If there are
            more, all terminals and a sample of the deeper trees, the shallower first.
        seed: of the sample.

    Example:
        >>> from analysis.baselines import small_trees
        >>> from coevo.game import SoccerGame
        >>> from coevo.recipes import read_experiment
        >>> functions = SoccerGame(read_experiment("two-learners")).function_set(0)
        >>> trees = small_trees(functions)
        >>> len(trees) == 4 + 28 * 4 * 3
        True
        >>> [str(tree) for tree in trees[3:5]]
        ['search', 'IF_ball_is_left(shoot, pass)']
    """
    found = {behaviour(tree, functions): tree for tree in (Tree((name,)) for name in functions.terminals)}
    most = float("inf") if limit is None else max(limit, len(found))
    for _ in range(depth):
        below = list(found.values())
        room = most - len(found)
        is_drawn = len(functions.functions) * len(below) ** 2 > _TRIES * most
        fresh: dict[Hashable, Tree] = {}
        for tree in _some_over(functions, below, room, seed) if is_drawn else _all_over(functions, below):
            does = behaviour(tree, functions)
            if does not in found:
                fresh.setdefault(does, tree)
            if is_drawn and len(fresh) >= room:
                break
        chosen = list(fresh.items())
        if len(chosen) > room:
            drawn = generator(seed, RunStream.SMALL_TREES, len(below)).permutation(len(chosen))[: int(room)]
            chosen = [chosen[k] for k in sorted(drawn.tolist())]
        found |= dict(chosen)
        if len(found) >= most:
            break
    return list(found.values())


def _all_over(functions: FunctionSet, below: Sequence[Tree]) -> Iterator[Tree]:
    for name in functions.functions:
        for yes, no in itertools.permutations(below, 2):
            yield Tree((name, *yes.names, *no.names))


def _some_over(functions: FunctionSet, below: Sequence[Tree], room: float, seed: int) -> Iterator[Tree]:
    random = generator(seed, RunStream.SMALL_TREES, len(below), 1)
    for _ in range(_TRIES * int(room)):
        yes, no = (below[k].names for k in random.choice(len(below), 2, replace=False).tolist())
        yield Tree((functions.functions[int(random.integers(len(functions.functions)))], *yes, *no))


def neighbours(tree: Tree, functions: FunctionSet, depth: int) -> list[Tree]:
    """Return the trees that are one change away from a tree, each behaviour once and none that does the same.

    A change puts another terminal or condition in a node's place, puts a question above a leaf or above the whole tree
    with a terminal on its other side, or puts a branch in the place of the question above it.

    Args:
        tree: any small tree.
        functions: what trees are made of.
        depth: of the deepest that is returned.
    """
    found = {behaviour(tree, functions): tree}
    for changed in _changed(tree, functions):
        if changed.depth <= depth:
            found.setdefault(behaviour(changed, functions), changed)
    return list(found.values())[1:]


def _changed(tree: Tree, functions: FunctionSet) -> Iterator[Tree]:
    names = tree.names
    for node, name in enumerate(names):
        second = tree.second[node]
        if second:
            end = _end(tree, node)
            yield Tree((*names[:node], *names[node + 1 : second], *names[end:]))
            yield Tree((*names[:node], *names[second:end], *names[end:]))
            for other in functions.functions:
                yield Tree((*names[:node], other, *names[node + 1 :]))
        else:
            for other in functions.terminals:
                yield Tree((*names[:node], other, *names[node + 1 :]))
        if not second or node == 0:
            inside = names if node == 0 else (name,)
            after = () if node == 0 else names[node + 1 :]
            for condition, terminal in itertools.product(functions.functions, functions.terminals):
                yield Tree((*names[:node], condition, terminal, *inside, *after))
                yield Tree((*names[:node], condition, *inside, terminal, *after))


def _end(tree: Tree, node: int) -> int:
    """Return where the branch that begins at a node ends."""
    waiting = 1
    while waiting:
        waiting += 1 if tree.second[node] else -1
        node += 1
    return node
