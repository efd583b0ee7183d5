"""How trials end: the events of each task, and which comes first."""

from __future__ import annotations

import numpy as np
import pytest

from behaviors.recipe import Recipe, read_recipe
from behaviors.tabular.table import make_table
from behaviors.trials import task as tasks
from behaviors.trials.solo import provisional_skill, solo_scene
from behaviors.trials.task import (
    BUMPED,
    COLLIDED,
    COLLISION,
    CONCEDED,
    FAILURE,
    GOING,
    KICKED,
    SUCCEEDED,
    SUCCESS,
    TOUCHED,
)
from coevo.compiled import entry
from coevo.config import check
from coevo.soccer.camera import BALL, OWN_GOAL, ROBOTS
from coevo.soccer.events import record_contacts
from coevo.stage import LEARNER, SKILL


@entry
def judge(task, stage, tally, time):
    """Let a step be over, with the gaps that the stage holds, and judge it."""
    body = stage.body
    record_contacts(stage.limits, stage.roles.team, time, body.ball_gap, body.robot_gap, stage.events)
    return tasks.judge(task, stage, tally)


def recipe_of(name):
    """Return the recipe of an installed skill, or one of a task that none of these has."""
    if name not in ("defend", "home"):
        return read_recipe(name)
    parts = {"mover": {"kind": "skill", "skill": "shoot"}} if name == "defend" else {}
    return check(Recipe, {"name": name, "task": name, "objects": [{"kind": "own_goal"}], **parts}, name)


def ignorant(recipe, role):
    """Return the scene of a robot that knows nothing."""
    skill = provisional_skill(recipe)
    return solo_scene(recipe, skill, role, table=make_table(*skill.values.shape))


def verdict(
    name, *, ball=(4.0, 2.0), robot=(3.0, 2.0), gaps=(1.0, 1.0), robots_apart=1.0, sees_ball=False, before=(), time=100
):
    """Return how a trial stands in a situation; ``before``: (time, gaps to the ball) of steps that came before."""
    recipe = recipe_of(name)
    scene = ignorant(recipe, LEARNER)
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
    if name == "defend":
        rewards[0, SUCCEEDED], rewards[0, CONCEDED] = 0.0, found == FAILURE
    contacts = [KICKED, TOUCHED, BUMPED]  # tests/behaviors/actor_critic/test_trials.py
    assert np.array_equal(np.delete(tally.rewards, contacts, axis=1), np.delete(rewards, contacts, axis=1))
    assert (tally.rewards < 7.0).all()
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
    assert ignorant(recipe, LEARNER).venue.stage.limits.pass_window == 30


def test_avoiding_ends_with_a_collision_only():
    assert verdict("avoid", robots_apart=0.004) == COLLISION
    assert verdict("avoid", robots_apart=0.005) == GOING
    assert verdict("avoid", ball=(LINE + 0.1, 2.0), robot=(-0.1, 2.0), gaps=(0.0, 0.0), sees_ball=True) == GOING


def test_searching_ends_when_the_ball_is_seen():
    assert verdict("search") == GOING
    assert verdict("search", sees_ball=True) == SUCCESS


def test_defending_ends_with_a_goal_and_only_the_one_against_it_counts():
    assert verdict("defend") == GOING
    assert verdict("defend", ball=(0.0, 2.0)) == GOING  # on the line
    assert verdict("defend", ball=(-1e-6, 2.0)) == FAILURE
    assert verdict("defend", ball=(LINE + 1e-6, 2.0)) == SUCCESS
    assert verdict("defend", robots_apart=0.0, gaps=(0.0, 0.0)) == GOING  # it may touch the other
    assert verdict("defend", ball=(-0.1, 2.0), robots_apart=0.0) == FAILURE
    assert verdict("defend", robot=(-0.1, 2.0)) == GOING


def test_it_is_home_within_a_metre_of_the_middle_of_its_goal():
    middle = 0.5 * read_recipe("shoot").world.field.width_m
    assert verdict("home", robot=(1.01, middle)) == GOING
    assert verdict("home", robot=(0.99, middle)) == SUCCESS
    assert verdict("home", robot=(0.6, middle + 0.81)) == GOING
    assert verdict("home", robot=(0.6, middle - 0.79)) == SUCCESS
    assert verdict("home", robot=(LINE - 0.5, middle)) == GOING  # the other goal
    assert verdict("home", ball=(-0.1, middle), gaps=(0.0,)) == GOING


# ------------------------------------------------------------------------------------------------- what a skill needs


def ends_of(objects, seen, *, role=LEARNER, patience=5, name="pass"):
    """Return the step in which a trial ends as a failure, None if it goes on, when objects come and go.

    Args:
        objects: of the recipe, kind and whether the skill needs it.
        seen: for each step, the kinds that are in view.
        role: of the robot.
        patience: of the recipe [steps].
        name: of the recipe whose other settings are taken.
    """
    things = {"ball": BALL, "own_goal": OWN_GOAL, "mate": ROBOTS}
    plain = {"name": name, "task": name, "objects": [{"kind": kind, "needed": needed} for kind, needed in objects]}
    recipe = check(Recipe, {**plain, "mover": {"kind": "standing"}, "learning": {"patience_steps": patience}}, name)
    scene = ignorant(recipe, role)
    stage = scene.venue.stage
    stage.body.state[:, :2] = (3.0, 2.0), (5.0, 2.0), (4.0, 3.0)
    stage.body.ball_gap[:] = stage.body.robot_gap[:] = 1.0
    for time, kinds in enumerate(seen):
        stage.memory.areas[0] = 0.0
        stage.memory.areas[0, [things[kind] for kind in kinds]] = 3.0
        found = judge(scene.trial.task, stage, scene.trial.tally, time)
        assert not scene.trial.tally.rewards.any()
        if found != GOING:
            assert found == FAILURE
            return time
    return None


BOTH = ("ball", "mate")


@pytest.mark.parametrize("patience", [0, 1, 5])
def test_a_trial_ends_when_what_the_skill_needs_stays_lost_for_longer_than_its_patience(patience):
    objects, lost = [("ball", True), ("mate", False)], [("mate",)]
    assert ends_of(objects, [BOTH] * 10 + lost * 50, patience=patience) == 10 + patience
    assert ends_of(objects, lost * 50, patience=patience) == patience
    almost = [BOTH] * 3 + lost * patience
    assert ends_of(objects, almost * 10, patience=patience) is None  # seen again, it counts from zero


def test_each_object_that_is_needed_counts_and_no_other():
    objects = [("ball", True), ("mate", True), ("own_goal", False)]
    assert ends_of(objects, [BOTH] * 50) is None
    assert ends_of(objects, [("ball", "own_goal")] * 50) == 5
    assert ends_of(objects, [("mate", "own_goal")] * 50) == 5
    assert ends_of(objects, [("ball",), ("mate",)] * 20) == 5  # never both
    assert ends_of([("ball", False), ("mate", False)], [()] * 50) is None


def test_only_what_learns_is_cut_short():
    assert ends_of([("ball", True)], [()] * 50, role=SKILL) is None


def test_defending_too_needs_what_it_needs():
    assert ends_of([("ball", True)], [("ball",)] * 4 + [()] * 50, name="defend") == 9
