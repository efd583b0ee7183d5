"""Crossover in context, small changes and simplification, against what they leave as it is and closed forms."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from coevo.config import GPSettings
from coevo.evolution.population import NEW, Individual, individual_of
from coevo.evolution.variation import breed
from coevo.game import function_set
from coevo.tree import Tree, parse, tree_codes
from coevo.vocabulary import SKILLS

functions = function_set(0, 3)
UNLIKELY = 1e-4
CHANGES = ("changed_leaves", "inserted_conditions", "changed_conditions")


def parents_of(trees):
    """Return parents of which no two nodes are one object, and parent and place of each node by its object."""
    found = [individual_of(tree_codes(tree, functions), functions) for tree in trees]
    parents = [Individual([copy.copy(node) for node in one]) for one in found]
    for fitness, parent in enumerate(parents):
        parent.fitness.values = (float(fitness), 0.0)
    return parents, {id(node): (i, k) for i, parent in enumerate(parents) for k, node in enumerate(parent)}


def settings_of(**changed):  # noqa: ANN003 - those of GPSettings
    shares = {"crossover": 0.0, "mutation": 0.0, "reproduction": 0.0}
    if not set(shares) & set(changed):
        shares["reproduction"] = 1.0
    return GPSettings(**{"elite": 0, "tournament": 1, "population": 20, **shares, **changed})


def children_of(parents, settings, seed=1):
    return breed(parents, settings, functions, seed=seed, generation=0, robot=0)


def chosen(tree, answers):
    """Walk a tree by answers, a mapping from condition to whether it holds; return the leaf's name and its place."""
    tree = tree if isinstance(tree, Tree) else Tree(tuple(node.name for node in tree))
    at = 0
    while tree.second[at]:
        at = at + 1 if answers[tree.names[at]] else tree.second[at]
    return tree.names[at], at


def any_answers(seed, number=30):
    rng = np.random.default_rng(seed)
    return [
        dict(zip(functions.functions, rng.random(len(functions.functions)) < 0.5, strict=True)) for _ in range(number)
    ]


