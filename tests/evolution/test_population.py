"""Creation and variation against closed forms: depths, selection pressure, shares of the operators."""

from __future__ import annotations

import copy
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from coevo.config import GPSettings
from coevo.evolution.population import NEW, Individual, codes_of, first_population, individual_of, origins_of
from coevo.evolution.variation import breed
from coevo.game import function_set
from coevo.records import OPERATORS
from coevo.tree import Tree, parse, tree_codes
from coevo.vocabulary import SKILLS

functions = function_set(0, 3)
TABLE_6_3 = {"crossover": 0.85, "reproduction": 0.05, "mutation": 0.10}
UNLIKELY = 1e-4  # of a statistic under the closed form; the seeds are fixed, so a test that passes always does


def individual(tree, fitness=0.0):
    """Return a parent from a tree or its text, with its fitness assigned."""
    tree = tree if isinstance(tree, Tree) else parse(tree)
    parent = individual_of(tree_codes(tree, functions), functions)
    parent.fitness.values = (float(fitness), float(tree.depth))
    return parent


def only(operator, **settings):  # noqa: ANN003 - those of GPSettings
    """Return settings in which one operator does everything, and nobody survives as it is."""
    shares = dict.fromkeys(("crossover", "reproduction", "mutation"), 0.0)
    return GPSettings(**{**shares, operator: 1.0, "elite": 0, **settings})


def bred(parents, settings, seed=1, generation=0, robot=0):
    return breed(parents, settings, functions, seed=seed, generation=generation, robot=robot)


def names(tree):
    return tuple(node.name for node in tree)


def full(depth, condition="IF_ball_is_left"):
    return "shoot" if depth == 0 else f"{condition}({full(depth - 1, condition)}, {full(depth - 1, condition)})"


# ------------------------------------------------------------------------------------------------------ creation


@given(
    low=st.integers(0, 5),
    more=st.integers(0, 4),
    population=st.integers(2, 30),
    seed=st.integers(0, 2**63 - 1),
)
def test_first_populations_have_their_size_and_depths_within_limits(low, more, population, seed):
    settings = GPSettings(population=population, elite=0, creation_depth_min=low, creation_depth_max=low + more)
    trees = first_population(settings, functions, seed=seed, robot=0)
    assert len(trees) == population
    for tree in trees:
        assert low <= Tree(names(tree)).depth <= low + more
        assert set(names(tree)) <= set(functions.names)


def test_creation_is_ramped_half_and_half():
    """Half of the trees are full, their depths uniform; a grown one of depth 6 or more is full once in 10,000."""
    low, high, number = 2, 8, 1200
    settings = GPSettings(population=number, creation_depth_min=low, creation_depth_max=high)
    depths = Counter()
    for tree in first_population(settings, functions, seed=5, robot=1):
        depth = Tree(names(tree)).depth
        if len(tree) == 2 ** (depth + 1) - 1:
            depths[depth] += 1
    share = 0.5 / (high - low + 1)
    observed = [depths[depth] for depth in (6, 7, 8)]
    expected = [number * share] * 3
    rest = number - sum(observed), number - sum(expected)
    assert stats.chisquare([*observed, rest[0]], [*expected, rest[1]]).pvalue > UNLIKELY


def test_functions_and_skills_are_drawn_evenly():
    settings = GPSettings(population=400, creation_depth_min=6, creation_depth_max=6)
    used = Counter(name for tree in first_population(settings, functions, seed=2, robot=0) for name in names(tree))
    for group in (functions.functions, functions.names[-4:]):
        assert stats.chisquare([used[name] for name in group]).pvalue > UNLIKELY


# ----------------------------------------------------------------------------------------------------- selection


@pytest.mark.parametrize(("tournament", "parents"), [(10, 20), (2, 12), (1, 8)])
def test_a_tournament_selects_each_rank_as_often_as_the_closed_form_says(tournament, parents):
    """The best of k drawn with replacement has rank i of n with probability ((n-i)^k - (n-i-1)^k) / n^k."""
    trees = [f"{name}(shoot, pass)" for name in functions.functions[:parents]]
    order = np.random.default_rng(3).permutation(parents)  # rank by place, so that places mean nothing
    ranked = [individual(tree, fitness=order[place]) for place, tree in enumerate(trees)]
    children = bred(ranked, only("reproduction", tournament=tournament, population=4000))
    place = {names(parent): i for i, parent in enumerate(ranked)}
    times = Counter(int(order[place[names(child)]]) for child in children)
    remaining = np.arange(parents, 0, -1) / parents
    expected = remaining**tournament - (remaining - 1 / parents) ** tournament
    assert expected.sum() == pytest.approx(1.0)
    kept = expected * 4000 >= 5.0  # the rest are counted together
    observed = np.array([times[rank] for rank in range(parents)])
    pooled = [np.append(x[kept], x[~kept].sum()) if (~kept).any() else x for x in (observed, expected * 4000)]
    assert stats.chisquare(*pooled).pvalue > UNLIKELY


