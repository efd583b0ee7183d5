"""The analytic camera against an exact ray cast of every pixel, and what must hold of any camera."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coevo.config import CameraSettings, WorldSettings
from coevo.soccer.camera import (
    BALL,
    FEATURES,
    OPPONENT_GOAL,
    OWN_GOAL,
    ROBOTS,
    camera_params,
    make_retina,
    object_count,
    see,
)

WORLD = WorldSettings()
LENGTH, WIDTH = WORLD.field.length_m, WORLD.field.width_m
RADII = WORLD.robot.radius_m, WORLD.ball.radius_m
CAMERAS = {
    "standard": WORLD.camera,
    "low": CameraSettings(height_m=0.35, tilt_deg=-10.0, width_px=40, height_px=30),
    "above the robots": CameraSettings(height_m=0.8, tilt_deg=-35.0),
    "level with their top": CameraSettings(height_m=0.5),
    "all 64 rows": CameraSettings(height_px=64, vertical_view_deg=70.0, tilt_deg=-20.0),
    "wide": CameraSettings(width_px=100, horizontal_view_deg=110.0),
    "upwards": CameraSettings(tilt_deg=10.0),
}
unhurried = settings(deadline=None)  # the first call of all may have to compile


def with_camera(camera):
    return msgspec.structs.replace(WORLD, camera=camera)


def look(world, state, robot=0, side=0):
    """Return features (objects, 11) and areas (objects,)."""
    robots = len(state) - 1
    features, areas = np.zeros((object_count(robots), FEATURES)), np.zeros(object_count(robots))
    see(camera_params(world), state, robot, side, make_retina(world), features, areas)
    return features, areas


def state_of(*poses):
    """Return a state of robots (x, y, heading in degrees) and in the end the ball (x, y)."""
    state = np.zeros((len(poses), 6))
    for row, (x, y, *heading) in zip(state, poses, strict=True):
        row[:3] = x, y, math.radians(heading[0]) if heading else 0.0
    return state


def random_state(rng, robots):
    """Return a state without overlaps; every second one is crowded around robot 0."""
    crowded = rng.random() < 0.5
    radii = np.array([RADII[0]] * robots + [RADII[1]])
    state = np.zeros((robots + 1, 6))
    for body, radius in enumerate(radii):
        low, high = np.array([radius, radius]), np.array([LENGTH - radius, WIDTH - radius])
        gaps, inside = np.array([-1.0]), True
        while not inside or np.any(gaps <= 0.0):
            place = rng.uniform(low, high)
            if crowded and body > 0:
                place = state[0, :2] + rng.normal(0.0, 0.6, 2)
            inside = np.all((place >= low) & (place <= high))
            gaps = np.hypot(*(state[:body, :2] - place).T) - radii[:body] - radius
        state[body, :3] = *place, rng.uniform(-math.pi, math.pi)
    return state


def measure(pixels, thing):
    """Return the features of a set of pixels (rows, columns) bool, pixel by pixel."""
    columns = range(pixels.shape[1])
    places = [(c + 0.5, r + 0.5) for c in columns for r in range(pixels.shape[0]) if pixels[r, c]]
    x, y = np.array(places).T
    centre, area = [x.mean(), y.mean()], float(len(places))
    width, height = x.max() - x.min() + 1.0, y.max() - y.min() + 1.0
    if thing == BALL:
        return [*centre, (width + height) / 4.0, area]
    if thing >= ROBOTS:
        return [*centre, width, height, area]
    corners = []
    for a, b in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        # `min` keeps the first of equals, which is the leftmost.
        corners += min(places, key=lambda place, a=a, b=b: a * place[0] + b * place[1])
    return [*centre, *corners, area]


def same_pixels(cast, world, state, robot, side):
    """Return for each object that either way sees whether it is the same, and by how many pixels it differs."""
    features, areas = look(world, state, robot, side)
    hit = cast(world, state, robot, side)
    same, differences = [], []
    for thing, area in enumerate(areas):
        pixels = hit == thing
        if area == 0.0 and not pixels.any():
            continue
        differences.append(abs(area - pixels.sum()))
        expected = measure(pixels, thing) if pixels.any() else []
        same.append(
            differences[-1] == 0.0 and np.allclose(features[thing, : len(expected)], expected, rtol=0.0, atol=1e-9)
        )
    return same, differences


def test_focal_lengths_are_those_of_the_dissertation():
    camera = camera_params(WORLD)
    assert (camera.columns, camera.rows) == (64, 60)
    assert camera.fx == pytest.approx(48.35, abs=0.005)
    assert camera.fy == pytest.approx(51.96, abs=0.005)


@pytest.mark.parametrize("name", CAMERAS)
def test_every_feature_is_that_of_a_ray_cast(name, ray_cast):
    world, rng = with_camera(CAMERAS[name]), np.random.default_rng(1)
    same, differences = [], []
    for trial in range(1000 if name == "standard" else 250):
        robots = 1 + trial % 6
        found = same_pixels(ray_cast, world, random_state(rng, robots), int(rng.integers(robots)), trial // 6 % 2)
        same += found[0]
        differences += found[1]
    assert len(same) > (1000 if name == "standard" else 250)  # enough was in view
    assert np.mean(same) >= 0.999  # measured: all, but the last bit of a sum may decide about a pixel
    assert max(differences) <= 1.0


def test_robots_that_touch_are_those_of_a_ray_cast(ray_cast):
    rng, differences = np.random.default_rng(2), []
    for _ in range(300):
        heading, distance = rng.uniform(-math.pi, math.pi), rng.uniform(0.4, 0.5)
        bearing = heading + rng.uniform(-1.2, 1.2)
        beside = 4.0 + distance * math.cos(bearing), 2.0 + distance * math.sin(bearing)
        state = state_of((4.0, 2.0, math.degrees(heading)), beside, (7.5, 4.2))
        differences += same_pixels(ray_cast, WORLD, state, 0, 0)[1]
    assert len(differences) > 250
    assert max(differences) <= 1.0


def test_a_ball_ahead_is_where_a_pinhole_puts_it():
    camera = camera_params(WORLD)
    for distance in (0.8, 1.5, 3.0):
        features, areas = look(WORLD, state_of((2.0, 2.0, 0.0), (2.0 + distance, 2.0)))
        below = math.atan2(camera.height - RADII[1], distance) - math.radians(26.0)
        reach = math.hypot(distance, camera.height - RADII[1]) * math.cos(below)
        assert features[BALL, 0] == 32.0
        assert features[BALL, 1] == pytest.approx(30.0 + camera.fy * math.tan(below), abs=0.3)
        assert areas[BALL] == pytest.approx(
            math.pi * camera.fx * camera.fy * (RADII[1] / reach) ** 2, rel=0.08, abs=2.0
        )


@st.composite
def scenes(draw, least=1):
    """Draw a state, a robot of it and a side."""
    robots = draw(st.integers(least, 6))
    state = random_state(np.random.default_rng(draw(st.integers(0, 2**32 - 1))), robots)
    return state, draw(st.integers(0, robots - 1)), draw(st.integers(0, 1))


@unhurried
@given(scenes())
def test_a_mirrored_world_looks_mirrored(scene):
    state, robot, side = scene
    mirrored = state.copy()
    mirrored[:, 1] = WIDTH - state[:, 1]
    mirrored[:, 2] = -state[:, 2]
    features, areas = look(WORLD, state, robot, side)
    reflected, same_areas = look(WORLD, mirrored, robot, side)
    assert same_areas.tolist() == areas.tolist()
    for thing in np.flatnonzero(areas):
        there, here = reflected[thing], features[thing]
        assert there[:2] == pytest.approx([64.0 - here[0], here[1]])
        if thing not in (OWN_GOAL, OPPONENT_GOAL):
            assert there[2:5] == pytest.approx(here[2:5])
            continue
        # Among equally good corners the leftmost is taken, in either world: compare how far out they are.
        assert 64.0 - there[4] + there[5] == here[2] + here[3]
        assert 64.0 - there[2] - there[3] == here[4] - here[5]
        assert 64.0 - there[8] - there[9] == here[6] - here[7]
        assert 64.0 - there[6] + there[7] == here[8] + here[9]


@unhurried
@given(scenes())
def test_the_field_turned_by_half_looks_the_same_to_the_other_side(scene):
    state, robot, side = scene
    turned = state.copy()
    turned[:, :2] = (LENGTH, WIDTH) - state[:, :2]
    turned[:, 2] += math.pi
    for one, other in zip(look(WORLD, state, robot, side), look(WORLD, turned, robot, 1 - side), strict=True):
        assert other == pytest.approx(one, abs=1e-9)


@unhurried
@given(scenes())
def test_the_other_side_calls_the_goals_by_the_other_name(scene):
    state, robot, _ = scene
    ours, theirs = look(WORLD, state, robot, 0), look(WORLD, state, robot, 1)
    swapped = [BALL, OPPONENT_GOAL, OWN_GOAL, *range(ROBOTS, object_count(len(state) - 1))]
    for one, other in zip(ours, theirs, strict=True):
        assert other[swapped].tolist() == one.tolist()


@unhurried
@given(scenes(least=3))
def test_what_is_nearer_does_not_change_with_what_is_farther(scene):
    state, _, side = scene
    power = np.sum((state[:, :2] - state[0, :2]) ** 2, axis=1) - np.append(np.full(len(state) - 1, 0.04), RADII[1] ** 2)
    order = [0, *(1 + np.argsort(power[1:-1])), len(state) - 1]  # the farthest robot comes last
    features, areas = look(WORLD, state[order], 0, side)
    alone, alone_areas = look(WORLD, state[[*order[:-2], order[-1]]], 0, side)
    nearer = [*range(ROBOTS, len(alone))]
    if power[-1] < power[order[-2]]:
        nearer.append(BALL)
    assert areas[nearer].tolist() == alone_areas[nearer].tolist()
    visible = [thing for thing in nearer if areas[thing] > 0.0]
    assert features[visible].tolist() == alone[visible].tolist()
    assert np.all(areas[: len(alone)] <= alone_areas)


@unhurried
@given(
    heading=st.floats(-180.0, 180.0),
    near=st.floats(0.5, 1.5),
    gap=st.floats(0.45, 1.0),
    aside=st.floats(-0.05, 0.05),
)
def test_what_stands_behind_a_robot_is_hidden(heading, near, gap, aside):
    angle = math.radians(heading)
    ahead, left = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    here = np.array([LENGTH / 2.0, WIDTH / 2.0])
    before, behind = here + near * ahead, here + (near + gap) * ahead + aside * left
    out_of_sight = here - ahead
    areas = look(WORLD, state_of((*here, heading), before, behind))[1]
    assert areas[ROBOTS] > 0.0
    assert areas[BALL] == 0.0
    areas = look(WORLD, state_of((*here, heading), before, here + (near + gap) * ahead, out_of_sight))[1]
    assert areas[ROBOTS] > 0.0
    assert areas[ROBOTS + 1] == 0.0
    # The nearer one is hidden by nothing, whatever its number.
    areas = look(WORLD, state_of((*here, heading), here + (near + gap) * ahead, before, out_of_sight))[1]
    assert areas[ROBOTS] == 0.0
    assert areas[ROBOTS + 1] > 0.0


@unhurried
@given(
    heading=st.floats(-60.0, 60.0),
    bearings=st.lists(st.floats(100.0, 260.0), min_size=3, max_size=3),
    distance=st.floats(0.45, 1.5),
)
def test_nothing_behind_the_camera_is_seen(heading, bearings, distance):
    here = np.array([LENGTH / 2.0, WIDTH / 2.0])
    angles = np.radians(heading + np.array(bearings))
    around = here + distance * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    areas = look(WORLD, state_of((*here, heading), *around))[1]
    assert areas[[BALL, OWN_GOAL, ROBOTS, ROBOTS + 1]].tolist() == [0.0] * 4
    facing_back = look(WORLD, state_of((*here, heading + 180.0), *around))[1]
    assert facing_back[OPPONENT_GOAL] == 0.0


def test_a_goal_is_not_seen_from_inside_it():
    inside = state_of((LENGTH + 0.1, WIDTH / 2.0, 0.0), (4.0, 1.0))
    assert not look(WORLD, inside)[1].any()
    inside[0, 2] = math.pi
    areas = look(WORLD, inside)[1]
    assert areas[OWN_GOAL] > 0.0
    assert areas[OPPONENT_GOAL] == 0.0
