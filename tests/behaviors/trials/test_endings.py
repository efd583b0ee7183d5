"""How trials end: the events of each task, and which comes first."""

from __future__ import annotations

import numpy as np

from behaviors.recipe import (
    read_recipe,
)
from behaviors.trials import task as tasks
from behaviors.trials.solo import provisional_skill, solo_scene
from behaviors.trials.task import COLLIDED, COLLISION, FAILURE, GOING, SUCCEEDED, SUCCESS
from coevo.compiled import entry
from coevo.soccer.camera import BALL
from coevo.soccer.events import record_contacts
from coevo.stage import LEARNER


@entry
def judge(task, stage, tally, time):
    """Let a step be over, with the gaps that the stage holds, and judge it."""
    body = stage.body
    record_contacts(stage.limits, stage.roles.team, time, body.ball_gap, body.robot_gap, stage.events)
    return tasks.judge(task, stage, tally)


def verdict(
    name, *, ball=(4.0, 2.0), robot=(3.0, 2.0), gaps=(1.0, 1.0), robots_apart=1.0, sees_ball=False, before=(), time=100
):
    """Return how a trial stands in a situation; ``before``: (time, gaps to the ball) of steps that came before."""
    recipe = read_recipe(name)
    scene = solo_scene(recipe, provisional_skill(recipe), LEARNER)
    stage, tally = scene.venue.stage, scene.trial.tally
    body, robots = stage.body, len(stage.roles.role)
    body.state[-1, :2], body.state[0, :2] = ball, robot
    stage.memory.areas[0, BALL] = 5.0 if sees_ball else 0.0
    body.robot_gap[:] = 1.0
    for step, earlier in before:
        body.ball_gap[:] = earlier[:robots]
        assert judge(scene.trial.task, stage, tally, step) == GOING
    body.ball_gap[:], body.robot_gap[:] = gaps[:robots], robots_apart
    tally.rewards[:] = 7.0  # of the step before
    found = judge(scene.trial.task, stage, tally, time)
    rewards = np.zeros_like(tally.rewards)
    rewards[0, SUCCEEDED], rewards[0, COLLIDED] = found == SUCCESS, found == COLLISION
    assert np.array_equal(tally.rewards, rewards)
    return found


LINE = read_recipe("shoot").world.field.length_m


def test_shooting_ends_with_a_goal_and_a_goal_comes_before_all_else():
    assert verdict("shoot") == GOING
    assert verdict("shoot", ball=(LINE, 2.0)) == GOING  # on the line
    assert verdict("shoot", ball=(LINE + 1e-6, 2.0)) == SUCCESS
    assert verdict("shoot", ball=(LINE + 0.1, 2.0), robot=(LINE + 0.01, 2.0)) == SUCCESS  # it may follow the ball
    assert verdict("shoot", robot=(LINE + 0.01, 2.0)) == FAILURE
    assert verdict("shoot", robot=(-0.01, 2.0)) == FAILURE
    assert verdict("shoot", ball=(-1e-6, 2.0)) == FAILURE
    assert verdict("shoot", sees_ball=True) == GOING


def test_passing_ends_with_the_game_s_own_event():
    learner, mate, nobody, both = (0.0, 1.0), (1.0, 0.0), (1.0, 1.0), (0.0, 0.0)
    assert verdict("pass", gaps=learner) == GOING
    assert verdict("pass", gaps=mate) == GOING  # the mate alone
    assert verdict("pass", before=[(10, learner)], gaps=mate) == SUCCESS
    assert verdict("pass", before=[(9, learner)], gaps=mate) == GOING  # more than 3 s, 90 steps, later
    assert verdict("pass", before=[(98, learner), (99, nobody)], gaps=mate) == SUCCESS
    assert verdict("pass", before=[(99, learner)], gaps=(1.0, 0.005)) == GOING
    assert verdict("pass", before=[(99, learner)], gaps=both) == GOING  # it has not let go
    assert verdict("pass", before=[(98, learner), (99, both)], gaps=mate) == GOING  # the mate held it before it let go
    assert verdict("pass", robots_apart=0.004) == COLLISION
    assert verdict("pass", robots_apart=0.005) == GOING
    assert verdict("pass", ball=(LINE + 0.1, 2.0)) == FAILURE


def test_the_window_of_a_pass_is_that_of_the_world_s_rules():
    recipe = read_recipe("pass", ["world.rules.pass_window_s=1.0"])
    assert solo_scene(recipe, provisional_skill(recipe), LEARNER).venue.stage.limits.pass_window == 30


def test_avoiding_ends_with_a_collision_only():
    assert verdict("avoid", robots_apart=0.004) == COLLISION
    assert verdict("avoid", robots_apart=0.005) == GOING
    assert verdict("avoid", ball=(LINE + 0.1, 2.0), robot=(-0.1, 2.0), gaps=(0.0, 0.0), sees_ball=True) == GOING


def test_searching_ends_when_the_ball_is_seen():
    assert verdict("search") == GOING
    assert verdict("search", sees_ball=True) == SUCCESS
