"""The OpenCV camera: what it paints, what it measures by colour, and that the analytic camera agrees."""

from __future__ import annotations

import itertools
import math

import cv2
import msgspec
import numpy as np
import pytest

from coevo.config import CameraSettings, WorldSettings
from coevo.errors import InputError
from coevo.soccer import vision
from coevo.soccer.camera import (
    BALL,
    FEATURES,
    GOAL_FEATURES,
    OPPONENT_GOAL,
    OWN_GOAL,
    ROBOTS,
    camera_params,
    make_retina,
    object_count,
    see,
)
from coevo.soccer.vision import BALL_HUE, GOAL_HUES, HUE_TOLERANCE, ROBOT_HUES, colour_regions, extract, render

WORLD = WorldSettings()
LENGTH, WIDTH = WORLD.field.length_m, WORLD.field.width_m
HUES = [BALL_HUE, *GOAL_HUES, *ROBOT_HUES]
HIGH = CameraSettings(height_m=0.8, tilt_deg=-35.0, width_px=48, height_px=64)
LOW = CameraSettings(height_m=0.35, tilt_deg=-10.0, width_px=40, height_px=30)


def with_camera(camera):
    return msgspec.structs.replace(WORLD, camera=camera)


def look(world, state, robot, side):
    robots = len(state) - 1
    features, areas = np.zeros((object_count(robots), FEATURES)), np.zeros(object_count(robots))
    see(camera_params(world), state, robot, side, make_retina(world), features, areas)
    return features, areas


def scenes(count, robots=4, seed=1):
    """Yield states without overlaps (every second one crowded), a robot, and a side."""
    rng = np.random.default_rng(seed)
    radii = np.array([WORLD.robot.radius_m] * robots + [WORLD.ball.radius_m])
    for trial in range(count):
        state, gaps = np.zeros((robots + 1, 6)), np.array([-1.0])
        while np.any(gaps <= 0.0):
            places = rng.uniform((0.2, 0.2), (LENGTH - 0.2, WIDTH - 0.2), (robots + 1, 2))
            if trial % 2 == 1:
                places[1:] = np.clip(places[0] + rng.normal(0.0, 0.7, (robots, 2)), 0.2, (LENGTH - 0.2, WIDTH - 0.2))
            pairs = itertools.combinations(range(robots + 1), 2)
            gaps = np.array([math.dist(places[a], places[b]) - radii[a] - radii[b] for a, b in pairs])
        state[:, :2], state[:, 2] = places, rng.uniform(-math.pi, math.pi, robots + 1)
        yield state, trial % robots, trial // 2 % 2


def compare(world, count, size_px=None, supersample=5):
    """Return, over many scenes: share of agreement on visibility, and of what both see kind and differences."""
    agreed, rows = [], []
    for state, robot, side in scenes(count):
        features, areas = look(world, state, robot, side)
        painted, painted_areas = extract(
            render(world, state, robot, size_px=size_px, supersample=supersample), world, len(state) - 1, robot, side
        )
        agreed += ((areas > 0.0) == (painted_areas > 0.0)).tolist()
        for thing in np.flatnonzero((areas > 0.0) & (painted_areas > 0.0)):
            gap = np.abs(painted[thing] - features[thing])
            rest = gap[2:10] if thing in (OWN_GOAL, OPPONENT_GOAL) else gap[2 : 3 if thing == BALL else 4]
            same = np.array_equal(painted[thing], features[thing])
            rows.append((min(thing, ROBOTS), gap[:2].max(), painted_areas[thing], areas[thing], rest.max(), same))
    return np.mean(agreed), np.array(rows, float)


@pytest.mark.parametrize("camera", [WORLD.camera, HIGH, LOW], ids=["standard", "high", "low"])
def test_the_image_agrees_with_the_analytic_camera(camera):
    agreed, rows = compare(with_camera(camera), 300)
    assert agreed >= 0.998
    for thing in range(4):  # ball, goals, robots
        _, centre, painted, area, rest, same = rows[rows[:, 0] == thing].T
        assert len(area) >= 40
        # Measured: mean 0.03 pixels, 99 % within 0.3. OpenCV's outline would make areas 1 to 3 % larger.
        assert centre.mean() < 0.06
        assert centre.max() <= 1.0
        assert painted.sum() == pytest.approx(area.sum(), rel=0.008)
        assert np.all(np.abs(painted - area) <= np.sqrt(area))
        assert np.quantile(rest, 0.95) <= 1.0  # widths, heights and corners
        assert same.mean() >= 0.5  # every pixel counts


