"""The defender of 4.5.2: where it drives, and how fast."""

from __future__ import annotations

import numpy as np
import pytest

from behaviors.measuring import watch
from behaviors.recipe import Recipe
from behaviors.trials.solo import provisional_skill
from coevo.config import check

MINE = {"name": "mine", "task": "shoot", "objects": [{"kind": "ball"}, {"kind": "robot"}], "time_limit_steps": 150}


def ways(kind, speed):
    """Return (steps + 1, 2) places of the other robot, of the ball and of the learner, for a few trials."""
    recipe = check(Recipe, {**MINE, "starts": "anywhere", "mover": {"kind": kind, "speed": speed}}, "mine")
    for one in watch(recipe, provisional_skill(recipe), games=8, seed=4):
        states = one.trace.states
        yield states[:, 1, :2], states[:, 2, :2], states[:, 0, :2], recipe.world


@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_it_drives_at_the_ball_no_faster_than_it_may(speed):
    nearer, heading = [], []
    for robot, ball, learner, world in ways("ball-chaser", speed):
        moved = np.linalg.norm(np.diff(robot, axis=0), axis=1) / world.physics.step_s
        assert moved.max() <= speed * world.robot.max_speed_mps * 1.05
        nearer.append(np.linalg.norm(robot[0] - ball[0]) - np.linalg.norm(robot - ball, axis=1).min())
        for target in (ball, learner):
            to = (target - robot)[:-1]
            along = (np.diff(robot, axis=0) * to).sum(axis=1) / np.linalg.norm(to, axis=1)
            heading.append(along.sum())
    assert min(nearer) > 0.0
    assert sum(heading[::2]) > sum(heading[1::2])  # towards the ball rather than the learner


def test_it_stands_at_speed_zero():
    stood = 0
    for robot, ball, learner, _ in ways("ball-chaser", 0.0):
        alone = min(np.linalg.norm(robot - other, axis=1).min() for other in (ball, learner)) > 0.6
        stood += alone
        assert not alone or np.allclose(robot, robot[0], atol=1e-9)
    assert stood


def test_it_is_not_the_one_that_drives_at_the_learner():
    other = [robot for robot, *_ in ways("chaser", 1.0)]
    mine = [robot for robot, *_ in ways("ball-chaser", 1.0)]
    assert any(len(a) != len(b) or not np.allclose(a, b) for a, b in zip(mine, other, strict=True))
