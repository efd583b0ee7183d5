"""What counts as a kick, a pass, a collision and a goal, by gaps written down step by step."""

from __future__ import annotations

import numpy as np
import pytest

from coevo.config import PhysicsSettings, RuleSettings, WorldSettings
from coevo.soccer import world
from coevo.soccer.events import clear_events, event_params, goal_scored, make_events, out_of_field, record_contacts
from coevo.soccer.physics import advance, physics_params

WORLD = WorldSettings()
CONTACT, RELEASE, WINDOW = 0.004, 0.02, 90  # metres, metres, steps
APART = 1.0
MATES = (0, 0)  # teams of robots


def play(teams, ball, pairs=None, steps=None):
    """Return (kicks, passes, collisions) of robots.

    Args:
        teams: a number for each robot.
        ball: for each step (a dictionary) the gaps of robots to the ball that are not large.
        pairs: likewise the gaps of pairs of robots.
        steps: how many, if not up to the last one named.
    """
    pairs = pairs or {}
    robots, events = len(teams), make_events(len(teams))
    params, numbers = event_params(WORLD), np.array(teams, np.int64)
    clear_events(events)
    for time in range(steps or max([*ball, *pairs]) + 1):
        ball_gap, robot_gap = np.full(robots, APART), np.full((robots, robots), APART)
        for robot, gap in ball.get(time, {}).items():
            ball_gap[robot] = gap
        for (one, two), gap in pairs.get(time, {}).items():
            robot_gap[one, two] = robot_gap[two, one] = gap
        record_contacts(params, numbers, time, ball_gap, robot_gap, events)
    return events.kicks.tolist(), events.passes.tolist(), events.collisions.tolist()


def touches(*touched):
    """Return ball gaps from (time, robot) that touch."""
    found = {}
    for time, robot in touched:
        found.setdefault(time, {})[robot] = 0.0
    return found


def passes(teams, *touched):
    return play(teams, touches(*touched))[1]


# --------------------------------------------------------------------------------------------------------------- kicks


def test_limits_are_those_of_the_settings():
    params = event_params(WORLD)
    assert params == (CONTACT, RELEASE, WINDOW, 0, 0.3, 1.5)  # no ball is ever stuck
    rules = RuleSettings(pass_window_s=1.0, collision_release_m=0.5, stuck_after_s=3.0, stuck_within_m=0.2)
    assert event_params(WorldSettings(rules=rules)) == (CONTACT, 0.5, 30, 90, 0.2, 1.5)
    assert event_params(WorldSettings(rules=rules, physics=PhysicsSettings(step_s=0.1))).pass_window == 10


def test_each_step_of_contact_is_a_kick():
    assert play(MATES, {0: {0: 0.0}, 1: {0: -0.002}, 2: {0: 0.001}, 5: {0: 0.0}, 6: {1: 0.0}})[0] == [4, 1]


def test_contact_ends_beyond_the_contact_gap():
    assert play(MATES, {0: {0: CONTACT}, 1: {0: np.nextafter(CONTACT, 1.0)}})[0] == [1, 0]


def test_robots_that_touch_the_ball_together_both_kick():
    assert play((0, 1, 0), {3: {0: 0.0, 1: 0.0, 2: 0.0}, 4: {2: 0.0}})[0] == [1, 1, 2]


def test_a_robot_that_pushes_the_ball_kicks_it_in_each_step_of_the_world():
    # Through the world itself, so that gaps mean what they say.
    params, robot = physics_params(WORLD), WORLD.robot
    mover = world.World(WORLD, 1)
    state = np.zeros((2, 6))
    state[0, :2], state[1, :2] = (1.0, 2.3), (1.0 + robot.radius_m + WORLD.ball.radius_m + 0.3, 2.3)
    mover.place(state)
    ball_gap, robot_gap, events = np.zeros(1), np.zeros((1, 1)), make_events(1)
    rules, teams, gaps, counts = event_params(WORLD), np.zeros(1, np.int64), [], []
    for time in range(60):
        advance(mover.handles, params, state, np.array([[1.0, 0.0]]), ball_gap, robot_gap)
        record_contacts(rules, teams, time, ball_gap, robot_gap, events)
        apart = state[1, 0] - state[0, 0] - robot.radius_m - WORLD.ball.radius_m
        assert ball_gap[0] <= apart + 1e-12
        gaps.append(ball_gap[0])
        counts.append(int(events.kicks[0]))
    first = next(step for step, gap in enumerate(gaps) if gap <= CONTACT)
    assert 10 < first < 25  # 0.3 m at 4 m/s^2 and 1 m/s take 0.43 s
    assert counts[first - 1 : first + 1] == [0, 1]
    assert counts[-1] == sum(gap <= CONTACT for gap in gaps) > 1


# -------------------------------------------------------------------------------------------------------------- passes


@pytest.mark.parametrize(("ago", "counts"), [(1, 1), (89, 1), (90, 1), (91, 0), (500, 0)])
def test_a_pass_arrives_within_the_window(ago, counts):
    assert passes(MATES, (10, 0), (10 + ago, 1)) == [counts, 0]


@pytest.mark.parametrize(("ago", "counts"), [(90, 1), (91, 0)])
def test_the_window_begins_with_the_last_contact_of_the_passer(ago, counts):
    assert passes(MATES, (0, 0), (40, 0), (70, 0), (70 + ago, 1)) == [counts, 0]