def test_of_equal_fitness_the_smaller_tree_wins():
    deep, shallow = individual(full(3)), individual(full(1))
    worse = individual("shoot", fitness=1.0)
    children = bred([worse, deep, shallow], only("reproduction", tournament=60, population=100))
    assert {names(child) for child in children} == {names(shallow)}
    (survivor, *_) = bred([worse, deep, shallow], only("mutation", elite=1, population=4))
    assert names(survivor) == names(shallow)


# ------------------------------------------------------------------------------------------------- the operators


@given(tree=st.lists(st.from_type(Tree), min_size=2, max_size=8), seed=st.integers(0, 2**32), elite=st.integers(0, 3))
def test_the_best_survive_unchanged_and_the_population_keeps_its_size(tree, seed, elite):
    rng = np.random.default_rng(seed)
    parents = [individual(one, fitness) for one, fitness in zip(tree, rng.permutation(len(tree)), strict=True)]
    before = [names(parent) for parent in parents]
    children = bred(parents, GPSettings(population=9, elite=elite), seed=seed)
    assert len(children) == 9
    best = sorted(parents, key=lambda parent: parent.fitness.values)[:elite]
    assert [names(child) for child in children[: len(best)]] == [names(parent) for parent in best]
    assert [names(parent) for parent in parents] == before
    assert not any(child is parent for child in children for parent in parents)


@given(tree=st.lists(st.from_type(Tree), min_size=2, max_size=8), seed=st.integers(0, 2**32))
def test_reproduction_alone_gives_only_copies(tree, seed):
    parents = [individual(one) for one in tree]
    children = bred(parents, only("reproduction", population=20), seed=seed)
    assert {names(child) for child in children} <= {names(parent) for parent in parents}


@given(limit=st.integers(1, 7), seed=st.integers(0, 2**32))
def test_crossover_never_goes_deeper_than_its_limit(limit, seed):
    parents = [individual(full(depth, name)) for depth, name in zip(range(limit + 1), functions.names, strict=False)]
    settings = only("crossover", population=16, crossover_depth_max=limit)
    for generation in range(3):
        parents = bred(parents, settings, seed=seed, generation=generation)
        for child in parents:
            depth = Tree(names(child)).depth
            assert depth <= limit
            child.fitness.values = (0.0, float(depth))


def test_a_crossover_that_would_be_too_deep_gives_its_parents():
    """Of two full trees at the limit, a child keeps the depth only if branches of one depth are exchanged."""
    one, two = full(4, "IF_ball_is_left"), full(4, "IF_ball_is_lost")
    parents = [individual(one), individual(two)]
    children = bred(parents, only("crossover", population=300, crossover_depth_max=4))
    depths = Counter(Tree(names(child)).depth for child in children)
    assert max(depths) == 4
    copies = sum(names(child) in {names(parent) for parent in parents} for child in children)
    assert 0 < copies < len(children)


def test_mutation_may_go_deeper_than_the_limit_of_crossover():
    children = bred([individual(full(4))], only("mutation", population=200, crossover_depth_max=4))
    depths = [Tree(names(child)).depth for child in children]
    assert max(depths) > 4
    assert max(depths) <= 4 + 5  # mutation_depth_max


def test_mutation_puts_a_grown_tree_in_the_place_of_one_branch(nested):
    parent = individual(full(3))
    changed = 0
    for child in bred([parent], only("mutation", population=200, mutation_depth_max=2)):
        one, two = nested(Tree(names(parent))), nested(Tree(names(child)))
        # Go down while exactly one branch differs: below is the mutation.
        while one != two and isinstance(one, tuple) and isinstance(two, tuple) and one[0] == two[0]:
            differing = [(a, b) for a, b in zip(one[1:], two[1:], strict=True) if a != b]
            if len(differing) != 1:
                break
            ((one, two),) = differing
        if one != two:
            assert str(two).count("IF_") <= 3  # at most a full tree of depth 2
            changed += 1
    assert changed > 150


@pytest.mark.parametrize("leaf_probability", [0.0, 0.3, 1.0])
def test_crossover_points_are_leaves_as_often_as_the_settings_say(leaf_probability):
    assert_points_are_leaves(only("crossover", population=6000, tournament=1, leaf_probability=leaf_probability))


def test_crossover_points_are_leaves_once_in_ten_if_nothing_is_said():
    """As Koza (1992) has it, and DEAP's manual of this crossover."""
    settings = only("crossover", population=6000, tournament=1)
    assert_points_are_leaves(settings, leaf_probability=0.1)


