"""Noise of what is seen and of what is driven: its distribution, and what it leaves alone."""

from __future__ import annotations

import math

import msgspec
import numpy as np
from scipy import stats

from coevo.config import CameraSettings, RobotSettings, WorldSettings
from coevo.soccer.camera import BALL, FEATURES, OPPONENT_GOAL, OWN_GOAL, ROBOTS, camera_params
from coevo.soccer.noise import blur_sight, shake_drive
from coevo.soccer.physics import physics_params


def test_sensor_noise_has_the_cameras_deviation_in_each_coordinate():
    world = msgspec.structs.replace(WorldSettings(), camera=CameraSettings(noise_px=1.5))
    camera, rng = camera_params(world), np.array([1], np.uint64)
    count, objects = 4000, ROBOTS + 1
    clean = np.full((objects, FEATURES), 30.0)
    drawn, areas = np.empty((count, objects, FEATURES)), np.empty((count, objects))
    for n in range(count):
        drawn[n], areas[n] = clean, (100.0, 400.0, 0.0, 225.0)
        blur_sight(camera, objects, drawn[n], areas[n], rng)
    assert np.all(drawn[:, OPPONENT_GOAL] == 30.0)  # not visible, nothing to disturb
    assert not areas[:, OPPONENT_GOAL].any()
    for thing, last, area in ((BALL, 3, 100.0), (OWN_GOAL, 10, 400.0), (ROBOTS, 4, 225.0)):
        for k in range(last):
            assert stats.kstest((drawn[:, thing, k] - 30.0) / 1.5, "norm").pvalue > 0.001
        # An area is disturbed along its outline, which grows with its root.
        assert stats.kstest((areas[:, thing] - area) / (1.5 * math.sqrt(area)), "norm").pvalue > 0.001
        assert np.array_equal(drawn[:, thing, last], areas[:, thing])
        assert np.all(drawn[:, thing, last + 1 :] == 30.0)
    everything = np.concatenate([drawn[:, BALL, :3], drawn[:, OWN_GOAL, :10], drawn[:, ROBOTS, :4]], axis=1)
    correlation = np.corrcoef(everything.T) - np.eye(17)
    assert np.abs(correlation).max() < 5.0 / math.sqrt(count)


def test_noise_never_makes_a_visible_object_vanish():
    world = msgspec.structs.replace(WorldSettings(), camera=CameraSettings(noise_px=20.0))
    camera, rng = camera_params(world), np.array([1], np.uint64)
    for _ in range(300):
        features, areas = np.zeros((ROBOTS, FEATURES)), np.ones(ROBOTS)
        blur_sight(camera, ROBOTS, features, areas, rng)
        assert areas.min() >= 1.0


def test_what_stands_for_the_nearest_robot_is_left_to_the_objects_it_is_a_copy_of():
    world = msgspec.structs.replace(WorldSettings(), camera=CameraSettings(noise_px=1.5))
    features, areas = np.full((ROBOTS + 2, FEATURES), 30.0), np.full(ROBOTS + 2, 100.0)
    blur_sight(camera_params(world), ROBOTS + 1, features, areas, np.array([1], np.uint64))
    assert (features[: ROBOTS + 1, 0] != 30.0).all()
    assert (features[-1] == 30.0).all()
    assert areas[-1] == 100.0


def test_actuator_noise_scales_speed_and_turn_rate_of_one_robot_each_by_its_own():
    world = msgspec.structs.replace(WorldSettings(), robot=RobotSettings(actuator_noise=0.1))
    physics, rng = physics_params(world), np.array([3], np.uint64)
    told, drawn = np.array([[0.5, -1.0], [0.8, 0.0], [0.0, 2.0]]), np.empty((4000, 2))
    for row in drawn:
        commands = told.copy()
        shake_drive(physics, commands, 0, rng)
        assert np.array_equal(commands[1:], told[1:])
        row[:] = commands[0]
    factors = drawn / told[0] - 1.0
    for column in factors.T:
        assert stats.kstest(column / 0.1, "norm").pvalue > 0.001
    assert abs(np.corrcoef(factors.T)[0, 1]) < 4.0 / math.sqrt(len(factors))
