"""A ball that is stuck: when, where it is dropped, and what that does to the counts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from coevo.compiled import entry
from coevo.config import RuleSettings, WorldSettings
from coevo.skill import load_skill, make_bank
from coevo.soccer import referee
from coevo.soccer.events import clear_events, event_params, make_events, record_contacts
from coevo.soccer.physics import physics_params
from coevo.soccer.world import World
from coevo.stage import STANDING, kernels, make_venue
from coevo.stage.kernels import begin

RULES = RuleSettings(stuck_after_s=3.0)  # 90 steps within 0.3 m
WORLD = WorldSettings(rules=RULES)
LENGTH, WIDTH = WORLD.field.length_m, WORLD.field.width_m
PHYSICS, LIMITS = physics_params(WORLD), event_params(WORLD)
CLEAR = WORLD.robot.radius_m + WORLD.ball.radius_m + 0.05


@entry
def step(stage, time):
    return kernels.step(stage, time)


@entry
def free_ball(limits, physics, handles, state, time, events):
    return referee.free_ball(limits, physics, handles, state, time, events)


@entry
def drop_place(physics, limits, state):
    return referee.drop_place(physics, limits, state)


def dropped_at(balls, *, events=None, robots=((1.0, 1.0),)):
    """Return the steps in which the referee drops a ball that is where ``balls`` says, whatever was done before."""
    world, found = World(WORLD, len(robots)), []
    events = events or make_events(len(robots))
    clear_events(events)
    state = np.zeros((len(robots) + 1, 6))
    state[:-1, :2] = robots
    for time, (x, y) in enumerate(balls):
        state[-1, :2] = x, y
        if free_ball(LIMITS, PHYSICS, world.handles, state, time, events):
            found.append(time)
    return found


# ----------------------------------------------------------------------------------------------------- when it is stuck


def test_a_ball_at_rest_is_stuck_after_the_time_of_the_rule_and_again_after_as_long():
    assert dropped_at([(0.2, 0.2)] * 90) == []
    assert dropped_at([(4.0, WIDTH / 2)] * 300) == [90, 180, 270]  # it stays where it is dropped


def test_after_a_drop_the_clock_starts_anew_where_the_ball_is_then():
    # It goes back into its corner at once: that is another place, and the time begins there.
    assert dropped_at([(0.2, 0.2)] * 300) == [90, 181, 272]


@pytest.mark.parametrize(("reach", "stuck"), [(0.3, [95]), (0.301, [])])
def test_a_ball_that_stays_within_the_circle_is_stuck_however_it_rolls_in_it(reach, stuck):
    walk = [(2.0, 2.0)] * 5 + [(3.0, 2.0)] + [(3.0 + reach * math.sin(0.5 * math.pi * n), 2.0) for n in range(1, 91)]
    assert dropped_at(walk) == stuck


@pytest.mark.parametrize(("speed", "stuck"), [(0.101, False), (0.099, True)])
def test_a_ball_that_rolls_on_slowly_is_not_stuck(speed, stuck):
    # Beyond 0.3 m of where it was within 3 s, at just more than 0.1 m/s.
    assert bool(dropped_at([(1.0 + speed * n / 30.0, 2.0) for n in range(400)])) == stuck


# ------------------------------------------------------------------------------------------------- where it is dropped


def placed(ball, *robots):
    state = np.zeros((len(robots) + 1, 6))
    state[:, :2] = [*robots, ball]
    return drop_place(PHYSICS, LIMITS, state)


def test_it_is_dropped_at_the_middle_of_the_width_as_far_along_the_field_as_it_was():
    assert placed((3.3, 0.1), (1.0, 1.0)) == (3.3, WIDTH / 2)
    assert placed((5.1, WIDTH - 0.1), (1.0, 1.0), (7.0, 3.0)) == (5.1, WIDTH / 2)


@pytest.mark.parametrize(("x", "expected"), [(0.1, 1.5), (1.49, 1.5), (LENGTH - 0.1, LENGTH - 1.5), (1.51, 1.51)])
def test_it_is_not_dropped_before_a_goal(x, expected):
    assert placed((x, 1.0), (4.0, 0.5)) == (expected, WIDTH / 2)


def test_where_robots_stand_it_is_dropped_at_the_nearest_free_place_beside():
    rng, beside = np.random.default_rng(5), 0
    for _ in range(300):
        x = rng.uniform(2.0, 6.0)
        robots = [(x + rng.normal(0.0, 0.2), WIDTH / 2 + rng.normal(0.0, 0.5)) for _ in range(rng.integers(1, 7))]
        place = placed((x, 0.2), *robots)
        # All places that the rule allows, nearest to the middle first; of two equally near the one on the left.
        steps = int((WIDTH / 2 - WORLD.ball.radius_m) / 0.1)
        allowed = sorted((abs(k), -k, WIDTH / 2 + 0.1 * k) for k in range(-steps, steps + 1))
        free = [y for _, _, y in allowed if min(math.dist((x, y), robot) for robot in robots) >= CLEAR]
        assert place == pytest.approx((x, free[0]))
        beside += free[0] != WIDTH / 2
    assert beside > 100


def test_where_there_is_no_free_place_it_is_the_middle():
    wall = [(4.0, y) for y in np.arange(0.1, WIDTH, 0.3)]
    assert placed((4.0, 0.2), *wall) == (4.0, WIDTH / 2)


# -------------------------------------------------------------------------------------------------------- what it does


def passes(*, drops):
    """Return the passes of two mates: one touches, the ball is stuck with nobody at it or not, the other touches."""
    world = World(WORLD, 2)
    events, teams = make_events(2), np.zeros(2, np.int64)
    clear_events(events)
    state = np.zeros((3, 6))
    state[:, :2] = (1.0, 1.0), (2.0, 1.0), (4.0, WIDTH / 2)
    for time in range(140):
        gaps = np.array([0.0 if time == 60 else 1.0, 0.0 if time == 130 else 1.0])  # 70 steps: in time for a pass
        record_contacts(LIMITS, teams, time, gaps, np.ones((2, 2)), events)
        if drops:
            free_ball(LIMITS, PHYSICS, world.handles, state, time, events)
    return events.passes.tolist()


def test_a_drop_is_no_pass():
    assert passes(drops=False) == [1, 0]
    assert passes(drops=True) == [0, 0]


def venue_of(world, *, ball=(0.85, 0.2), speed=0.0):
    """Return a venue of two that stand, and the ball at rest in a corner or rolling to the goal at x = length."""
    bank = make_bank([load_skill("search")], drive="pws", actions=9)
    venue = make_venue(world, bank, event_params(world), roles=[STANDING] * 2, teams=[0, 1], mates=[-1, -1])
    venue.stage.body.state[:, :2] = (2.0, 0.5), (6.0, 3.0), ball
    venue.stage.body.state[-1, 3] = speed
    begin(venue.stage, np.array([3], np.uint64))
    return venue


def test_off_by_default_a_ball_stays_where_it_is():
    venue = venue_of(WorldSettings())
    before = venue.stage.body.state.copy()
    for time in range(400):
        step(venue.stage, time)
    np.testing.assert_allclose(venue.stage.body.state, before, atol=1e-9)


def test_in_the_world_it_is_put_there_at_rest_and_plays_on():
    venue, balls = venue_of(WORLD), []
    for time in range(170):
        step(venue.stage, time)
        balls.append(venue.stage.body.state[-1].copy())
    np.testing.assert_allclose(balls[89][:2], (0.85, 0.2), atol=1e-9)
    assert balls[90].tolist() == [1.5, WIDTH / 2, 0.0, 0.0, 0.0, 0.0]
    assert balls[-1].tolist() == balls[90].tolist()  # the physics has it there too
    assert venue.stage.events.kicks.tolist() == [0, 0]


def test_a_goal_comes_before_a_drop():
    def ends(stuck_after_steps):
        """Return the step of the goal, None if there is none, and where the ball is then."""
        world = WorldSettings(rules=RuleSettings(stuck_after_s=stuck_after_steps / 30.0))
        venue = venue_of(world, ball=(LENGTH - 0.1, WIDTH / 2), speed=0.4)
        for time in range(30):
            if step(venue.stage, time) == 0:
                return time, venue.stage.body.state[-1, 0]
        return None, venue.stage.body.state[-1, 0]

    goal, x = ends(0)
    assert 5 < goal < 20
    assert ends(goal) == (goal, x)
    assert x > LENGTH
    assert ends(goal - 1) == (None, LENGTH - 1.5)
