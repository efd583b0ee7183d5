"""Small trees: all of them, once each, by what they do in every situation."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.baselines import behaviour, distinct, neighbours, small_trees
from coevo.game.functions import function_set
from coevo.tree import FunctionSet, Tree, parse, simplify

ROLE = function_set(0, 2)
# Two conditions of one thing, of which just one holds at a time, and one beside them.
SMALL = FunctionSet(
    ("IF_day", "IF_night", "IF_rain"), ("go", "stay"), ((frozenset({"IF_day"}), frozenset({"IF_night"})),)
)


def chooses(tree, true):
    node = 0
    while tree.second[node]:
        node = node + 1 if tree.names[node] in true else tree.second[node]
    return tree.names[node]


def does(tree):
    """Return what a tree of ``SMALL`` chooses in all four situations, by looking."""
    return tuple(chooses(tree, {time, *rain}) for time in ("IF_day", "IF_night") for rain in ((), ("IF_rain",)))


def every_tree(depth):
    leaves = [Tree((name,)) for name in SMALL.terminals]
    if depth == 0:
        return leaves
    below = every_tree(depth - 1)
    asked = itertools.product(SMALL.functions, below, below)
    return [*below, *(Tree((name, *yes.names, *no.names)) for name, yes, no in asked)]


@pytest.mark.parametrize("depth", [0, 1, 2])
def test_all_behaviours_are_there_once(depth):
    found = small_trees(SMALL, depth)
    assert sorted(map(does, found)) == sorted({does(tree) for tree in every_tree(depth)})


def test_those_of_depth_1_are_terminals_and_questions_with_two_answers():
    found = small_trees(ROLE)
    assert len(found) == 4 + 28 * 4 * 3
    assert {tree.depth for tree in found[4:]} == {1}
    assert all(tree.names[1] != tree.names[2] for tree in found[4:])


def test_of_too_many_there_are_as_many_as_allowed_and_every_terminal():
    found = small_trees(ROLE, 2, 500)
    assert len(found) == 500
    assert [tree.names for tree in found[:4]] == [(name,) for name in ROLE.terminals]
    assert len({behaviour(tree, ROLE) for tree in found}) == 500
    assert {tree.depth for tree in found} == {0, 1, 2}
    assert small_trees(ROLE, 2, 500) == found != small_trees(ROLE, 2, 500, seed=1)
    few = small_trees(ROLE, 1, 50)
    assert len(few) == 50
    assert set(few) <= set(small_trees(ROLE))


def trees_of(depth):
    leaves = st.sampled_from(ROLE.terminals[:2]).map(lambda name: (name,))
    asked = st.sampled_from([*ROLE.functions[:3], ROLE.functions[6], ROLE.functions[-1]])  # few, so that some are alike
    return st.recursive(leaves, lambda b: st.builds(lambda q, x, y: (q, *x, *y), asked, b, b), max_leaves=depth).map(
        Tree
    )


@given(trees_of(6), trees_of(6))
def test_equal_behaviour_is_equal_choice_in_every_situation(situations, one, two):
    things = one.objects() | two.objects()
    alike = all(chooses(one, true) == chooses(two, true) for true in situations(things))
    assert (behaviour(one, ROLE) == behaviour(two, ROLE)) == alike
    assert behaviour(one, ROLE) == behaviour(simplify(one, ROLE), ROLE)


def test_conditions_that_depend_on_no_other_are_told_apart_by_their_names():
    alone = FunctionSet(("IF_a", "IF_b"), ("x", "y"))
    one, two, three = (parse(text, alone) for text in ("IF_a(x, y)", "IF_b(x, y)", "IF_b(IF_a(x, x), IF_a(y, y))"))
    assert distinct([one, two, three], alone) == [one, two]


def edits(tree):
    """Return all trees that are one change away, written anew over nested lists."""

    def of(node):
        if isinstance(node, str):
            yield from ROLE.terminals
            for name, other in itertools.product(ROLE.functions, ROLE.terminals):
                yield (name, node, other)
                yield (name, other, node)
            return
        name, yes, no = node
        yield yes
        yield no
        yield from ((other, yes, no) for other in ROLE.functions)
        yield from ((name, changed, no) for changed in of(yes))
        yield from ((name, yes, changed) for changed in of(no))

    def flat(node):
        return (node,) if isinstance(node, str) else (node[0], *flat(node[1]), *flat(node[2]))

    for name, other in itertools.product(ROLE.functions, ROLE.terminals):
        yield Tree(flat((name, tree, other)))
        yield Tree(flat((name, other, tree)))
    yield from (Tree(flat(changed)) for changed in of(tree))


@pytest.mark.parametrize("text", ["shoot", "IF_ball_is_lost(search, IF_r1_is_left(pass, shoot))"])
def test_neighbours_are_all_that_one_change_makes(text, nested):
    tree = parse(text)
    expected = {behaviour(one, ROLE) for one in edits(nested(tree)) if one.depth <= 2} - {behaviour(tree, ROLE)}
    found = neighbours(tree, ROLE, 2)
    assert {behaviour(one, ROLE) for one in found} == expected
    assert len(found) == len(expected)
    assert max(one.depth for one in found) <= 2
