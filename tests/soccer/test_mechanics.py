"""Closed forms of mechanics: how robots drive, the ball rolls and bodies push."""

from __future__ import annotations

import functools
import math

import msgspec
import numpy as np
import pytest

from coevo.config import BallSettings, FieldSettings, PhysicsSettings, RobotSettings, WorldSettings
from coevo.soccer.drive import action_set

WORLD = WorldSettings()
changed = functools.partial(msgspec.structs.replace, WORLD)


@pytest.mark.parametrize("heading", [0.0, 1.0, -2.5])
@pytest.mark.parametrize("speed", [1.0, -1.0, 0.35])
def test_a_robot_starts_with_constant_acceleration(speed, heading, rolled, at_rest, held):
    steps, acceleration, substep = 30, WORLD.robot.max_acceleration_mps2, WORLD.physics.step_s / 2
    states = rolled(WORLD, at_rest((4.0, 2.3, heading), (7.0, 4.0, 0.0)), held((speed, 0.0), steps))
    # In the k-th substep it drives min(k a dt, |v|).
    ramp = np.minimum(acceleration * substep * np.arange(1, 2 * steps + 1), abs(speed)) * np.sign(speed)
    along = states[:, 0, :2] @ (math.cos(heading), math.sin(heading))
    across = states[:, 0, :2] @ (-math.sin(heading), math.cos(heading))
    np.testing.assert_allclose(along - along[0], np.append(0.0, np.cumsum(ramp * substep)[1::2]), atol=1e-9)
    np.testing.assert_allclose(across, across[0], atol=1e-9)
    np.testing.assert_allclose(np.hypot(*states[1:, 0, 3:5].T), np.abs(ramp[1::2]), atol=1e-9)
    # And in the limit of small steps v^2 / 2a behind one that had its speed at once.
    behind = abs(speed) * steps * WORLD.physics.step_s - abs(along[-1] - along[0])
    assert behind == pytest.approx(speed**2 / (2.0 * acceleration), abs=abs(speed) * substep)


def test_a_robot_brakes_as_fast_as_it_starts(rolled, at_rest, held):
    start = at_rest((2.0, 2.3, 0.0), (7.0, 4.0, 0.0))
    start[0, 3] = 1.0
    states = rolled(WORLD, start, held((0.0, 0.0), 20))
    substep = WORLD.physics.step_s / 2
    assert states[-1, 0, 3] == 0.0
    assert states[-1, 0, 0] - 2.0 == pytest.approx(1.0 / (2.0 * WORLD.robot.max_acceleration_mps2), abs=substep)


@pytest.mark.parametrize("rate", [120.0, -120.0, 45.0])
def test_power_wheeled_steering_turns_on_the_spot_at_its_rate(rate, rolled, at_rest, held):
    steps, substep = 30, WORLD.physics.step_s / 2
    states = rolled(WORLD, at_rest((4.0, 2.3, 0.5), (7.0, 4.0, 0.0)), held((0.0, math.radians(rate)), steps))
    most = np.minimum(WORLD.robot.max_turn_acceleration_dps2 * substep * np.arange(1, 2 * steps + 1), abs(rate))
    turned = np.degrees(states[:, 0, 2] - 0.5)
    np.testing.assert_allclose(turned, np.append(0.0, np.sign(rate) * np.cumsum(most * substep)[1::2]), atol=1e-9)
    assert turned[-1] - turned[-16] == pytest.approx(0.5 * rate)  # in half a second
    np.testing.assert_allclose(states[:, 0, :2], [[4.0, 2.3]] * (steps + 1), atol=1e-9)


def circle(states):
    """Return the radius of the circle through three of the last places, and how far the others are from it."""
    places = states[-60:, 0, 0] + 1j * states[-60:, 0, 1]
    one, two, three = places[0], places[20], places[40]
    ratio = (three - one) / (two - one)
    centre = one + (two - one) * (ratio - abs(ratio) ** 2) / (2j * ratio.imag)
    radii = np.abs(places - centre)
    return radii[0], np.ptp(radii)


@pytest.mark.parametrize("back", [1.0, -1.0])
def test_power_wheeled_steering_drives_circles(back, rolled, at_rest, held):
    rate = math.radians(120.0)
    states = rolled(WORLD, at_rest((4.0, 2.3, 0.3), (7.5, 4.2, 0.0)), held((back, rate), 150))
    radius, error = circle(states)
    assert error < 1e-9
    # Chords of v dt that meet at angles of w dt; for small dt, v / w.
    substep = WORLD.physics.step_s / 2
    assert radius == pytest.approx(substep / (2.0 * math.sin(0.5 * rate * substep)), abs=1e-9)
    assert radius == pytest.approx(1.0 / rate, rel=1e-3)


@pytest.mark.parametrize("steering", [25.0, 10.0])
def test_four_wheel_steering_drives_circles_of_its_wheels_geometry(steering, rolled, at_rest, held):
    robot = RobotSettings(drive="4ws", max_steering_deg=steering, max_speed_mps=0.8)
    world = changed(robot=robot, field=FieldSettings(length_m=9.0, width_m=9.0))
    actions = action_set(robot)
    # Opposite angles front and rear: the axes of the wheels meet beside the middle, at half the wheelbase / tan.
    expected = 0.5 * robot.wheelbase_m / math.tan(math.radians(steering))
    left, right = (actions.commands[actions.codes.tolist().index([1.0, side])] for side in (1.0, -1.0))
    for command, turns in ((left, 1.0), (right, -1.0)):
        states = rolled(world, at_rest((4.5, 4.5, 0.3), (8.5, 0.5, 0.0)), held(command, 150))
        radius, error = circle(states)
        assert error < 1e-9
        assert radius == pytest.approx(expected, rel=1e-3)
        assert np.all(np.diff(states[:, 0, 2]) * turns > 0.0)