def assert_points_are_leaves(settings, leaf_probability=None):
    """Check how often each parent's point is a leaf, and that the two do not depend on each other.

    The parents share no node, neither functions nor leaves: a child's root says who it is, and what is missing and
    what came in say which points were chosen. Half of the pairs are a parent and itself, and say nothing.
    """
    p = settings.leaf_probability if leaf_probability is None else leaf_probability
    parents = [individual(full(3, "IF_ball_is_left")), individual(full(3, "IF_ball_is_lost").replace("shoot", "pass"))]
    own = [set(names(parent)) for parent in parents]
    points = Counter()
    for child in bred(parents, settings):
        found = names(child)
        mine = own[0] if found[0] in own[0] else own[1]
        kept, came = sum(name in mine for name in found), sum(name not in mine for name in found)
        if came:
            points[kept == len(parents[0]) - 1, came == 1] += 1
    shares = {True: p, False: 1.0 - p}
    expected = {(a, b): shares[a] * shares[b] for a in (True, False) for b in (True, False)}
    assert sum(points.values()) > 2500
    assert all(points[which] == 0 for which, share in expected.items() if share == 0.0)
    possible = [which for which, share in expected.items() if share > 0.0]
    if len(possible) > 1:
        observed = [points[which] for which in possible]
        assert stats.chisquare(observed, [sum(observed) * expected[which] for which in possible]).pvalue > UNLIKELY


@pytest.mark.parametrize("limit", [0, 1, 3, 5, 8])
def test_grown_subtrees_reach_the_limit_of_mutation_as_often_as_the_closed_form_says(limit):
    assert_depths_of_grown_trees(only("mutation", population=6000, mutation_depth_max=limit), limit)


def test_grown_subtrees_of_the_default_are_five_deep_at_most():
    """So that a mutation at the limit of crossover, 25, gives the depth of 30 that Table 6.4 prints."""
    assert_depths_of_grown_trees(only("mutation", population=6000), 5)


def assert_depths_of_grown_trees(settings, limit):
    """Check the depths of mutants of a leaf, which are nothing but the grown tree.

    A height is drawn from 0 to the limit. Above it a node is a leaf with the share t of leaves among all names, so a
    branch has the depth h with q(h) = (1 - t) (1 - (1 - q(h - 1))^2), q(0) = 1.
    """
    children = bred([individual("shoot")], settings)
    depths = np.bincount([Tree(names(child)).depth for child in children], minlength=limit + 1)
    assert len(depths) == limit + 1  # never beyond
    leaf = len(SKILLS) / len(functions.names)
    at_least = np.zeros((limit + 1, limit + 2))  # [height, depth]: chance of that depth or more
    at_least[:, 0] = 1.0
    for height in range(1, limit + 1):
        for depth in range(1, height + 1):
            at_least[height, depth] = (1.0 - leaf) * (1.0 - (1.0 - at_least[height - 1, depth - 1]) ** 2)
    expected = (at_least[:, :-1] - at_least[:, 1:]).mean(axis=0)
    assert expected.sum() == pytest.approx(1.0)
    assert depths[limit] > 0
    if limit:
        assert stats.chisquare(depths, expected * len(children)).pvalue > UNLIKELY


@pytest.mark.parametrize(
    "shares",
    [
        pytest.param({}, id="Table 6.3"),
        {"crossover": 0.5, "reproduction": 0.1, "mutation": 0.4},
        {"crossover": 0.3, "reproduction": 0.7, "mutation": 0.0},
    ],
)
def test_copies_mutants_and_crossed_children_have_the_shares_of_the_settings(shares):
    """Of Table 6.3 (85, 5 and 10 %) if nothing is said; of all draws of an operator, a crossover makes two children.

    Each parent has a function of its own, on 7 nodes, and the same leaf everywhere, on 8. Exact copies are the
    reproduced, the crossed with themselves if both points are branches of one depth (2 and 4 of 6 are), and the mutants
    of a leaf into itself. Another leaf comes by mutation only.
    """
    settings = GPSettings(population=8000, elite=0, tournament=1, leaf_probability=0.0, **shares)
    crossover, reproduction, mutation = (shares or TABLE_6_3).values()
    parents = [individual(full(3, name)) for name in functions.functions]
    originals = {names(parent) for parent in parents}
    counted = Counter()
    for child in bred(parents, settings):
        found = names(child)
        counted["copy"] += found in originals
        counted["other leaf"] += not {"pass", "avoid", "search"}.isdisjoint(found)
    draws, itself = 2.0 * crossover + reproduction + mutation, 1.0 / len(parents)
    heights = settings.mutation_depth_max + 1
    leaf = len(SKILLS) / len(functions.names)
    grown_leaf = (1.0 / heights + (1.0 - 1.0 / heights) * leaf) / len(SKILLS)  # a certain one
    only_this = [1.0 / len(SKILLS)]  # a tree grown to a height has no leaf but a certain one
    for _ in range(1, heights):
        only_this.append(leaf / len(SKILLS) + (1.0 - leaf) * only_this[-1] ** 2)
    copies = reproduction + 2.0 * crossover * itself * ((2 / 6) ** 2 + (4 / 6) ** 2) + mutation * 8 / 15 * grown_leaf
    assert stats.binomtest(counted["copy"], 8000, copies / draws).pvalue > UNLIKELY
    assert stats.binomtest(counted["other leaf"], 8000, mutation * (1.0 - np.mean(only_this)) / draws).pvalue > UNLIKELY


