"""Folding by use: every node and every step is in exactly one part, and no part says more than was counted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coevo.tree import Tree, parse
from coevo.tree.fold import fold_tree

trees = st.from_type(Tree)
shares = st.sampled_from([0.0, 0.005, 0.05, 0.3, 1.0])
seeds = st.integers(0, 2**32 - 1)


def branch_of(tree, node):
    """Return the nodes of a branch by walking it."""
    waiting, found = [node], []
    while waiting:
        at = waiting.pop()
        found.append(at)
        if tree.second[at]:
            waiting += [at + 1, tree.second[at]]
    return found


def used_in(tree, steps, node):
    """Return the steps by terminal of a branch."""
    use = {}
    for at in branch_of(tree, node):
        if not tree.second[at] and steps[at]:
            use[tree.names[at]] = use.get(tree.names[at], 0) + int(steps[at])
    return use


@given(tree=trees)
def test_without_counts_every_node_is_a_part_of_its_own(tree):
    parts = fold_tree(tree)
    assert [part.node for part in parts] == list(range(tree.nodes))
    assert [part.name for part in parts] == list(tree.names)
    assert [part.depth for part in parts] == list(tree.depths)
    assert {(part.nodes, part.steps) for part in parts} == {(1, None)}
    for part in parts[1:]:
        above = parts[part.parent].node
        assert part.node == (above + 1 if part.answer == "yes" else tree.second[above])
    assert fold_tree(tree, np.zeros(tree.nodes, np.int64)) == parts


@given(tree=trees, seed=seeds)
def test_nothing_is_folded_if_one_says_so(tree, seed, walk):
    steps = walk(tree, 50, seed)
    parts = fold_tree(tree, steps, None)
    assert [part.node for part in parts] == list(range(tree.nodes))
    assert [part.steps for part in parts] == steps.tolist()


@given(tree=trees, seed=seeds, share=shares)
def test_nodes_and_steps_add_up(tree, seed, share, walk):
    steps = walk(tree, 50, seed)
    parts = fold_tree(tree, steps, share)
    covered = [
        node for part in parts for node in ([part.node] if part.kind == "question" else branch_of(tree, part.node))
    ]
    assert sorted(covered) == list(range(tree.nodes))
    assert sum(part.nodes for part in parts) == tree.nodes
    assert sum(part.steps for part in parts if part.kind != "question") == steps[0]
    for number, part in enumerate(parts):
        assert part.steps == steps[part.node]
        below = [other for other in parts if other.parent == number]
        assert [other.answer for other in below] == (["yes", "no"] if part.kind == "question" else [])
        if below:
            assert sum(other.steps for other in below) == part.steps


@given(tree=trees, seed=seeds, share=shares)
def test_a_part_is_what_it_says(tree, seed, share, walk):
    steps = walk(tree, 50, seed)
    parts = fold_tree(tree, steps, share)
    for number, part in enumerate(parts):
        use = used_in(tree, steps, part.node)
        leaf = not tree.second[part.node]
        if part.kind == "terminal":
            assert leaf
        elif part.kind == "unused":
            assert not use
        elif part.kind == "same":
            assert use == {part.name: part.steps}
        elif part.kind == "rare":
            assert 0 < part.steps < share * steps[0]
            assert dict(part.use) == use
            assert [count for _, count in part.use] == sorted(use.values(), reverse=True)
        else:  # shown because it decided something, often enough
            assert len(use) > 1
            assert number == 0 or part.steps >= share * steps[0]


@pytest.mark.parametrize(("nodes", "depth"), [(1001, 17), (1001, 30), (3001, 30)])
def test_a_large_tree_comes_to_a_page(nodes, depth, grow, walk):
    for seed in range(5):
        tree = grow(nodes, depth, seed)
        assert (tree.nodes, tree.depth <= depth) == (nodes, True)
        parts = fold_tree(tree, walk(tree, 5000, seed))
        # A question that is shown has at least 1 in 200 of the steps, and on each level there are 200 of these at most.
        assert len(parts) < 150


def test_a_chain_of_any_length_is_folded(chain):
    tree = chain(3000)
    steps = np.array([7] + [0] * (tree.nodes - 1))
    steps[1] = 7
    parts = fold_tree(tree, steps)
    assert [(part.kind, part.name, part.nodes) for part in parts] == [("same", "shoot", 6001)]


def test_a_leaf_keeps_its_name_however_rarely_it_was_used():
    parts = fold_tree(parse("IF_ball_is_lost(search, shoot)"), [10_000, 1, 9999])
    assert [(part.kind, part.name) for part in parts[1:]] == [("terminal", "search"), ("terminal", "shoot")]
