"""The default world measured from outside, as one would a real field: what rolls, rebounds and is seen tells its sizes.

Sizes and masses stand here as the source gives them and come from no setting: whoever changes a setting changes what is
measured, and no longer meets them. What is free in the source (elasticity, the robot) is read from the settings.
"""

from __future__ import annotations

import itertools
import math

import msgspec
import numpy as np
import pytest

from coevo.config import WorldSettings
from coevo.soccer.camera import OPPONENT_GOAL, OWN_GOAL, camera_params, make_retina, object_count, see
from coevo.soccer.physics import physics_params, replay
from coevo.soccer.world import World

WORLD = WorldSettings()
# RoboCup rules of 1997 (see test_tables_of_the_source): field, goal, panels at the corners.
LENGTH, WIDTH, GOAL_WIDTH, GOAL_HEIGHT, PANEL = 8.22, 4.575, 1.5, 0.5, 0.2
MIDDLE, HALF = 0.5 * WIDTH, 0.5 * GOAL_WIDTH
# A football of size 4: what its radius and its mass may be.
RADII_M = 0.635 / (2.0 * math.pi), 0.66 / (2.0 * math.pi)
MASSES_KG = 0.35, 0.39
SUBSTEP_S = 1.0 / 60.0  # two a video frame
WALL = WORLD.field.wall_thickness_m
BALL = WORLD.ball.radius_m


def changed(**parts):  # noqa: ANN003 - those of WorldSettings
    """Return the world with some values of its parts replaced: ``ball={"friction": 0.0}``."""
    replaced = {part: msgspec.structs.replace(getattr(WORLD, part), **values) for part, values in parts.items()}
    return msgspec.structs.replace(WORLD, **replaced)


def rolled(world, robot, ball, velocity, steps):
    """Return (steps + 1, 2, 6) states of a robot that stands (x, y, heading) and a ball (x, y) that is pushed."""
    states = np.zeros((steps + 1, 2, 6))
    states[0, 0, :3], states[0, 1, :2], states[0, 1, 3:5] = robot, ball, velocity
    mover = World(world, 1)  # its handles do not keep it alive
    replay(mover.handles, physics_params(world), states[0].copy(), np.zeros((steps, 1, 2)), states[1:])
    return states


# --------------------------------------------------------------------------------------------------- field and goals


SMOOTH = {"ball": {"rolling_deceleration_mps2": 0.0, "friction": 0.0}}


def to_the_goal(offset, right, world=None):
    """Return the states of a ball that rolls along the field at a goal, ``offset`` from the middle of its mouth."""
    away, speed = (LENGTH, 1.0) if right else (0.0, -1.0)
    start = abs(away - 2.0), MIDDLE + offset
    return rolled(world or changed(**SMOOTH), (0.5 * LENGTH, 0.3, 0.0), start, (speed, 0.0), 75)[:, 1]


def depth_in_goal(ball, right):
    """Return how far behind the goal line the ball's centre ever was [m]."""
    return float(np.max(ball[:, 0] - LENGTH if right else -ball[:, 0]))


@pytest.mark.parametrize("right", [True, False])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_ball_that_just_fits_rolls_straight_into_a_goal_of_the_rules(side, right):
    ball = to_the_goal(side * (HALF - BALL - 0.001), right)
    until = int(np.argmax(np.abs(ball[:, 3]) < 0.999)) or len(ball)  # to the back of the goal
    assert depth_in_goal(ball[:until], right) > 0.3
    np.testing.assert_allclose(ball[:until, 1], MIDDLE + side * (HALF - BALL - 0.001), atol=1e-9)


@pytest.mark.parametrize("right", [True, False])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_ball_a_millimetre_farther_out_touches_the_post(side, right):
    ball = to_the_goal(side * (HALF - BALL + 0.001), right)
    touched = int(np.argmax(ball[:, 4] != 0.0))
    assert touched > 0
    assert ball[touched, 4] * side < 0.0  # towards the middle
    assert -0.01 < depth_in_goal(ball[: touched + 1], right) < 0.15


@pytest.mark.parametrize("right", [True, False])
@pytest.mark.parametrize("outside", [0.0, 0.3, 0.6])
def test_a_ball_beside_the_mouth_and_its_post_bounces_straight_back(outside, right):
    # The end of the wall is round: flat from half the wall's thickness beside the mouth on.
    ball = to_the_goal(HALF + 0.5 * WALL + 1e-6 + outside, right)
    rebound = WORLD.ball.elasticity * WORLD.field.wall_elasticity
    assert depth_in_goal(ball, right) == pytest.approx(-BALL, abs=1.0 * SUBSTEP_S)
    assert abs(ball[-1, 3]) == pytest.approx(rebound, abs=1e-9)
    assert ball[-1, 3] * ball[0, 3] < 0.0
    np.testing.assert_allclose(ball[:, 1], ball[0, 1], atol=1e-6)


