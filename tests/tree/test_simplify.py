"""Simplification: exhaustively the same skill in every situation, never larger, and counts that stay true."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coevo.game import function_set
from coevo.tree import FunctionSet, Tree, parse, simplify
from coevo.usage import merge_usage

few = settings(max_examples=60)  # each looks at up to 100,000 situations


@st.composite
def trees_of_few_objects(draw):
    """Draw a tree that asks about at most three objects, so that all situations can be looked at."""
    tree = draw(st.from_type(Tree))
    kept = sorted(tree.objects())[:3]
    renamed = []
    for name in tree.names:
        thing = name[3:].rsplit("_is_", 1)[0]
        renamed.append(name.replace(thing, kept[len(thing) % len(kept)]) if name.startswith("IF_") else name)
    return Tree(tuple(renamed))


trees = trees_of_few_objects()


def decide(node, true):
    while not isinstance(node, str):
        node = node[1] if node[0] in true else node[2]
    return node


def passed(tree, true):
    """Yield the nodes that a situation passes on its way to a skill."""
    at = 0
    yield at
    while tree.second[at]:
        at = at + 1 if tree.names[at] in true else tree.second[at]
        yield at


@few
@given(tree=trees)
def test_the_skill_is_the_same_in_every_situation(tree, nested, situations):
    before, after = nested(tree), nested(simplify(tree))
    for true in situations(tree.objects()):
        assert decide(before, true) == decide(after, true)


@given(tree=st.from_type(Tree))
def test_a_simplified_tree_is_not_larger_and_stays_as_it_is(tree):
    smaller = simplify(tree)
    assert smaller.nodes <= tree.nodes
    assert smaller.depth <= tree.depth
    assert smaller.objects() <= tree.objects()
    assert simplify(smaller) == smaller


@few
@given(tree=trees)
def test_every_branch_that_is_left_is_reached_by_some_situation(tree, situations):
    smaller = simplify(tree)
    reached = {node for true in situations(smaller.objects()) for node in passed(smaller, true)}
    assert reached == set(range(smaller.nodes))


@few
@given(tree=trees, seed=st.integers(0, 2**32 - 1))
def test_merged_counts_are_those_of_playing_with_the_simplified_tree(tree, seed, situations):
    rng = np.random.default_rng(seed)
    smaller = simplify(tree)
    before, after = np.zeros(tree.nodes, np.int64), np.zeros(smaller.nodes, np.int64)
    for true in situations(tree.objects()):
        times = int(rng.integers(0, 5))
        before[list(passed(tree, true))] += times
        after[list(passed(smaller, true))] += times
    assert merge_usage(tree, before, smaller).tolist() == after.tolist()


@pytest.mark.parametrize(
    ("tree", "smaller"),
    [
        pytest.param("IF_ball_is_left(shoot, shoot)", "shoot", id="both branches alike"),
        pytest.param(
            "IF_ball_is_lost(IF_ball_is_left(shoot, search), pass)", "IF_ball_is_lost(search, pass)", id="lost: nowhere"
        ),
        pytest.param(
            "IF_ball_is_left(IF_ball_is_right(shoot, search), pass)", "IF_ball_is_left(search, pass)", id="one place"
        ),
        pytest.param(
            "IF_ball_is_small(IF_ball_is_lost(shoot, search), pass)", "IF_ball_is_small(search, pass)", id="seen"
        ),
        pytest.param(
            "IF_ball_is_lost(search, IF_ball_is_small(shoot, IF_ball_is_medium(pass, IF_ball_is_large(avoid, shoot))))",
            "IF_ball_is_lost(search, IF_ball_is_small(shoot, IF_ball_is_medium(pass, avoid)))",
            id="the third size",
        ),
        pytest.param(
            "IF_ball_is_left(IF_ball_is_small(shoot, pass), pass)",
            "IF_ball_is_left(IF_ball_is_small(shoot, pass), pass)",
            id="nothing to take out",
        ),
        pytest.param(
            "IF_ball_is_left(IF_r1_is_right(IF_ball_is_left(shoot, pass), shoot), avoid)",
            "IF_ball_is_left(shoot, avoid)",
            id="twice, with another object between",
        ),
        pytest.param(
            "IF_own_goal_is_lost(IF_opponent_goal_is_left(pass, shoot), avoid)",
            "IF_own_goal_is_lost(IF_opponent_goal_is_left(pass, shoot), avoid)",
            id="the goals are two objects",
        ),
    ],
)
def test_worked_examples(tree, smaller):
    assert str(simplify(parse(tree))) == smaller


def test_conditions_of_ones_own_are_questions_of_their_own():
    functions = FunctionSet(("IF_ball_is_left", "IF_ball_is_near", "IF_dark"), ("go", "stay"))
    asked_again = "IF_ball_is_near(IF_dark(IF_ball_is_near(go, stay), stay), go)"
    assert str(simplify(parse(asked_again, functions), functions)) == "IF_ball_is_near(IF_dark(go, stay), go)"
    independent = parse("IF_ball_is_left(IF_ball_is_near(go, stay), stay)", functions)
    assert simplify(independent, functions) == independent


def test_what_excludes_each_other_is_said_by_the_function_set():
    """Two words that are standard in soccer and mean nothing here; and two of one's own that exclude each other."""
    words = ("IF_ball_is_left", "IF_ball_is_right", "IF_day", "IF_night")
    either = (frozenset({"IF_day"}), frozenset({"IF_night"}))
    functions = FunctionSet(words, ("go", "stay"), (either,))
    both = parse("IF_ball_is_left(IF_ball_is_right(go, stay), stay)", functions)
    assert simplify(both, functions) == both
    assert str(simplify(parse("IF_day(IF_night(go, stay), go)", functions), functions)) == "IF_day(stay, go)"
    assert str(simplify(parse("IF_day(go, IF_night(stay, go))", functions), functions)) == "IF_day(go, stay)"


def test_a_function_set_of_soccer_says_what_table_6_1_does():
    functions = function_set(0, 3)
    for text in (
        "IF_ball_is_lost(search, IF_ball_is_small(shoot, IF_ball_is_medium(pass, IF_ball_is_large(avoid, shoot))))",
        "IF_r1_is_left(IF_r1_is_lost(shoot, search), pass)",
    ):
        assert simplify(parse(text), functions) == simplify(parse(text)) != parse(text)
