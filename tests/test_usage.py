"""A tree with its use: what is left of it when what was never used is taken out, and what is told of it."""

from __future__ import annotations

import re
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coevo.errors import InputError
from coevo.portrait import portrait, questions
from coevo.skill import skill_description
from coevo.tree import FunctionSet, Tree, parse
from coevo.tree.draw import as_svg
from coevo.usage import TreeUsage, UsedTree, merge_usage, used_tree, without_unused
from coevo.vocabulary import SKILLS

# Three exclusive words, and two questions of their own: 3 x 2 x 2 situations.
FUNCTIONS = FunctionSet(
    ("IF_light_is_red", "IF_light_is_amber", "IF_light_is_green", "IF_dark", "IF_tired"),
    ("go", "stay", "turn"),
    (tuple(frozenset({f"IF_light_is_{colour}"}) for colour in ("red", "amber", "green")),),
    {"go": "drives on"},
)
SITUATIONS = [
    frozenset().union(*parts)
    for parts in product(*FUNCTIONS.situations, *((frozenset(), frozenset({name})) for name in ("IF_dark", "IF_tired")))
]
trees = st.recursive(
    st.sampled_from(FUNCTIONS.terminals).map(lambda name: (name,)),
    lambda branches: st.builds(
        lambda name, yes, no: (name, *yes, *no), st.sampled_from(FUNCTIONS.functions), branches, branches
    ),
    max_leaves=30,
).map(Tree)
times = st.lists(st.sampled_from([0, 0, 1, 7]), min_size=len(SITUATIONS), max_size=len(SITUATIONS)).filter(any)


def leaf_of(tree, true):
    at = 0
    while tree.second[at]:
        at = at + 1 if tree.names[at] in true else tree.second[at]
    return at


def after(tree, counts, *, rank=0, fitness=(3.0, 5.0, 10.0), games=20):
    """Return a tree that was used so often in each situation."""
    steps = np.zeros(tree.nodes, np.int64)
    for true, count in zip(SITUATIONS, counts, strict=True):
        steps[leaf_of(tree, true)] += count
    use = {
        name: sum(int(steps[n]) for n in range(tree.nodes) if tree.names[n] == name) / max(sum(counts), 1)
        for name in FUNCTIONS.terminals
    }
    for node in range(tree.nodes - 1, -1, -1):
        if tree.second[node]:
            steps[node] = steps[node + 1] + steps[tree.second[node]]
    usage = TreeUsage(steps, use, sum(counts))
    return UsedTree("r0", 9, rank, tree, usage, FUNCTIONS, games, fitness[rank], np.array(fitness))


def where(holds):
    """Return counts of situations: 10 where ``holds`` says so."""
    return [10 if holds(true) else 0 for true in SITUATIONS]


@given(tree=trees, counts=times)
def test_what_was_never_used_goes_and_nothing_else(tree, counts):
    used = after(tree, counts)
    kept, steps = without_unused(tree, used.usage.node_steps)
    assert (steps > 0).all()
    assert steps[0] == sum(counts)
    for node, second in enumerate(kept.second):
        if second:
            assert steps[node] == steps[node + 1] + steps[second]
    for true, count in zip(SITUATIONS, counts, strict=True):
        if count:
            assert kept.names[leaf_of(kept, true)] == tree.names[leaf_of(tree, true)]


@given(tree=trees, counts=times)
def test_rules_in_use_say_what_was_done_in_each_situation_that_came(tree, counts):
    used = after(tree, counts)
    held = dict.fromkeys(range(len(used.rules_in_use)), 0)
    for true, count in zip(SITUATIONS, counts, strict=True):
        if count:
            ((number, rule),) = [one for one in enumerate(used.rules_in_use) if one[1].holds(true)]
            assert rule.terminal == tree.names[leaf_of(tree, true)]
            held[number] += count
    assert [rule.steps for rule in used.rules_in_use] == list(held.values())
    assert list(held.values()) == sorted(held.values(), reverse=True)


@given(tree=trees, counts=times)
def test_rules_hold_in_every_situation_and_are_no_shorter_than_those_in_use(tree, counts):
    used = after(tree, counts)
    for true in SITUATIONS:
        (rule,) = [rule for rule in used.rules if rule.holds(true)]
        assert rule.terminal == tree.names[leaf_of(tree, true)]
    assert len(used.rules_in_use) <= len(used.rules)
    assert sum(rule.share for rule in used.rules) == pytest.approx(1.0)


@given(tree=trees, counts=times)
def test_the_questions_told_are_those_that_made_a_difference(tree, counts):
    used = after(tree, counts)
    done = {tree.names[leaf_of(tree, true)] for true, count in zip(SITUATIONS, counts, strict=True) if count}
    assert (len(questions(used)) == 0) == (len(done) == 1)
    assert len(set(questions(used))) == len(questions(used))