def sights(seed, number=30):
    """Return answers that can be: each object is lost, or in one place with one size."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(number):
        holds = {name for group in functions.situations for name in group[rng.integers(len(group))]}
        found.append({name: name in holds for name in functions.functions})
    return found


trees = st.lists(st.from_type(Tree), min_size=2, max_size=5)
seeds = st.integers(0, 2**32)


@given(trees=trees, seed=seeds)
def test_in_context_two_children_do_together_what_their_parents_did(trees, seed):
    """Whatever is seen: one of the children chooses as one of the parents, and the other as the other."""
    parents, _ = parents_of(trees)
    pair = settings_of(crossover=1.0, crossover_points="same-context", population=2)
    one, two = children_of(parents, pair, seed)
    by = {parent for child in (one, two) for parent in (child.origin.parent_1, child.origin.parent_2) if parent >= 0}
    known = [parents[index] for index in by]
    for answers in any_answers(seed):
        found = sorted(chosen(child, answers)[0] for child in (one, two))
        if len(known) == 2:
            assert found == sorted(chosen(parent, answers)[0] for parent in known)
        else:
            assert found == [chosen(known[0], answers)[0]] * 2


def test_in_context_what_differs_is_exchanged_half_of_the_time():
    texts = ["IF_ball_is_lost(shoot, pass)", "IF_ball_is_lost(avoid, search)"]
    parents, _ = parents_of(map(parse, texts))
    made = [
        tuple(node.name for node in child)
        for child in children_of(parents, settings_of(crossover=1.0, crossover_points="same-context", population=8000))
    ]
    counts = [
        sum(one[1:] == leaves for one in made)
        for leaves in (("shoot", "pass"), ("avoid", "search"), ("shoot", "search"), ("avoid", "pass"))
    ]
    assert sum(counts) == 8000
    # A parent that meets itself, half of the time, is copied.
    assert stats.chisquare(counts, 8000 * np.array([3, 3, 1, 1]) / 8).pvalue > UNLIKELY


def test_in_context_other_roots_change_places_as_a_whole():
    parents, _ = parents_of(map(parse, ["IF_ball_is_lost(shoot, pass)", "IF_ball_is_left(avoid, search)"]))
    children = children_of(parents, settings_of(crossover=1.0, crossover_points="same-context", population=60))
    assert {child.origin.operator for child in children} == {"reproduction"}
    for child in children:
        assert list(child) == list(parents[child.origin.parent_1])


@pytest.mark.parametrize("simplify", [False, True], ids=["as they are", "simplified"])
@pytest.mark.parametrize("points", ["any", "same-context"])
@given(trees=trees, seed=seeds)
def test_origins_say_where_each_node_came_from(points, simplify, trees, seed):
    """Nodes that are objects of their own in each parent tell it themselves."""
    parents, places = parents_of(trees)
    shares = {"crossover": 0.5, "reproduction": 0.2, "mutation": 0.3}
    changes = dict.fromkeys(CHANGES, 0.5)
    settings = settings_of(**shares, **changes, crossover_points=points, simplify=simplify, elite=1, tournament=2)
    for child in children_of(parents, settings, seed):
        operator, first, second, sources = child.origin
        told = sources or [(0, node) for node in range(len(child))]
        expected = [None if source == NEW else ((first, second)[source[0]], source[1]) for source in told]
        assert [places.get(id(node)) for node in child] == expected
        assert (second >= 0) == (operator == "crossover")
        if operator in ("elite", "reproduction"):
            assert {parent for parent, _ in told} == {0}


@given(trees=trees, seed=seeds)
def test_simplified_children_choose_what_they_would_have_chosen(trees, seed):
    parents, _ = parents_of(trees)
    plain, simple = (
        children_of(parents, settings_of(crossover=0.8, mutation=0.2, simplify=simplify), seed)
        for simplify in (False, True)
    )
    assert sum(map(len, simple)) <= sum(map(len, plain))
    for one, other in zip(plain, simple, strict=True):
        for answers in sights(seed, 10):
            assert chosen(one, answers)[0] == chosen(other, answers)[0]


@given(tree=st.from_type(Tree), walked=st.sampled_from([0.0, 0.5, 1.0]), seed=seeds)
def test_an_inserted_condition_leaves_all_else_as_it_was(tree, walked, seed):
    parents, _ = parents_of([tree])
    settings = settings_of(inserted_conditions=1.0, walked_changes=walked, crossover_depth_max=90)
    for child in children_of(parents, settings, seed):
        sources = child.origin.sources or tuple((0, k) for k in range(len(child)))
        assert [place for _, place in sources if place >= 0] == list(range(len(tree)))
        for answers in any_answers(seed, 5):
            name, at = chosen(child, answers)
            assert sources[at] == NEW or sources[at] == (0, chosen(tree, answers)[1])
            assert sources[at] != NEW or name in SKILLS


@pytest.mark.parametrize("rate", [0.3, 2.0])
@pytest.mark.parametrize("change", CHANGES)
def test_there_are_as_many_small_changes_as_a_poisson_distribution_says(change, rate):
    """In a tree so large that hardly a node is changed twice. A change into the same is none: so they are thinned."""
    depth = 8
    text = "shoot"
    for _ in range(depth):
        text = f"IF_ball_is_left({text}, {text})"
    parents, _ = parents_of([parse(text)])
    many = children_of(parents, settings_of(**{change: rate}, population=300))
    counted = [sum(source == NEW for source in child.origin.sources or ()) for child in many]
    kinds = {"changed_leaves": len(SKILLS), "changed_conditions": len(functions.functions)}
    if change == "inserted_conditions":
        assert all(number % 2 == 0 for number in counted)
        counted = [number // 2 for number in counted]
    else:
        rate *= 1.0 - 1.0 / kinds[change]
    top = int(stats.poisson.ppf(0.98, rate))
    observed = np.bincount(np.minimum(counted, top), minlength=top + 1)
    expected = stats.poisson.pmf(np.arange(top), rate)
    expected = 300 * np.append(expected, 1.0 - expected.sum())
    assert stats.chisquare(observed, expected).pvalue > UNLIKELY


@pytest.mark.parametrize(
    ("change", "stop"), [("changed_leaves", 0.2), ("inserted_conditions", 0.0), ("inserted_conditions", 0.3)]
)
def test_walks_end_as_often_as_coins_say(change, stop):
    """In a chain of three conditions, a leaf at each side of it: half of the walks leave it at each of them."""
    names = parse("IF_ball_is_left(shoot, IF_ball_is_right(pass, IF_ball_is_lost(avoid, search)))").names
    parents, _ = parents_of([Tree(names)])
    settings = settings_of(**{change: 0.2}, walked_changes=1.0, walk_stop=stop, population=2000)
    ends = dict.fromkeys(range(len(names)), 0)
    for child in children_of(parents, settings):
        sources = child.origin.sources
        if sources is None or sum(source == NEW for source in sources) != (2 if change == "inserted_conditions" else 1):
            continue  # no change, or several of them
        if change == "changed_leaves":
            ends[sources.index(NEW)] += 1
        else:
            first, last = (k for k, source in enumerate(sources) if source == NEW)
            ends[sources[first + 1][1] if last > first + 1 else sources[first + 2][1]] += 1
    stop, expected, left = 0.0 if change == "changed_leaves" else stop, {}, 1.0
    for at in (0, 2, 4):
        expected[at], left = left * stop, left * (1.0 - stop)
        expected[at + 1], left = left / 2, left / 2
    expected[6] = left
    likely = [at for at in expected if expected[at]]
    assert not any(ends[at] for at in expected if at not in likely)
    shares = np.array([expected[at] for at in likely])
    observed = np.array([ends[at] for at in likely])
    assert stats.chisquare(observed, shares * observed.sum()).pvalue > UNLIKELY


def test_walks_of_none_draw_nothing():
    parents, _ = parents_of([parse("IF_ball_is_left(IF_ball_is_lost(shoot, pass), avoid)")])
    ways = [settings_of(inserted_conditions=2.0, changed_leaves=1.0, walk_stop=stop) for stop in (0.0, 0.9)]
    one, two = ([[node.name for node in child] for child in children_of(parents, way)] for way in ways)
    assert one == two


@pytest.mark.parametrize("walked", [0.0, 1.0])
def test_conditions_are_not_inserted_below_the_limit(walked):
    parents, _ = parents_of([parse("IF_ball_is_left(IF_ball_is_lost(shoot, pass), avoid)")])
    settings = settings_of(inserted_conditions=3.0, walked_changes=walked, crossover_depth_max=3, population=200)
    children = children_of(parents, settings)
    assert max(Tree(tuple(node.name for node in child)).depth for child in children) == 3


def test_a_leaf_alone_has_no_condition_to_change():
    parents, _ = parents_of([parse("shoot")])
    children = children_of(parents, settings_of(changed_conditions=5.0))
    assert {(child.origin.operator, len(child)) for child in children} == {("reproduction", 1)}


def test_small_changes_make_a_copy_a_mutant():
    parents, _ = parents_of([parse("IF_ball_is_left(shoot, pass)")])
    children = children_of(parents, settings_of(inserted_conditions=1.0, population=200))
    operators = {(child.origin.operator, len(child) > 3) for child in children}
    assert operators == {("reproduction", False), ("mutation", True)}
