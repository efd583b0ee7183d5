"""Rules: in every situation exactly one holds, and it is the tree's; none says more than it has to."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coevo.game import function_set
from coevo.tree import FunctionSet, Tree, parse, simplify
from coevo.tree.rules import in_words, leaf_rules, question

# Six exclusive words and none, two that overlap, and two questions of their own: 7 x 3 x 2 x 2 situations.
COLOURS = tuple(f"IF_light_is_{colour}" for colour in ("red", "amber", "green", "blue", "white", "off"))
WEATHER = ("IF_wet", "IF_storm")
OWN = FunctionSet(
    (*COLOURS, *WEATHER, "IF_dark", "IF_tired"),
    ("go", "stay", "turn"),
    (
        (frozenset(), *(frozenset({name}) for name in COLOURS)),
        (frozenset(), frozenset({"IF_wet"}), frozenset(WEATHER)),  # a storm is wet
    ),
)
SITUATIONS = [
    frozenset().union(*parts)
    for parts in product(*OWN.situations, *((frozenset(), frozenset({name})) for name in ("IF_dark", "IF_tired")))
]

own_trees = st.recursive(
    st.sampled_from(OWN.terminals).map(lambda name: (name,)),
    lambda branches: st.builds(
        lambda name, yes, no: (name, *yes, *no), st.sampled_from(OWN.functions), branches, branches
    ),
    max_leaves=40,
).map(Tree)


def leaf_of(tree, true):
    at = 0
    while tree.second[at]:
        at = at + 1 if tree.names[at] in true else tree.second[at]
    return at


@given(tree=own_trees)
def test_in_every_situation_one_rule_holds_and_it_is_the_trees(tree):
    for one in (tree, simplify(tree, OWN)):
        rules = leaf_rules(one, OWN)
        for true in SITUATIONS:
            (rule,) = [rule for rule in rules if rule.holds(true)]
            assert rule.leaf == leaf_of(one, true)
            assert rule.terminal == tree.names[leaf_of(tree, true)]


@given(tree=own_trees)
def test_there_is_a_rule_for_each_leaf_that_some_situation_reaches(tree):
    assert sorted(rule.leaf for rule in leaf_rules(tree, OWN)) == sorted({leaf_of(tree, true) for true in SITUATIONS})


@given(tree=own_trees)
def test_no_rule_has_a_condition_too_many(tree):
    for rule in leaf_rules(tree, OWN):
        fits = {true for true in SITUATIONS if rule.holds(true)}
        for left_out in rule.conditions:
            rest = [one for one in rule.conditions if one != left_out]
            assert {true for true in SITUATIONS if all((n in true) == a for n, a in rest)} > fits


@settings(max_examples=40)
@given(tree=st.from_type(Tree))
def test_rules_of_table_6_1_hold_where_the_tree_decides_so(tree, situations):
    kept = sorted(tree.objects())[:3]
    names = [
        name if not name.startswith("IF_") else f"IF_{kept[len(name) % len(kept)]}_is_{name.rsplit('_is_', 1)[1]}"
        for name in tree.names
    ]
    smaller = simplify(Tree(tuple(names)))
    rules = leaf_rules(smaller, function_set(0, 3))
    assert [(rule.leaf, rule.conditions) for rule in rules] == [
        (rule.leaf, rule.conditions) for rule in leaf_rules(smaller)
    ]
    for true in situations(smaller.objects()):
        assert [rule.leaf for rule in rules if rule.holds(true)] == [leaf_of(smaller, true)]


@given(tree=own_trees, seed=st.integers(0, 2**32 - 1))
def test_shares_of_rules_are_those_of_the_situations_they_hold_in(tree, seed):
    times = np.random.default_rng(seed).integers(0, 5, len(SITUATIONS))
    steps = np.zeros(tree.nodes, np.int64)
    for true, count in zip(SITUATIONS, times, strict=True):
        steps[leaf_of(tree, true)] += count
    for node in range(tree.nodes - 1, -1, -1):
        if tree.second[node]:
            steps[node] = steps[node + 1] + steps[tree.second[node]]
    rules = leaf_rules(tree, OWN, steps)
    for rule in rules:
        held = sum(int(count) for true, count in zip(SITUATIONS, times, strict=True) if rule.holds(true))
        assert rule.steps == held
        assert rule.share == pytest.approx(held / times.sum())
    assert sum(rule.share for rule in rules) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("tree", "said"),
    [
        pytest.param("shoot", ["always"], id="no question"),
        pytest.param(
            "IF_ball_is_lost(search, IF_ball_is_left(pass, IF_ball_is_right(avoid, shoot)))",
            ["ball is lost", "ball is left", "ball is right", "ball is middle"],
            id="what is left is named",
        ),
        pytest.param(
            "IF_ball_is_left(IF_ball_is_small(shoot, pass), IF_ball_is_lost(search, avoid))",
            ["ball is left and small", "ball is left and not small", "ball is lost", "ball is not left and not lost"],
            id="of one thing",
        ),
        pytest.param(
            "IF_ball_is_left(IF_own_goal_is_large(IF_r1_is_lost(shoot, pass), search), avoid)",
            [
                "ball is left, own goal is large and r1 is lost",
                "ball is left, own goal is large and r1 is not lost",
                "ball is left and own goal is not large",
                "ball is not left",
            ],
            id="of several",
        ),
    ],
)
def test_conditions_in_words(tree, said):
    assert [rule.when for rule in leaf_rules(parse(tree))] == said


def test_conditions_of_ones_own_in_words():
    assert in_words([("IF_sees_food", True), ("IF_light_is_red", False)]) == "sees food and light is not red"
    assert in_words([("IF_dark", False)]) == "not dark"
    assert [question(name) for name in ("IF_own_goal_is_left", "IF_sees_food", "stay")] == [
        "own goal is left?",
        "sees food?",
        "stay",
    ]


def test_many_words_of_one_group_are_told_by_what_is_common():
    words = tuple(f"IF_n{number}" for number in range(40))
    functions = FunctionSet(words, ("a", "b"), (tuple(frozenset({word}) for word in words),))
    tree = parse("IF_n0(a, IF_n1(a, IF_n2(a, b)))", functions)
    rules = leaf_rules(tree, functions)
    assert rules[0].conditions == (("IF_n0", True),)
    assert rules[-1].conditions == (("IF_n0", False), ("IF_n1", False), ("IF_n2", False))


def test_rules_of_large_and_deep_trees(grow, chain):
    tree = simplify(grow(3001, 30))
    assert len(leaf_rules(tree)) == (tree.nodes + 1) // 2
    deep = chain(3000)
    assert len(leaf_rules(simplify(deep))) == (simplify(deep).nodes + 1) // 2
    own = FunctionSet(tuple(f"IF_c{n}" for n in range(250)), ("a", "b"))
    long = Tree((*(name for n in range(250) for name in (f"IF_c{n}", "a")), "b"))
    assert len(leaf_rules(long, own)[-1].conditions) == 250