@pytest.mark.parametrize("speed", [0.4, 1.0, 1.7])
@pytest.mark.parametrize("slowing", [0.3, 0.6])
def test_a_ball_rolls_until_its_energy_is_used(speed, slowing, rolled, at_rest, held):
    world = changed(ball=BallSettings(rolling_deceleration_mps2=slowing))
    start = at_rest((7.9, 4.2, 0.0), (0.5, 2.3, 0.0))
    start[1, 3:5] = speed * math.cos(0.1), speed * math.sin(0.1)
    states = rolled(world, start, held((0.0, 0.0), 400))
    substep = world.physics.step_s / 2
    speeds = np.hypot(*states[:, 1, 3:5].T)
    time = world.physics.step_s * np.arange(len(states))
    np.testing.assert_allclose(speeds, np.maximum(speed - slowing * time, 0.0), atol=1e-9)
    way = math.dist(states[-1, 1, :2], start[1, :2])
    assert way == pytest.approx(speed**2 / (2.0 * slowing), abs=speed * substep)
    stopped = world.physics.step_s * np.argmax(speeds == 0.0)
    assert 0.0 <= stopped - speed / slowing < world.physics.step_s + 1e-9


@pytest.mark.parametrize(("ball", "wall"), [(0.6, 0.8), (1.0, 1.0), (0.5, 1.0), (0.0, 0.8)])
@pytest.mark.parametrize("towards", [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
def test_a_ball_bounces_with_the_product_of_the_elasticities(ball, wall, towards, rolled, at_rest, held):
    world = changed(
        field=FieldSettings(wall_elasticity=wall), ball=BallSettings(elasticity=ball, rolling_deceleration_mps2=0.0)
    )
    y = 0.9 if towards[0] else 2.3  # beside the goals
    start = at_rest((4.0, 3.5, 0.0), (2.0, y, 0.0))
    start[1, 3:5] = 1.3 * np.array(towards)
    states = rolled(world, start, held((0.0, 0.0), 300))
    speeds = states[:, 1, 3:5] @ towards
    before, after = speeds[0], speeds[np.argmax(speeds != speeds[0])]
    assert before == pytest.approx(1.3)
    assert after == pytest.approx(-ball * wall * before, abs=1e-9)


def test_a_smooth_wall_mirrors_what_is_across_it_only(rolled, at_rest, held):
    world = changed(
        field=FieldSettings(wall_elasticity=1.0, wall_friction=0.0),
        ball=BallSettings(elasticity=1.0, rolling_deceleration_mps2=0.0),
    )
    start = at_rest((7.5, 4.0, 0.0), (1.0, 1.0, 0.0))
    start[1, 3:5] = 0.9, -0.7
    states = rolled(world, start, held((0.0, 0.0), 90))
    np.testing.assert_allclose(states[-1, 1, 3:5], (0.9, 0.7), atol=1e-9)


def test_pushing_a_ball_conserves_momentum(rolled, at_rest, held):
    world = changed(
        ball=BallSettings(rolling_deceleration_mps2=0.0),
        physics=PhysicsSettings(substeps=1),  # so that the first state after the contact precedes the drive's answer
    )
    robot, ball = world.robot, world.ball
    start = at_rest((2.0, 2.3, 0.0), (3.0, 2.3, 0.0))
    start[0, 3] = 1.0
    states = rolled(world, start, held((1.0, 0.0), 60))
    hit = int(np.argmax(states[:, 1, 3] > 0.0))
    assert hit > 0
    momentum = robot.mass_kg * states[:, 0, 3:5] + ball.mass_kg * states[:, 1, 3:5]
    np.testing.assert_allclose(momentum[hit], momentum[hit - 1], atol=1e-9)
    # Two bodies on a line: v' = (1 + e) m / (m + M) v, and e of the speed is left between them.
    bounce = robot.elasticity * ball.elasticity
    pushed = (1.0 + bounce) * robot.mass_kg / (robot.mass_kg + ball.mass_kg)
    assert states[hit, 1, 3] == pytest.approx(pushed, abs=1e-9)
    assert states[hit, 1, 3] - states[hit, 0, 3] == pytest.approx(bounce, abs=1e-9)


def test_robots_of_one_mass_exchange_momentum_in_an_oblique_hit(rolled, at_rest, held):
    # The drives do nothing, as the servo is far too weak to matter within a step.
    world = changed(
        robot=RobotSettings(max_acceleration_mps2=1e-9, max_turn_acceleration_dps2=1e-9),
        physics=PhysicsSettings(substeps=1),
    )
    start = at_rest((2.0, 2.3, 0.0), (3.0, 2.5, 0.0), (7.0, 4.0, 0.0))
    start[0, 3] = 1.0
    states = rolled(world, start, held((0.0, 0.0), 60, robots=2))
    assert states[-1, 1, 3] > 0.2
    momentum = states[:, :2, 3:5].sum(axis=1)
    np.testing.assert_allclose(momentum, np.tile((1.0, 0.0), (len(states), 1)), atol=1e-6)