@pytest.mark.parametrize("share", [0.15, 0.35, 0.5, 0.65, 0.8, 0.95])
@pytest.mark.parametrize("elastic", [True, False])
def test_the_round_post_sends_a_ball_where_its_normal_says(elastic, share):
    """A smooth ball that meets the post at the angle a: v' = v - (1 + e) cos a (cos a, sin a), into the goal or out.

    ``share`` is sin a: how far beside the middle of the post's round end the ball comes along, in radii of both.
    """
    world = changed(
        ball={**SMOOTH["ball"], **({"elasticity": 1.0} if elastic else {})},
        field={"wall_elasticity": 1.0} if elastic else {},
        physics={"substeps": 20},  # so that the contact is found before an overlap turns the normal
    )
    bounce = world.ball.elasticity * world.field.wall_elasticity
    aside = share * (BALL + 0.5 * WALL)
    ball = to_the_goal(HALF + 0.5 * WALL - aside, True, world)
    touched = int(np.argmax(ball[:, 4] != 0.0))
    cosine = math.sqrt(1.0 - share**2)
    expected = 1.0 - (1.0 + bounce) * cosine**2, -(1.0 + bounce) * cosine * share
    assert touched > 0
    assert ball[touched, 3:5] == pytest.approx(expected, abs=0.03)
    if abs(expected[0]) > 0.1:
        assert (depth_in_goal(ball, True) > 0.0) == (expected[0] > 0.0)


ELASTIC = changed(
    ball={"rolling_deceleration_mps2": 0.0, "friction": 0.0, "elasticity": 1.0}, field={"wall_elasticity": 1.0}
)


@pytest.mark.parametrize(
    ("velocity", "end"), [((1.0, 0.0), LENGTH), ((-1.0, 0.0), 0.0), ((0.0, 1.0), WIDTH), ((0.0, -1.0), 0.0)]
)
def test_a_ball_turns_round_where_the_rules_put_the_walls(velocity, end):
    ball = rolled(ELASTIC, (1.0, 3.5, 0.0), (0.5 * LENGTH, 0.8), velocity, 300)[:, 1]
    farthest = np.max(ball[:, :2] @ velocity)
    assert farthest == pytest.approx(end - BALL, abs=SUBSTEP_S)
    assert np.min(ball[:, 3:5] @ velocity) == pytest.approx(-1.0)


def test_a_ball_in_a_corner_is_sent_back_by_a_panel_20_cm_from_it():
    # Along the bisector the panel's face is 0.2 / sqrt(2) from the corner.
    for x, y in itertools.product((0.0, LENGTH), (0.0, WIDTH)):
        inwards = np.array([1.0 if x == 0.0 else -1.0, 1.0 if y == 0.0 else -1.0]) / math.sqrt(2.0)
        start = np.array([x, y]) + 0.9 * inwards
        ball = rolled(ELASTIC, (0.5 * LENGTH, MIDDLE, 0.0), start, -inwards, 45)[:, 1]
        nearest = np.min((ball[:, :2] - (x, y)) @ inwards)
        assert nearest == pytest.approx(PANEL / math.sqrt(2.0) + BALL, abs=SUBSTEP_S)
        assert ball[-1, 3:5] == pytest.approx(inwards, abs=1e-6)


# ------------------------------------------------------------------------------------------------------------- the ball


def test_a_ball_that_lies_at_a_wall_has_the_radius_of_a_football_of_size_4():
    soft = changed(ball={"rolling_deceleration_mps2": 0.0, "elasticity": 0.0})
    ball = rolled(soft, (7.0, 3.5, 0.0), (4.0, 0.15), (0.0, -0.02), 200)[:, 1]
    assert ball[-1, 4] == pytest.approx(0.0, abs=1e-9)
    assert RADII_M[0] - WORLD.physics.collision_slop_m <= ball[-1, 1] <= RADII_M[1]


def test_the_recoil_of_a_robot_that_is_hit_weighs_the_ball():
    """Head-on, m (v - v') = M V' and V' - v' = e v: so M V' / (v - v') is the ball's mass, whatever was set."""
    world = changed(
        ball={"rolling_deceleration_mps2": 0.0},
        physics={"substeps": 1},  # so that the first state after the contact precedes the drive's answer
    )
    robot = WORLD.robot
    states = rolled(world, (5.0, 2.3, 0.0), (3.5, 2.3), (1.0, 0.0), 60)
    hit = int(np.argmax(states[:, 0, 3] > 0.0))
    assert hit > 0
    recoil, after = states[hit, 0, 3], states[hit, 1, 3]
    mass = robot.mass_kg * recoil / (1.0 - after)
    assert MASSES_KG[0] <= mass <= MASSES_KG[1]
    bounce = robot.elasticity * WORLD.ball.elasticity
    assert recoil - after == pytest.approx(bounce, abs=1e-9)
    assert recoil == pytest.approx((1.0 + bounce) * 0.37 / (0.37 + robot.mass_kg), abs=1e-9)  # the middle of the range
    np.testing.assert_allclose(states[hit, :, 4:], 0.0, atol=1e-9)


