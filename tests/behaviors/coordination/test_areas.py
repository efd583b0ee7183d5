"""Coordination on tables: worlds so small that areas, values and updates are known beforehand."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.cluster.vq import kmeans2

from behaviors.coordination.areas import RELEARN, Behaviour, areas_of, component, first_values, state_values
from behaviors.settings import LearningSettings
from behaviors.tabular.decisions import Decisions, end_decisions
from behaviors.tabular.qlearning import lambda_returns, make_learner
from behaviors.tabular.table import make_table
from behaviors.trials.task import COLLISION, FAILURE, GOING, SUCCESS

GAMMA = 0.9
NUMBERS = make_learner(LearningSettings(gamma=GAMMA, return_lambda=0.0, alpha=1.0))


def behaviour(name, best, own_states, **parts):  # noqa: ANN003 - fields
    """Return a behaviour whose second action is a little worse than the best one."""
    values = np.stack([np.asarray(best, float), np.asarray(best, float) - 0.125], axis=1)
    return Behaviour(name, values, values.max(axis=1), np.asarray(own_states), **parts)


# --------------------------------------------------------------------------------------------------- composite states


@given(st.lists(st.integers(1, 4), min_size=1, max_size=4), st.randoms())
def test_a_composite_state_says_which_state_each_behaviour_is_in(sizes, random):
    axes = random.sample(range(len(sizes)), random.randint(1, len(sizes)))
    own = list(itertools.product(*(range(sizes[axis]) for axis in axes)))
    every = itertools.product(*(range(size) for size in sizes))
    assert component(sizes, axes).tolist() == [own.index(tuple(state[axis] for axis in axes)) for state in every]


# --------------------------------------------------------------------------------------------------------------- areas


def quadrants(columns=6, rows=4):
    """Return two behaviours on a grid: one's goal is near in the left half, the other's in the lower half."""
    across = behaviour("left", [GAMMA] * (columns // 2) + [0.0] * (columns // 2), component([columns, rows], [0]))
    up = behaviour("lower", [GAMMA] * (rows // 2) + [0.0] * (rows // 2), component([columns, rows], [1]))
    column, row = np.unravel_index(np.arange(columns * rows), (columns, rows))
    return across, up, column < columns // 2, row < rows // 2


def test_a_behaviour_gets_the_states_where_it_alone_nears_its_goal():
    across, up, left, lower = quadrants()
    found = areas_of([across, up])
    # Scaled, q is at the corners of a square; the midpoint is its middle, and draws the two corners that tie.
    assert np.array_equal(found.area, np.where(left & ~lower, 0, np.where(lower & ~left, 1, RELEARN)))
    assert left[found.kernels[0]]
    assert not lower[found.kernels[0]]
    np.testing.assert_allclose(found.distance[found.area == 0, 0], 0.0)
    np.testing.assert_allclose(found.distance[found.area == 1, 0], 8.0)  # the diagonal; a side is two deviations


def test_a_behaviour_that_prevents_gets_the_states_where_it_alone_is_needed():
    goal, _, left, lower = quadrants()
    states = component([6, 4], [1])
    danger = behaviour("avoid", [-0.3, -0.3, 0.0, 0.0], states, threatened=True)
    area = areas_of([goal, danger]).area
    assert np.array_equal(area, np.where(left & ~lower, 0, np.where(lower & ~left, 1, RELEARN)))
    # (B.3) to the letter: it applies where it values a state most, which is where nothing threatens.
    area = areas_of([goal, behaviour("avoid", [-0.3, -0.3, 0.0, 0.0], states)]).area
    assert np.array_equal(area, np.where(left & lower, 0, np.where(~lower & ~left, 1, RELEARN)))


def corridor(length=21):
    """Return two behaviours in the same corridor, with goals at its two ends."""
    place = np.arange(length)
    return [behaviour("west", GAMMA**place, place), behaviour("east", GAMMA ** place[::-1], place)]


def test_two_goals_at_the_ends_of_a_corridor_leave_its_middle_to_be_learned():
    found = areas_of(corridor(), split_std=np.inf, merge_distance=0.0, max_iterations=100)
    assert found.kernels.tolist() == [0, 20]
    area = found.area.tolist()
    assert area == [0] * area.count(0) + [RELEARN] * area.count(RELEARN) + [1] * area.count(1)
    mirrored = {0: 1, 1: 0, RELEARN: RELEARN}
    assert area == [mirrored[one] for one in area[::-1]]
    q = np.stack([one.claim for one in corridor()], axis=1)
    q /= q.std(axis=0)
    _, labels = kmeans2(q, np.vstack([q[[0, 20]], q[[0, 20]].mean(axis=0)]), iter=100, minit="matrix")
    assert area == np.where(labels == 2, RELEARN, labels).tolist()


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10_000), st.integers(2, 3))
def test_every_state_has_an_area_and_a_kernel_its_own(seed, count):
    random = np.random.default_rng(seed)
    sizes = random.integers(2, 6, count)
    own = [component(sizes, [i]) for i in range(count)]
    best = [random.normal(size=size) for size in sizes]
    several = [behaviour(str(i), *pair) for i, pair in enumerate(zip(best, own, strict=True))]
    found = areas_of(several)
    assert set(found.area.tolist()) <= {RELEARN, *range(count)}
    assert found.area[found.kernels].tolist() == list(range(count))
    # With nothing shared, a kernel is where one behaviour is at its best and the others at their worst: (B.3), (B.4).
    for i, kernel in enumerate(found.kernels):
        assert best[i][own[i][kernel]] == best[i].max()
        assert all(best[j][own[j][kernel]] == best[j].min() for j in range(count) if j != i)
    order = random.permutation(len(found.area))
    turned = [behaviour(str(i), best[i], own[i][order]) for i in range(count)]
    assert np.array_equal(areas_of(turned).area, found.area[order])


def test_behaviours_that_cannot_be_told_apart_are_refused():
    place = np.arange(5)
    with pytest.raises(ValueError, match="idle values all states alike"):
        areas_of([behaviour("idle", np.ones(5), place), behaviour("west", GAMMA**place, place)])
    with pytest.raises(ValueError, match="west and same apply best in the same state"):
        areas_of([behaviour("west", GAMMA**place, place), behaviour("same", GAMMA**place, place)])


# -------------------------------------------------------------------------------------------------------------- values


def test_a_state_is_worth_the_goal_discounted_by_the_steps_to_it():
    values = np.array([[0.5, 0.2], [0.1, 0.3]])
    steps = np.array([0.0, 20.0])
    np.testing.assert_allclose(state_values(values, steps=steps, gamma=0.99, reward=2.0), [2.0, 2.0 * 0.99**20])
    assert state_values(values, steps=None, gamma=0.99, reward=2.0).tolist() == [0.5, 0.3]


def test_levelled_values_choose_the_same_action_and_are_worth_what_the_state_is():
    values = np.random.default_rng(1).normal(size=(7, 3))
    worth = np.linspace(-1.0, 1.0, 7)
    levelled = Behaviour("b", values, worth, np.arange(7)).levelled
    np.testing.assert_allclose(levelled.max(axis=1), worth)
    assert np.array_equal(levelled.argmax(axis=1), values.argmax(axis=1))


def test_first_values_agree_with_the_areas():
    west, east = corridor()
    found = areas_of([west, east])
    blend = first_values([west, east], found.distance, how="blend")
    np.testing.assert_allclose(blend[0], west.levelled[0])
    np.testing.assert_allclose(blend[20], east.levelled[20])
    np.testing.assert_allclose(blend[10], 0.5 * (west.levelled[10] + east.levelled[10]))  # as far from both kernels
    both = np.stack([west.levelled, east.levelled])
    assert np.all((both.min(axis=0) <= blend + 1e-12) & (blend <= both.max(axis=0) + 1e-12))
    np.testing.assert_allclose(first_values([west, east], found.distance, how="sum"), both.sum(axis=0))
    assert not first_values([west, east], found.distance, how="zero").any()


# ------------------------------------------------------------------------------------------------ learning again: (B.6)


def relearned(decisions, last, *, values, fixed, decay=0.0, visits=None):
    """Return the values after one trial of (state, action, reward, steps), and how often each was updated."""
    states, actions, rewards, lengths = map(np.array, zip(*decisions, strict=True))
    values = np.array(values, float)
    visits = np.zeros(values.shape, np.int64) if visits is None else visits.copy()
    numbers = NUMBERS._replace(return_lambda=decay)
    fixed, count = np.array(fixed), len(decisions)
    lambda_returns(numbers, values, visits, fixed, states, actions, rewards * 1.0, lengths, count, last)
    return values, visits


CHAIN = [[0.0, 0.0], [0.0, 0.0], [0.7, 0.2]]  # two states to learn, then the area of a behaviour, worth 0.7
FREE, AREA = False, True


@pytest.mark.parametrize("decay", [0.0, 0.5, 1.0])
def test_what_leads_into_an_area_learns_what_the_area_is_worth(decay):
    trial = [(0, 0, 0.0, 2), (1, 1, -0.1, 3), (2, 1, 1.0, 1)]
    values, visits = relearned(trial, -1, values=CHAIN, fixed=[FREE, FREE, AREA], decay=decay)
    into = -0.1 + GAMMA**3 * 0.7  # though 1.0 was got there, by an action that is not the area's best
    assert values[1, 1] == pytest.approx(into)
    assert values[0, 0] == pytest.approx(GAMMA**2 * ((1.0 - decay) * max(into, 0.0) + decay * into))
    assert values[2].tolist() == CHAIN[2]
    assert visits.tolist() == [[1, 0], [0, 1], [0, 0]]


def test_nothing_crosses_an_area_that_was_only_passed():
    trial = [(0, 0, 0.0, 2), (2, 0, 0.0, 5), (1, 0, 1.0, 4)]
    values, visits = relearned(trial, -1, values=CHAIN, fixed=[FREE, FREE, AREA], decay=1.0)
    assert values[0, 0] == pytest.approx(GAMMA**2 * 0.7)
    assert values[1, 0] == 1.0
    assert visits.sum() == 2


def test_time_running_out_in_an_area_or_outside_is_no_end():
    assert relearned([(0, 1, 0.0, 4)], 2, values=CHAIN, fixed=[FREE, FREE, AREA])[0][0, 1] == pytest.approx(
        GAMMA**4 * 0.7
    )
    chain = [[0.0, 0.0], [0.0, 0.4], [0.7, 0.2]]
    assert relearned([(0, 1, 0.0, 4)], 1, values=chain, fixed=[FREE, FREE, AREA])[0][0, 1] == pytest.approx(
        GAMMA**4 * 0.4
    )
    assert relearned([(0, 1, -0.3, 4)], -1, values=CHAIN, fixed=[FREE, FREE, AREA])[0][0, 1] == pytest.approx(-0.3)


def test_in_areas_nothing_is_learned():
    trial = [(0, 0, 0.0, 2), (1, 1, 0.0, 3), (2, 0, 1.0, 1)]
    values, visits = relearned(trial, -1, values=CHAIN, fixed=[AREA, AREA, AREA], decay=0.5)
    assert values.tolist() == CHAIN
    assert not visits.any()


@settings(deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, 4), st.integers(0, 1), st.sampled_from((0.0, 1.0, -0.3)), st.integers(1, 30)),
        min_size=1,
        max_size=12,
    ),
    st.integers(-1, 4),
    st.sampled_from((0.0, 0.7, 1.0)),
    st.lists(st.booleans(), min_size=5, max_size=5),
)
def test_areas_part_a_trial_into_trials_that_run_out_of_time(decisions, last, decay, fixed):
    start = np.random.default_rng(len(decisions)).normal(size=(5, 2))
    values, visits = relearned(decisions, last, values=start, fixed=fixed, decay=decay)
    expected, counted = start.copy(), np.zeros((5, 2), np.int64)
    after, parts = last, [(area, list(part)) for area, part in itertools.groupby(decisions, lambda one: fixed[one[0]])]
    for area, part in reversed(parts):
        if not area:
            so_far = {"values": expected, "visits": counted}
            expected, counted = relearned(part, after, fixed=[FREE] * 5, decay=decay, **so_far)
        after = part[0][0]
    assert np.array_equal(values, expected)
    assert np.array_equal(visits, counted)


# ------------------------------------------------------------------------------------------------------ steps to a goal


def expected_after(walks, places, *, decay=0.9, start=100.0):
    """Return the expected steps after walks of (states, steps of each decision, outcome, last state)."""
    numbers = NUMBERS._replace(gamma=1.0, return_lambda=decay, alpha=1.0, alpha_visits=1.0, alpha_min=0.0)
    follower, table = numbers._replace(follows=True, never=900.0), make_table(places, 1)
    table.values[:] = start
    for states, lengths, outcome, last in walks:
        count = len(states)
        # What the policy did, and what rewards the task gives, must not matter.
        actions, rewards = np.full(count, 5), np.full(count, 7.0)
        made = Decisions(np.array(states), actions, rewards, np.array(lengths), np.array([count]))
        end_decisions(follower, table, made, last, outcome in (FAILURE, COLLISION))
    return table.values[:, 0]


@pytest.mark.parametrize("decay", [0.0, 0.9, 1.0])
def test_in_a_corridor_the_steps_are_those_to_its_end(decay):
    places, each = 8, 5
    walk = list(range(places)), [each] * places, SUCCESS, -1
    found = expected_after([walk] * 3, places, decay=decay)
    np.testing.assert_allclose(found, [each * (places - place) for place in range(places)])


def test_the_steps_of_two_ways_are_their_mean():
    short, long = ([0, 1], [10, 4], SUCCESS, -1), ([0, 2], [10, 30], SUCCESS, -1)
    np.testing.assert_allclose(expected_after([short, long] * 500, 3, decay=1.0), [10 + 17, 4, 30])


def test_a_trial_without_the_goal_counts_its_limit_but_running_out_of_time_goes_on():
    for outcome in (FAILURE, COLLISION):
        assert expected_after([([0], [7], outcome, -1)], 2)[0] == 907.0
    assert expected_after([([0], [7], GOING, 1)], 2)[0] == 107.0  # the limit that state 1 begins with
    assert expected_after([([0], [7], SUCCESS, -1)], 2)[1] == 100.0  # never met
