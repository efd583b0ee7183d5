"""Where bodies start: within their regions, apart, facing what they should, uniformly."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from coevo.config import StartSettings, WorldSettings
from coevo.soccer.physics import physics_params
from coevo.soccer.placement import place, regions

WORLD = WorldSettings()
LENGTH, WIDTH = WORLD.field.length_m, WORLD.field.width_m
ROBOT, BALL = WORLD.robot.radius_m, WORLD.ball.radius_m
PHYSICS = physics_params(WORLD)
GAP = 0.01
ANYWHERE = StartSettings(x_m=(ROBOT, LENGTH - ROBOT), y_m=(ROBOT, WIDTH - ROBOT), facing="random")
FAR_BALL = StartSettings(x_m=(7.0, 8.0), y_m=(3.0, 4.0))
ROBOT_HERE = StartSettings(x_m=(1.0, 3.0), y_m=(0.5, 1.5), facing="ball", spread_deg=30.0)


def starts(robots, ball, count, seed=1, teams=None):
    """Return (count, bodies, 6) states, one after the other from one stream."""
    where, rng = regions(robots, ball), np.array([seed], np.uint64)
    teams = np.array(teams or [0] * len(robots), np.int64)
    states = np.full((count, len(robots) + 1, 6), np.nan)
    for state in states:
        assert place(PHYSICS, where, teams, state, rng)
    return states


def spans(size, radius):
    """Return a strategy of [low, high] within a side of the field."""
    ends = st.floats(radius, size - radius)
    return st.tuples(ends, ends).map(sorted).map(tuple)


def areas(radius):
    return st.builds(
        StartSettings,
        x_m=spans(LENGTH, radius),
        y_m=spans(WIDTH, radius),
        facing=st.sampled_from(("ball", "opponent_goal", "own_goal", "random")),
        spread_deg=st.floats(0.0, 180.0),
    )


def off(angle):
    return abs(math.remainder(angle, 2.0 * math.pi))


@settings(deadline=None, max_examples=150)
@given(
    robots=st.lists(areas(ROBOT), min_size=1, max_size=5),
    ball=areas(BALL),
    teams=st.lists(st.integers(0, 1), min_size=5, max_size=5),
    seed=st.integers(0, 2**64 - 1),
)
def test_bodies_start_in_their_regions_apart_at_rest_and_facing_what_they_should(robots, ball, teams, seed):
    state, teams = np.full((len(robots) + 1, 6), np.nan), np.array(teams[: len(robots)], np.int64)
    if not place(PHYSICS, regions(robots, ball), teams, state, np.array([seed], np.uint64)):
        return
    assert not state[:, 3:].any()
    assert state[-1, 2] == 0.0
    radii = [ROBOT] * len(robots) + [BALL]
    for body, start in enumerate([*robots, ball]):
        for k, (low, high) in enumerate((start.x_m, start.y_m)):
            assert low - 1e-12 <= state[body, k] <= high + 1e-12
        for other in range(body):
            apart = math.dist(state[body, :2], state[other, :2]) - radii[body] - radii[other]
            assert apart >= GAP - 1e-12
    goals = (0.0, 0.5 * WIDTH), (LENGTH, 0.5 * WIDTH)
    for robot, start in enumerate(robots):
        own, theirs = goals if teams[robot] == 0 else goals[::-1]
        aim = {"ball": state[-1, :2], "own_goal": own, "opponent_goal": theirs, "random": None}[start.facing]
        if aim is not None:
            towards = math.atan2(aim[1] - state[robot, 1], aim[0] - state[robot, 0])
            assert off(state[robot, 2] - towards) <= math.radians(start.spread_deg) + 1e-9


def test_places_are_uniform_on_their_rectangles():
    states = starts([ROBOT_HERE, ANYWHERE], FAR_BALL, 4000)
    for body, start in ((0, ROBOT_HERE), (2, FAR_BALL)):
        x = (states[:, body, 0] - start.x_m[0]) / (start.x_m[1] - start.x_m[0])
        y = (states[:, body, 1] - start.y_m[0]) / (start.y_m[1] - start.y_m[0])
        assert stats.kstest(x, "uniform").pvalue > 0.001
        assert stats.kstest(y, "uniform").pvalue > 0.001
        cells = np.histogram2d(x, y, bins=8, range=[[0.0, 1.0]] * 2)[0]
        assert stats.chisquare(cells.ravel()).pvalue > 0.001


def test_robots_that_must_make_room_are_uniform_on_what_is_left():
    # The ball has its place first; a robot is drawn again until it fits: uniform outside a disc around the ball.
    ball = StartSettings(x_m=(2.0, 2.0), y_m=(2.0, 2.0))
    robot = StartSettings(x_m=(1.5, 2.5), y_m=(1.5, 2.5), facing="random")
    drawn = starts([robot], ball, 4000)[:, 0, :2]
    radius = ROBOT + BALL + GAP
    rng = np.random.default_rng(2)
    free = rng.uniform(1.5, 2.5, (12_000, 2))
    free = free[np.hypot(*(free - 2.0).T) >= radius]
    assert np.hypot(*(drawn - 2.0).T).min() >= radius
    assert stats.ks_2samp(np.hypot(*(drawn - 2.0).T), np.hypot(*(free - 2.0).T)).pvalue > 0.001
    assert stats.ks_2samp(drawn[:, 0], free[:, 0]).pvalue > 0.001
    assert stats.ks_2samp(drawn[:, 1], free[:, 1]).pvalue > 0.001


def test_headings_are_uniform_within_the_spread():
    states = starts([ROBOT_HERE], FAR_BALL, 3000)
    towards = np.arctan2(states[:, 1, 1] - states[:, 0, 1], states[:, 1, 0] - states[:, 0, 0])
    assert stats.kstest((np.degrees(states[:, 0, 2] - towards) + 30.0) / 60.0, "uniform").pvalue > 0.001


def test_random_headings_are_uniform_all_round():
    states = starts([ANYWHERE], FAR_BALL, 3000)
    assert stats.kstest((states[:, 0, 2] + math.pi) / (2.0 * math.pi), "uniform").pvalue > 0.001


def test_the_same_stream_gives_the_same_start():
    one, two = (starts([ROBOT_HERE, ANYWHERE], FAR_BALL, 20, seed=5) for _ in range(2))
    assert one.tobytes() == two.tobytes()
    assert not np.array_equal(one, starts([ROBOT_HERE, ANYWHERE], FAR_BALL, 20, seed=6))


def test_bodies_that_touch_in_every_place_are_refused():
    narrow = StartSettings(x_m=(2.0, 2.1), y_m=(2.0, 2.1))
    state, rng = np.zeros((3, 6)), np.array([1], np.uint64)
    assert not place(PHYSICS, regions([narrow, narrow], FAR_BALL), np.zeros(2, np.int64), state, rng)
    assert not place(PHYSICS, regions([narrow, FAR_BALL], narrow), np.zeros(2, np.int64), state, rng)


@pytest.mark.parametrize(("apart", "fits"), [(GAP - 1e-6, False), (GAP + 1e-6, True)])
def test_bodies_fit_when_they_are_a_gap_apart(apart, fits):
    x = 2.0 + 2.0 * ROBOT + apart
    robots = [StartSettings(x_m=(2.0, 2.0), y_m=(1.0, 1.0)), StartSettings(x_m=(x, x), y_m=(1.0, 1.0))]
    state, rng = np.zeros((3, 6)), np.array([1], np.uint64)
    assert place(PHYSICS, regions(robots, FAR_BALL), np.zeros(2, np.int64), state, rng) is fits