# ------------------------------------------------------------------------------------------------------- origins


def nodes_of_their_own(trees):
    """Return parents of which no two nodes are one object, and the place of each node by its object."""
    parents = [Individual([copy.copy(node) for node in individual(tree)]) for tree in trees]
    for fitness, parent in enumerate(parents):
        parent.fitness.values = (float(fitness), 0.0)
    return parents, {id(node): (i, k) for i, parent in enumerate(parents) for k, node in enumerate(parent)}


@given(
    tree=st.lists(st.from_type(Tree), min_size=2, max_size=6),
    seed=st.integers(0, 2**32),
    limit=st.integers(1, 8),
)
def test_origins_say_from_which_node_of_which_parent_each_node_came(tree, seed, limit):
    """DEAP moves its nodes: where each parent's nodes are objects of their own, they tell where they are from."""
    parents, places = nodes_of_their_own(tree)
    shares = {"crossover": 0.5, "reproduction": 0.1, "mutation": 0.4}
    settings = GPSettings(population=12, elite=1, tournament=2, crossover_depth_max=limit, **shares)
    assert_origins_are_true(bred(parents, settings, seed=seed), places)


def assert_origins_are_true(children, places):
    """Check what origins say of nodes by the nodes themselves, which are objects of their own in each parent."""
    for child in children:
        operator, first, second, sources = child.origin
        parents = {0: first, 1: second}
        told = sources or [(0, node) for node in range(len(child))]
        expected = [None if source == NEW else (parents[source[0]], source[1]) for source in told]
        assert [places.get(id(node)) for node in child] == expected
        came = {parent for parent, _ in told}
        if operator == "crossover":
            assert {0, 1} <= came
        else:
            assert second == -1
            assert came <= ({0, -1} if operator == "mutation" else {0})
        if operator == "mutation":
            assert -1 in came


def test_a_child_that_the_limit_replaced_is_a_reproduction():
    """Of parents at the limit of 1, all deeper children are replaced: what crossed has exchanged leaves."""
    parents = [individual("IF_ball_is_left(shoot, pass)"), individual("IF_ball_is_lost(avoid, search)")]
    for parent in parents:
        parent.fitness.values = (0.0, 1.0)
    children = bred(parents, only("crossover", population=400, crossover_depth_max=1, leaf_probability=1.0))
    assert {child.origin.operator for child in children} == {"crossover"}
    deep = [individual(full(4, "IF_ball_is_left")), individual(full(4, "IF_ball_is_lost"))]
    children = bred(deep, only("crossover", population=400, crossover_depth_max=4, tournament=1))
    seen = Counter(child.origin.operator for child in children)
    assert set(seen) == {"crossover", "reproduction"}
    for child in children:
        if child.origin.operator == "reproduction":
            assert names(child) == names(deep[child.origin.parent_1])


def test_a_crossover_without_points_is_a_reproduction():
    parents = [individual("shoot"), individual("IF_ball_is_lost(avoid, search)")]
    children = bred(parents, only("crossover", population=60, tournament=1, leaf_probability=1.0))
    seen = Counter((child.origin.operator, names(child)[0]) for child in children)
    assert set(seen) == {
        ("reproduction", "shoot"),
        ("reproduction", "IF_ball_is_lost"),
        ("crossover", "IF_ball_is_lost"),
    }
    assert all(child.origin.parent_1 == (names(child)[0] != "shoot") for child in children)


def test_first_individuals_are_created():
    settings = GPSettings(population=4)
    origins = origins_of(first_population(settings, functions, seed=1, robot=0))
    assert origins.operator.tolist() == [OPERATORS.index("creation")] * 4
    assert origins.parents.tolist() == [[-1, -1]] * 4


@given(tree=st.from_type(Tree))
def test_codes_and_individuals_are_the_same_trees(tree):
    parent = individual(tree)
    assert names(parent) == tree.names
    assert codes_of(parent, functions).tolist() == tree_codes(tree, functions).tolist()
    assert codes_of(parent, functions).dtype == np.uint8