def way_of(speed, slowing):
    """Return how far a ball rolls that loses ``slowing`` * dt before each substep: dt (n v - a dt n (n + 1) / 2)."""
    substeps = math.ceil(speed / (slowing * SUBSTEP_S)) - 1  # then what is left is lost at once
    return SUBSTEP_S * (substeps * speed - slowing * SUBSTEP_S * substeps * (substeps + 1) / 2.0)


@pytest.mark.parametrize("speed", [0.3, 0.77, 1.0, 1.25])
def test_a_ball_rolls_as_far_as_its_slowing_lets_it_and_1_7_m_from_1_m_per_second(speed):
    slowing = 0.3  # of a ball on carpet
    ball = rolled(WORLD, (7.5, 4.2, 0.0), (1.0, 2.3), (speed, 0.0), 200)[:, 1]
    way = ball[-1, 0] - ball[0, 0]
    assert ball[-1, 3] == 0.0
    assert way == pytest.approx(way_of(speed, slowing), abs=1e-9)
    assert way == pytest.approx(speed**2 / (2.0 * slowing), abs=0.5 * speed * SUBSTEP_S + 1e-3)
    if speed == 1.0:
        assert round(way, 1) == 1.7


# ----------------------------------------------------------------------------------------------------------- the camera


def pinhole(points):
    """Return (points, 2) columns and rows of points ahead (forward, right, up from the camera), by section 3.5.3.

    64 x 60 pixels for 67 x 60 degrees, 26 degrees downwards.
    """
    forward, right, up = np.asarray(points, np.float64).T
    tilt = math.radians(26.0)
    depth = forward * math.cos(tilt) - up * math.sin(tilt)
    below = -forward * math.sin(tilt) - up * math.cos(tilt)
    columns = 32.0 + 32.0 / math.tan(math.radians(33.5)) * right / depth
    rows = 30.0 + 30.0 / math.tan(math.radians(30.0)) * below / depth
    return np.stack([columns, rows], axis=1)


def goal_ahead(distance, aside, turn):
    """Return (4, 2) pixels of a goal's corners (upper left, upper right, lower right, lower left), seen from so far.

    ``aside`` [m]: how far the camera is right of the goal's middle; ``turn`` [rad]: how far it looks to the left.
    """
    corners = []
    for up, side in ((GOAL_HEIGHT, -HALF), (GOAL_HEIGHT, HALF), (0.0, HALF), (0.0, -HALF)):
        right = side - aside
        ahead = distance * math.cos(turn) - right * math.sin(turn)
        beside = distance * math.sin(turn) + right * math.cos(turn)
        corners.append((ahead, beside, up - WORLD.camera.height_m))
    return pinhole(corners)


def area_and_centre(corners):
    """Return the area and the centroid of a polygon, by the formula of the shoelace."""
    x, y = corners.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    area = 0.5 * cross.sum()
    centre = [np.sum((v + np.roll(v, -1)) * cross) / (6.0 * area) for v in (x, y)]
    return abs(area), centre


@pytest.mark.parametrize("right", [True, False])
def test_a_goal_of_the_rules_is_seen_where_the_optics_of_the_source_put_it(right):
    # A pixel counts if its centre is covered: off by a part of a pixel in one image, and not in the mean of many.
    rng, camera, retina = np.random.default_rng(1), camera_params(WORLD), make_retina(WORLD)
    goal, found, expected = OPPONENT_GOAL if right else OWN_GOAL, [], []
    while len(found) < 1500:
        distance, aside, turn = rng.uniform(2.5, 5.0), rng.uniform(-0.6, 0.6), math.radians(rng.uniform(-15.0, 15.0))
        corners = goal_ahead(distance, aside, turn)
        if np.any((corners < 1.0) | (corners > (63.0, 59.0))):
            continue  # not the whole goal
        state, features, areas = np.zeros((2, 6)), np.zeros((object_count(1), 11)), np.zeros(object_count(1))
        state[0, :3] = LENGTH - distance, MIDDLE - aside, turn
        if not right:
            state[0, :3] = distance, MIDDLE + aside, turn + math.pi
        state[1, :2] = 0.5 * LENGTH, -1.0  # the ball is out of the way
        see(camera, state, 0, 0, retina, features, areas)
        area, centre = area_and_centre(corners)
        found.append([areas[goal], *features[goal, :2]])
        expected.append([area, *centre])
    found, expected = np.array(found), np.array(expected)
    assert found[:, 0].mean() == pytest.approx(expected[:, 0].mean(), rel=0.01)
    assert np.mean(found[:, 1:] - expected[:, 1:], axis=0) == pytest.approx([0.0, 0.0], abs=0.05)
    assert np.polyfit(expected[:, 1], found[:, 1], 1)[0] == pytest.approx(1.0, abs=0.005)
