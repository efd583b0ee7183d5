"""What robots do that follow a script, and what is written anew when an episode begins."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from coevo.compiled import entry
from coevo.config import RobotSettings, WorldSettings
from coevo.skill import load_skill, make_bank
from coevo.soccer.camera import BALL
from coevo.soccer.drive import action_set
from coevo.soccer.events import event_params
from coevo.stage import CHASER, RANDOM, ROAMER, STANDING, kernels, make_venue, roles
from coevo.stage.kernels import begin, sense
from coevo.stage.roles import follow_script

WORLD = WorldSettings()
SPEED, TURN = WORLD.robot.max_speed_mps, math.radians(WORLD.robot.max_turn_rate_dps)


@entry
def move(stage, time, rng):
    """Let all robots that follow a script do so, and move the world on by one step."""
    for robot in range(stage.roles.role.shape[0]):
        if stage.roles.role[robot] != STANDING:
            action = roles.follow_script(stage, robot, rng)
            if action >= 0:
                kernels.drive(stage, robot, action, rng)
    return kernels.step(stage, time)


def venue_of(*parts, world=WORLD, places=None):
    """Return the venue of robots in these roles, which has begun, and its stream."""
    bank = make_bank([load_skill("search")], drive="pws", actions=len(action_set(world.robot).codes))
    count = len(parts)
    limits = event_params(world)
    venue = make_venue(world, bank, limits, roles=parts, teams=[0] * count, mates=[-1] * count)
    state = venue.stage.body.state
    state[:, :2] = places or [*((1.0 + n, 1.0) for n in range(count)), (6.0, 3.0)]
    rng = np.array([11], np.uint64)
    begin(venue.stage, rng)
    return venue, rng


def run(venue, rng, steps):
    """Return (steps, bodies, 6) states and (steps, robots, 2) commands."""
    states, commands = [], []
    for time in range(steps):
        move(venue.stage, time, rng)
        states.append(venue.stage.body.state.copy())
        commands.append(venue.stage.body.commands.copy())
    return np.array(states), np.array(commands)


# --------------------------------------------------------------------------------------------------------------- roles


def test_one_that_stands_does_not_move():
    venue, rng = venue_of(STANDING, STANDING)
    before = venue.stage.body.state.copy()
    states, commands = run(venue, rng, 90)
    np.testing.assert_allclose(states[-1], before, atol=1e-12)
    assert not commands.any()


@pytest.mark.parametrize("share", [1.0, 0.4])
@pytest.mark.parametrize("heading", [0.0, 2.5, -3.0])
def test_a_chaser_turns_and_drives_to_its_target_at_its_share_of_the_speed(share, heading):
    venue, rng = venue_of(CHASER, STANDING, places=[(1.0, 1.0), (5.0, 3.5), (6.0, 1.0)])
    stage = venue.stage
    stage.body.state[0, 2], stage.roles.target[0], stage.roles.share[0] = heading, 1, share
    begin(stage, rng)
    states, commands = run(venue, rng, int(30 * (4.7 / share + 4.0 / share)))
    apart = np.hypot(*(states[:, 0, :2] - states[:, 1, :2]).T)
    (near,) = np.nonzero(apart < 2 * WORLD.robot.radius_m + 0.01)
    reached = int(near[0])  # it got there, and pushes from then on
    assert np.abs(commands[:, 0, 0]).max() == pytest.approx(SPEED * share)
    assert np.abs(commands[:, 0, 1]).max() <= TURN * share + 1e-12
    assert np.diff(apart[:reached]).max() < 1e-3  # never away from it
    # It drives only where it faces its target within 45 degrees.
    previous = np.concatenate([[[1.0, 1.0, heading, 0.0, 0.0, 0.0]], states[:-1, 0]])
    bearing = np.arctan2(*(np.array([5.0, 3.5]) - previous[:reached, :2]).T[::-1]) - previous[:reached, 2]
    off = np.abs(np.angle(np.exp(1j * bearing)))
    assert np.array_equal(commands[:reached, 0, 0] > 0.0, off < 0.25 * math.pi)


def test_a_chaser_may_chase_the_ball():
    venue, rng = venue_of(CHASER, places=[(2.0, 2.0), (5.0, 2.0)])
    venue.stage.roles.target[0] = 1
    states, _ = run(venue, rng, 120)
    assert states[:, 1, 0].max() > 5.5  # it was pushed
    assert venue.stage.events.kicks[0] > 0


def test_a_roamer_drives_at_random_within_its_share_and_holds_each_command_for_a_while():
    venue, rng = venue_of(ROAMER, STANDING)
    venue.stage.roles.share[0] = 0.5
    _, commands = run(venue, rng, 9000)
    told = commands[:, 0]
    assert {round(v / (0.5 * SPEED), 9) for v in told[:, 0]} == {-1.0, 0.0, 1.0}
    assert {round(w / (0.5 * TURN), 9) for w in told[:, 1]} == {-1.0, 0.0, 1.0}
    pairs, counts = np.unique(told.round(9), axis=0, return_counts=True)
    assert len(pairs) == 9
    assert counts.min() > 300
    changes = np.flatnonzero(np.any(np.diff(told, axis=0) != 0.0, axis=1)) + 1
    assert np.diff(changes).min() >= 10
    assert not commands[:, 1].any()


def test_a_random_robot_takes_actions_of_its_drive_and_holds_each_within_limits():
    world = WorldSettings(robot=RobotSettings(drive="pws"))
    venue, rng = venue_of(RANDOM, RANDOM, world=world)
    stage = venue.stage
    stage.roles.hold[:] = 3, 7
    chosen = []
    for _ in range(6000):
        fresh = stage.roles.left[0, 1] == 0
        chosen.append((bool(fresh), int(follow_script(stage, 0, rng))))
    starts = [n for n, (fresh, _) in enumerate(chosen) if fresh]
    held = np.diff(starts)
    assert set(held.tolist()) == {3, 4, 5, 6, 7}
    assert stats.chisquare(np.bincount(held)[3:]).pvalue > 0.001
    drawn = [chosen[n][1] for n in starts]
    assert stats.chisquare(np.bincount(drawn, minlength=9)).pvalue > 0.001
    for first, last in itertools.pairwise(starts):
        assert len({action for _, action in chosen[first:last]}) == 1
    assert not stage.body.commands.any()  # its action is returned: the caller drives


def test_a_random_robot_is_driven_by_the_codes_and_commands_of_its_drive():
    venue, rng = venue_of(RANDOM, STANDING)
    venue.stage.roles.hold[:] = 1, 4
    drive = action_set(WORLD.robot)
    for time in range(50):
        move(venue.stage, time, rng)
        action = int(venue.stage.roles.left[0, 0])
        assert np.array_equal(venue.stage.body.codes[0], drive.codes[action])
        assert np.array_equal(venue.stage.body.commands[0], drive.commands[action])


# ---------------------------------------------------------------------------------------------------- begin and sense


def test_a_new_episode_knows_nothing_of_the_one_before():
    venue, rng = venue_of(RANDOM, CHASER)
    stage = venue.stage
    stage.roles.target[1], start = 2, stage.body.state.copy()
    played = []
    for _ in range(2):
        stage.body.state[:], rng[0] = start, 3
        begin(stage, rng)
        assert not stage.body.commands.any()
        assert not stage.body.codes.any()
        assert (stage.doing.skill == -1).all()
        assert (stage.doing.action == -1).all()
        assert (stage.events.last_touch == -1).all()
        assert not stage.memory.seen.any()
        played.append(run(venue, rng, 200)[0])
        stage.doing.skill[:] = 5
    assert np.array_equal(*played)


def test_only_robots_that_see_remember_and_only_those_that_guess_begin_with_a_belief():
    venue, rng = venue_of(STANDING, STANDING, STANDING, places=[(1.0, 1.0), (1.0, 2.0), (1.0, 3.0), (3.0, 2.0)])
    stage = venue.stage
    stage.roles.sees[1], stage.roles.guesses[:] = False, [True, False, False]
    believed = []
    for _ in range(200):
        begin(stage, rng)
        believed.append(stage.memory.side.copy())
    believed = np.array(believed)
    assert not believed[:, 1:].any()
    for thing in range(believed.shape[2]):
        assert stats.binomtest(int(believed[:, 0, thing].sum()), 200).pvalue > 1e-4
    sense(stage, 0, rng)
    assert (stage.memory.areas[:, BALL] > 0.0).tolist() == [True, False, True]
    assert (stage.memory.seen[:, BALL] > 0).tolist() == [True, False, True]