def test_a_game_that_does_what_its_function_set_excludes_is_told_so():
    tree = parse("IF_light_is_red(IF_light_is_amber(go, IF_dark(stay, turn)), stay)", FUNCTIONS)
    steps = np.array([3, 3, 3, 0, 0, 0, 0])
    used = after(tree, where(bool))
    with pytest.raises(
        InputError, match="where light is red and amber, which the situations of its function set exclude"
    ):
        merge_usage(tree, steps, used.simplified)


def told(used, unseen=""):
    return " ".join(portrait(used, unseen).split())


ROBOT = parse(
    "IF_dark(IF_tired(stay, IF_light_is_red(turn, IF_dark(turn, go))), IF_light_is_red(stay, IF_tired(go, go)))",
    FUNCTIONS,
)


def test_a_robot_in_words():
    counts = where(lambda true: "IF_dark" not in true)
    text = told(after(ROBOT, counts), unseen="coevo play here")
    assert text.startswith("r0 plays go 66.7% and stay 33.3% of the time, and never turn.")
    assert "It decides by one question: light is red? 7 of its 13 nodes were never used in its 20 games;" in text
    assert "; 7 nodes would do the same in every situation." in text
    assert "go 66.7%: drives on 66.7% when light is not red stay 33.3% 33.3% when light is red" in text
    assert "Fitness 3, where less is better: the best of 3 in its generation (best 3, mean 6, worst 10)." in text
    assert "luckiest of 3 as well as a good one: its 20 games overstate it." in text
    assert text.endswith("Judge it by games that evolution has not seen: coevo play here")


def test_only_the_best_is_called_the_luckiest():
    text = told(after(ROBOT, where(bool), rank=1))
    assert "Fitness 5, where less is better: number 2 of 3 in its generation" in text
    assert "luckiest" not in text
    assert "luckiest" not in told(after(ROBOT, where(bool), fitness=(3.0,)))


def test_one_terminal_all_the_time():
    text = told(after(parse("IF_dark(go, IF_tired(go, stay))", FUNCTIONS), where(lambda true: "IF_tired" in true)))
    assert "r0 plays go all the time, and never stay or turn. No question made a difference." in text
    assert "1 of its 5 nodes was never used" in text
    assert "100.0% whatever it sees" in text
    alone = told(after(Tree(("stay",)), where(bool), games=1))
    assert "It asks nothing. It has 1 node." in alone
    assert "its 1 game overstates it" in alone


def test_a_game_that_never_asks():
    text = told(after(ROBOT, [0] * len(SITUATIONS)))
    assert text.startswith("r0 decided nothing in its games.")
    assert "It was never asked." in text


def test_of_many_cases_the_most_frequent_are_told_and_the_others_counted():
    tree = parse(
        "IF_light_is_red(IF_dark(go, IF_tired(stay, go)), IF_light_is_amber(IF_dark(stay, IF_tired(go, stay)),"
        " IF_dark(go, IF_tired(stay, go))))",
        FUNCTIONS,
    )
    used = after(tree, list(range(1, 13)))
    cases = {name: [rule for rule in used.rules_in_use if rule.terminal == name] for name in ("go", "stay")}
    assert {name: len(rules) for name, rules in cases.items()} == {"go": 5, "stay": 4}
    text = portrait(used)
    lines = re.findall(r"^ *([\d.]+)%  (.*)$", text, re.MULTILINE)
    assert [line for _, line in lines[:4]] == [*(f"when {rule.when}" for rule in cases["go"][:3]), "in 2 other cases"]
    assert [line for _, line in lines[4:]] == [f"when {rule.when}" for rule in cases["stay"]]
    assert sum(float(share) for share, _ in lines) == pytest.approx(100.0, abs=0.5)
    assert max(len(line) for line in text.split("\n")) <= 100


def test_a_notebook_shows_the_simplified_tree_folded_by_use(small_run):
    used = used_tree(small_run, "r1", 1, 2)
    assert (used.robot, used.generation, used.rank) == ("r1", 1, 2)
    assert used.tree == small_run.tree("r1", 1, 2)
    assert used.usage.steps == small_run.record(1, "r1")["steps"][2]
    assert used.fitness == used.generation_fitness[2] == small_run.record(1, "r1")["fitness"][2]
    expected = as_svg(
        used.simplified,
        used.simplified_steps,
        fold=0.005,
        title="r1, generation 1, rank 2, simplified",
        descriptions={name: skill_description(name) for name in SKILLS},
    )
    assert used._repr_svg_() == expected
    default = used_tree(small_run)
    assert (default.robot, default.generation, default.rank) == ("r0", 2, 0)