def test_without_supersampling_it_agrees_to_about_a_pixel():
    agreed, rows = compare(WORLD, 300, supersample=1)
    _, centre, painted, area, rest, _ = rows.T
    assert agreed >= 0.995
    assert centre.mean() < 0.15
    assert centre.max() <= 1.5
    assert painted.sum() == pytest.approx(area.sum(), rel=0.02)
    assert np.quantile(rest, 0.95) <= 2.0


@pytest.mark.parametrize("size_px", [(320, 300), (200, 100)])
def test_features_of_a_larger_image_are_in_pixels_of_the_camera(size_px):
    agreed, rows = compare(WORLD, 100, size_px=size_px, supersample=1)
    _, centre, painted, area, rest, _ = rows.T
    assert agreed >= 0.99
    assert centre.mean() < 0.25
    assert centre.max() <= 2.0
    assert painted.sum() == pytest.approx(area.sum(), rel=0.01)
    assert np.quantile(rest, 0.9) <= 2.0


def test_every_object_has_its_colour_at_its_centre():
    state = np.zeros((7, 6))
    state[:, :2] = [(2, 2.3), (3.2, 3.0), (3.6, 1.5), (4.2, 2.9), (4.6, 1.9), (6.5, 3.1), (3.1, 2.3)]
    features, areas = look(WORLD, state, 0, 0)
    hsv = cv2.cvtColor(render(WORLD, state, 0, size_px=(640, 600), supersample=1), cv2.COLOR_BGR2HSV)
    seen = [BALL, OPPONENT_GOAL, *range(ROBOTS, ROBOTS + 5)]
    assert np.flatnonzero(areas).tolist() == seen
    hues = dict(zip(seen, [BALL_HUE, GOAL_HUES[1], *ROBOT_HUES[1:]], strict=True))
    for thing in (BALL, *range(ROBOTS, ROBOTS + 5)):
        x, y = (10.0 * features[thing, :2]).astype(int)
        assert abs(int(hsv[y, x, 0]) - hues[thing]) <= 1
        assert hsv[y, x, 1] > 200
    assert hsv[-1, 320, 0] == 60  # floor


@pytest.mark.parametrize("side", [0, 1])
def test_the_goal_at_the_origin_is_blue_and_the_other_one_yellow(side):
    for heading, hue, thing in ((math.pi, 120, OWN_GOAL + side), (0.0, 30, OPPONENT_GOAL - side)):
        state = np.array([(4.0, 2.2, heading, 0, 0, 0), (4.0, 4.0, 0, 0, 0, 0)], float)
        image = render(WORLD, state, 0)
        features, areas = extract(image, WORLD, 1, 0, side)
        assert np.flatnonzero(areas).tolist() == [thing]
        assert features[thing, GOAL_FEATURES - 1] == areas[thing]
        x, y = features[thing, :2].astype(int)
        assert cv2.cvtColor(image, cv2.COLOR_BGR2HSV)[y, x, 0] == hue


def test_no_two_objects_have_colours_that_can_be_confused():
    turns = [min(abs(a - b), 180 - abs(a - b)) for a, b in itertools.combinations([*HUES, 60], 2)]
    assert min(turns) > 2 * HUE_TOLERANCE
    assert len(ROBOT_HUES) == 6


def test_every_robot_keeps_its_colour_for_whoever_looks():
    state = np.zeros((7, 6))
    state[:, :2] = [(1.0 + body, 2.0 + 0.1 * (-1) ** body) for body in range(7)]
    for robot, other in itertools.permutations(range(6), 2):
        facing = state.copy()
        facing[robot, 2] = math.atan2(*(state[other, :2] - state[robot, :2])[::-1])
        nothing_between = [body for body in range(7) if min(robot, other) < body < max(robot, other)]
        facing[nothing_between, :2] = 0.3, 0.3
        facing[nothing_between, 0] += 0.5 * np.arange(len(nothing_between))
        _, areas = extract(render(WORLD, facing, robot), WORLD, 6, robot, 0)
        thing = ROBOTS + other - (other > robot)
        assert areas[thing] == pytest.approx(look(WORLD, facing, robot, 0)[1][thing], rel=0.05)
        assert areas[thing] > 0.0


def test_without_objects_nothing_has_a_hue():
    for heading in np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False):
        state = np.array([(4.0, 2.0, heading, 0, 0, 0), (1.0, 1.0, 0, 0, 0, 0)], float)
        image = render(WORLD, state, 0)
        _, areas = look(WORLD, state, 0, 0)
        found = colour_regions(image, HUES).any(axis=(1, 2))
        assert found.tolist() == [*(areas[[BALL, OWN_GOAL, OPPONENT_GOAL]] > 0.0), *[False] * 6]