def test_a_pass_is_credited_to_the_passer_whoever_it_is():
    assert passes(MATES, (3, 1), (9, 0)) == [0, 1]


def test_only_a_team_mate_receives_a_pass():
    assert passes((0, 1), (0, 0), (5, 1)) == [0, 0]
    assert passes((0, 1, 0), (0, 0), (5, 2)) == [1, 0, 0]
    assert passes((1, 0, 1), (0, 0), (5, 2)) == [1, 0, 0]


def test_an_opponent_who_touches_the_ball_between_breaks_the_pass():
    assert passes((0, 1, 0), (0, 0), (5, 1), (10, 2)) == [0, 0, 0]


def test_nobody_passes_to_itself():
    assert passes(MATES, (0, 0), (20, 0), (40, 0)) == [0, 0]


def test_the_first_touch_of_a_game_is_no_pass():
    assert passes(MATES, (0, 1)) == [0, 0]


def test_one_reception_is_one_pass_however_long_it_is_held():
    assert passes(MATES, (0, 0), *((time, 1) for time in range(10, 40))) == [1, 0]


def test_a_pass_and_a_pass_back_are_two():
    assert passes(MATES, (0, 0), (10, 1), (20, 0)) == [1, 1]


def test_three_passes_in_a_chain_credit_each_passer():
    assert passes((0, 0, 0), (0, 0), (10, 1), (20, 2), (30, 0)) == [1, 1, 1]


def test_a_struggle_for_the_ball_is_no_series_of_passes():
    # Both touch the ball at once for a second: at most one hand-over, not one a step.
    both = [(time, robot) for time in range(5, 35) for robot in (0, 1)]
    assert sum(passes(MATES, *both)) == 0
    assert sum(passes(MATES, (4, 0), *both)) <= 1


def test_another_game_begins_with_nothing():
    events, teams = make_events(2), np.array(MATES, np.int64)
    params, apart = event_params(WORLD), np.full((2, 2), APART)
    touch = np.zeros((2, 2))
    record_contacts(params, teams, 0, np.array([0.0, APART]), touch, events)
    assert events.kicks.tolist() == [1, 0]
    assert events.collisions.tolist() == [1, 1]
    clear_events(events)
    assert not events.kicks.any()
    assert not events.collisions.any()
    record_contacts(params, teams, 0, np.array([APART, 0.0]), apart, events)  # no pass from the game before
    assert events.passes.tolist() == [0, 0]
    clear_events(events)
    record_contacts(params, teams, 0, np.full(2, APART), touch, events)  # and a new collision
    assert events.collisions.tolist() == [1, 1]


# ---------------------------------------------------------------------------------------------------------- collisions


def collisions(gaps, teams=MATES, pair=(1, 0)):
    return play(teams, {}, {time: {pair: gap} for time, gap in enumerate(gaps)})[2]


def test_a_collision_is_counted_once_for_both_robots_until_they_part():
    assert collisions([0.1, 0.0, -0.001, 0.003, 0.0]) == [1, 1]


def test_a_collision_needs_contact():
    assert collisions([np.nextafter(CONTACT, 1.0)] * 5) == [0, 0]
    assert collisions([CONTACT]) == [1, 1]


def test_robots_must_part_by_the_release_gap_before_the_next_collision():
    assert collisions([0.0, RELEASE, 0.0]) == [1, 1]
    assert collisions([0.0, 0.01, 0.01, 0.0]) == [1, 1]
    assert collisions([0.0, np.nextafter(RELEASE, 1.0), 0.0]) == [2, 2]
    assert collisions([0.0, 0.5, 0.0, 0.5, 0.0]) == [3, 3]


def test_collisions_of_different_pairs_are_counted_apart():
    together = {2: {(0, 1): 0.0, (1, 2): 0.0}, 3: {(0, 1): 0.0, (1, 2): APART}, 4: {(1, 2): 0.0, (0, 2): 0.0}}
    # Pair 01 collides once (parting at 4 is not followed by another), 12 twice, 02 once.
    assert play((0, 0, 1), {}, together)[2] == [2, 3, 3]


# --------------------------------------------------------------------------------------------------------------- goals


def ball_at(x, y=2.3, robot_x=4.0):
    state = np.zeros((2, 6))
    state[:, :2] = (robot_x, 2.3), (x, y)
    return state


@pytest.mark.parametrize(
    ("x", "team"),
    [
        (4.0, -1),
        (WORLD.field.length_m, -1),
        (np.nextafter(WORLD.field.length_m, 9.0), 0),
        (WORLD.field.length_m + 0.4, 0),
        (0.0, -1),
        (np.nextafter(0.0, -1.0), 1),
        (-0.4, 1),
    ],
)
def test_a_goal_is_scored_when_the_balls_centre_is_behind_the_line(x, team):
    assert goal_scored(physics_params(WORLD), ball_at(x)) == team


@pytest.mark.parametrize(
    ("x", "out"),
    [(0.0, False), (-1e-9, True), (WORLD.field.length_m, False), (WORLD.field.length_m + 1e-9, True), (4.0, False)],
)
def test_a_robot_is_out_of_the_field_behind_a_goal_line(x, out):
    state = ball_at(4.5, robot_x=x)
    assert out_of_field(physics_params(WORLD), state, 0) is out
