"""The controller that knows the true state: what it does where the right thing is known, and what it comes to."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from behaviors.learning import evaluate
from behaviors.recipe import read_recipe
from behaviors.settings import MoverSettings
from behaviors.trials.informed import informed_action
from behaviors.trials.solo import provisional_skill, solo_scene
from coevo.stage import INFORMED

GOAL = (8.22, 4.575 / 2)


def scene_of(name, drive="pws"):
    recipe = read_recipe(name)
    robot = msgspec.structs.replace(recipe.world.robot, drive=drive)
    recipe = msgspec.structs.replace(recipe, world=msgspec.structs.replace(recipe.world, robot=robot))
    return solo_scene(recipe, provisional_skill(recipe), INFORMED)


def code(scene, *bodies):
    """Return (v, omega) in {-1, 0, 1} that the controller chooses; bodies are (x, y, heading), the ball last."""
    state = np.zeros((len(bodies), 6))
    state[:, :3] = bodies
    stage = scene.venue.stage
    return tuple(stage.drive.codes[informed_action(scene.trial.task, stage.physics, state, stage.drive.commands)])


@pytest.mark.parametrize("drive", ["pws", "4ws"])
def test_behind_the_ball_it_drives_straight_on(drive):
    scene, y = scene_of("shoot", drive), GOAL[1]
    assert code(scene, (4.0, y, 0.0), (4.6, y, 0.0)) == (1.0, 0.0)
    assert code(scene, (4.0, y, 0.6), (4.6, y, 0.0)) == (1.0, -1.0)
    assert code(scene, (4.0, y, -0.6), (4.6, y, 0.0)) == (1.0, 1.0)


def test_before_the_ball_it_does_not_push_it_towards_its_own_goal():
    scene, y = scene_of("shoot"), GOAL[1]
    speed, turn = code(scene, (5.0, y, math.pi), (4.4, y, 0.0))
    assert turn != 0.0 or speed <= 0.0


def test_what_it_does_is_the_same_in_the_mirror():
    scene, rng, wide = scene_of("shoot"), np.random.default_rng(3), 2 * GOAL[1]
    for _ in range(200):
        robot, ball = rng.uniform((0.3, 0.3, -3.0), (7.9, 4.2, 3.0)), rng.uniform((0.5, 0.5, 0.0), (7.7, 4.0, 0.0))
        speed, turn = code(scene, robot, ball)
        mirrored = code(scene, (robot[0], wide - robot[1], -robot[2]), (ball[0], wide - ball[1], 0.0))
        assert mirrored == (speed, -turn)


def test_it_turns_to_the_ball_when_it_searches():
    scene = scene_of("search")
    assert code(scene, (4.0, 2.0, 0.0), (4.0, 3.5, 0.0))[1] == 1.0
    assert code(scene, (4.0, 2.0, 0.0), (4.0, 0.5, 0.0))[1] == -1.0


def test_it_gets_away_from_a_robot_in_front_of_it():
    scene = scene_of("avoid")
    assert code(scene, (4.0, 2.3, 0.0), (4.7, 2.3, 0.0), (1.0, 1.0, 0.0))[0] == -1.0
    assert code(scene, (4.0, 2.3, math.pi), (4.7, 2.3, 0.0), (1.0, 1.0, 0.0))[0] == 1.0


@pytest.mark.parametrize(
    ("name", "mover", "least"),
    [("shoot", None, 0.9), ("pass", None, 0.75), ("search", None, 0.97), ("avoid", MoverSettings(kind="random"), 0.95)],
)
def test_it_shows_what_the_tasks_allow(name, mover, least):
    assert evaluate(read_recipe(name), "informed", games=100, seed=4, mover=mover).success_rate >= least