def test_noise_is_survived():
    rng, phantoms, lost, centres, areas_off = np.random.default_rng(3), 0, [], [], []
    for state, robot, side in scenes(100, robots=6):
        clean, clean_areas = extract(render(WORLD, state, robot), WORLD, 6, robot, side)
        image = render(WORLD, state, robot, noise=10.0, rng=rng)
        features, areas = extract(image, WORLD, 6, robot, side, min_region_px=3.0)
        phantoms += np.count_nonzero((areas > 0.0) & (clean_areas == 0.0))
        lost += clean_areas[(areas == 0.0) & (clean_areas > 0.0)].tolist()
        both = (areas > 0.0) & (clean_areas > 0.0)
        centres += np.abs(features - clean)[both, :2].max(axis=1).tolist()
        areas_off += np.abs(areas / np.maximum(clean_areas, 1.0) - 1.0)[both].tolist()
    assert phantoms == 0
    assert max(lost, default=0.0) < 5.0
    assert np.quantile(centres, 0.98) < 0.3
    assert np.quantile(areas_off, 0.95) < 0.05


def test_noise_comes_from_the_generator_alone():
    state = next(scenes(1))[0]
    one, same, other = (render(WORLD, state, 0, noise=5.0, rng=np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)
    clean = render(WORLD, state, 0).astype(float)
    unclipped = (clean > 30.0) & (clean < 225.0)
    assert np.std((one - clean)[unclipped]) == pytest.approx(5.0, rel=0.1)


def test_small_regions_are_left_out_in_pixels_of_the_camera():
    image = np.full((120, 128, 3), 255, np.uint8)
    image[10:12, 10:12] = 0, 0, 255  # 4 pixels, one of the camera
    image[50:60, 50:60] = 0, 0, 255  # 100, or 25 of the camera
    features, areas = extract(image, WORLD, 1, 0, 0)
    assert areas.tolist() == [26.0, 0.0, 0.0]
    features, areas = extract(image, WORLD, 1, 0, 0, min_region_px=2.0)
    assert areas.tolist() == [25.0, 0.0, 0.0]
    assert features[BALL, :4].tolist() == [27.5, 27.5, 2.5, 25.0]
    assert extract(image, WORLD, 1, 0, 0, min_region_px=30.0)[1].tolist() == [0.0, 0.0, 0.0]


def test_corners_are_the_leftmost_of_equals():
    image = np.full((60, 64, 3), 255, np.uint8)
    for row, column in ((10, 20), (11, 19), (12, 20), (11, 21)):  # two pixels tie for each corner
        image[row, column] = 0, 255, 255
    features, areas = extract(image, WORLD, 1, 0, 0)
    assert areas[OPPONENT_GOAL] == 4.0
    expected = [20.5, 11.5, 19.5, 11.5, 20.5, 10.5, 19.5, 11.5, 20.5, 12.5, 4.0]
    assert features[OPPONENT_GOAL].tolist() == expected


def test_a_size_changes_how_much_is_painted_and_not_what():
    state = next(scenes(1, seed=4))[0]
    small = render(WORLD, state, 1)
    large = render(WORLD, state, 1, size_px=(192, 180), supersample=3)
    assert small.shape == (60, 64, 3)
    assert large.shape == (180, 192, 3)
    assert np.mean(np.all(large[1::3, 1::3] == small, axis=2)) > 0.98
    smooth = render(WORLD, state, 1, size_px=(640, 600), smooth=True)
    assert np.abs(cv2.resize(smooth, (64, 60), interpolation=cv2.INTER_AREA).astype(float) - small).mean() < 6.0


def test_what_cannot_be_painted_or_measured_is_refused():
    state = next(scenes(1))[0]
    with pytest.raises(InputError, match="state"):
        render(WORLD, state[:, :3], 0)
    with pytest.raises(InputError, match="number 4 of 4"):
        render(WORLD, state, 4)
    with pytest.raises(InputError, match="supersample odd"):
        render(WORLD, state, 0, supersample=2)
    with pytest.raises(InputError, match="number 0 of 7"):
        extract(render(WORLD, state, 0), WORLD, 7, 0, 0)
    with pytest.raises(InputError, match="uint8"):
        extract(np.zeros((60, 64), np.uint8), WORLD, 4, 0, 0)


def test_a_side_that_shrinks_to_a_point_is_not_painted():
    tiny = 0.7 * vision._TINY
    points = np.array([[3.0, 3.0], [3.0 + tiny, 3.0], [3.0 + 2.0 * tiny, 3.0]])  # each next one is the same point
    assert vision._shrink(points).shape == (0, 2)
    apart = vision._shrink(np.array([[3.0, 3.0], [30.0, 3.0], [30.0, 20.0], [3.0, 20.0]]))
    np.testing.assert_allclose(apart, [[3.5, 3.5], [29.5, 3.5], [29.5, 19.5], [3.5, 19.5]])
