"""Where trials start: what the recipes ask for, by an independent look at the world."""

from __future__ import annotations

import math
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from scipy import stats

from behaviors.recipe import Recipe, read_recipe
from behaviors.settings import MoverSettings
from behaviors.trials.solo import provisional_skill, solo_scene
from behaviors.trials.starts import start_one
from coevo.compiled import entry
from coevo.config import check
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
from coevo.stage import SKILL

TASKS = ("shoot", "pass", "avoid", "search", "defend", "home")


def recipe_of(name):
    """Return the recipe of an installed skill, or one of a task that none of these has."""
    if name not in ("defend", "home"):
        return read_recipe(name)
    parts = {"mover": {"kind": "skill", "skill": "shoot"}} if name == "defend" else {}
    return check(Recipe, {"name": name, "task": name, "objects": [{"kind": "own_goal"}], **parts}, name)


@entry
def _starts(task, stage, ease, in_view, states, rng):
    """Draw starts (starts, bodies, 6), one after the other."""
    for n in range(states.shape[0]):
        if not start_one(task, stage, ease, in_view, rng):
            return False
        states[n] = stage.body.state
    return True


def robots_of(recipe):
    return 1 if recipe.mover.kind == "none" else 2


def starts(recipe, count, *, ease=0.0, in_view=True, seed=1):
    """Return (count, bodies, 6) starts, or None if one was not found."""
    scene = solo_scene(recipe, provisional_skill(recipe), SKILL)
    states = np.full((count, robots_of(recipe) + 1, 6), np.nan)
    found = _starts(scene.trial.task, scene.venue.stage, ease, in_view, states, np.array([seed], np.uint64))
    return states if found else None


def areas_seen(recipe, state):
    """Return (objects,) area that robot 0 sees of each object, with an eye of its own."""
    robots = len(state) - 1
    features, areas = np.zeros((object_count(robots), FEATURES)), np.zeros(object_count(robots))
    see(camera_params(recipe.world), state, 0, 0, make_retina(recipe.world), features, areas)
    return areas


def sees(task, areas):
    """Tell whether a robot sees what its task is about."""
    return {
        "shoot": areas[BALL] > 0.0 and areas[OPPONENT_GOAL] > 0.0,
        "pass": areas[BALL] > 0.0 and areas[ROBOTS:].any(),
        "avoid": bool(areas[ROBOTS:].any()),
        "search": areas[BALL] <= 0.0,
        "defend": areas[BALL] > 0.0,
        "home": areas[OWN_GOAL] > 0.0,
    }[task]


def apart(state, one, two):
    return np.hypot(*(state[..., one, :2] - state[..., two, :2]).T).T


def radii(recipe, robots):
    return [recipe.world.robot.radius_m] * robots + [recipe.world.ball.radius_m]


def uniform_starts(recipe, count, rng, *, in_view):
    """Return starts drawn by definition: everything anywhere, until it is as the task wants it."""
    field, robots = recipe.world.field, robots_of(recipe)
    sizes, found = radii(recipe, robots), []
    while len(found) < count:
        state = np.zeros((robots + 1, 6))
        for body, radius in enumerate(sizes):
            margin = radius + 0.05
            state[body, :2] = rng.uniform((margin, margin), (field.length_m - margin, field.width_m - margin))
        state[:robots, 2] = rng.uniform(-math.pi, math.pi, robots)
        pairs = [(i, j) for i in range(robots + 1) for j in range(i)]
        if any(apart(state, i, j) < sizes[i] + sizes[j] + 0.05 for i, j in pairs):
            continue
        if recipe.task == "avoid" and not 0.7 <= apart(state, 0, 1) <= 2.0:
            continue
        if (in_view or recipe.task == "search") and not sees(recipe.task, areas_seen(recipe, state)):
            continue
        found.append(state)
    return np.array(found)


@pytest.mark.parametrize("name", TASKS)
def test_starts_in_view_really_see_what_the_task_is_about(name):
    recipe = recipe_of(name)
    for ease in (0.0, 0.5, 1.0):
        for state in starts(recipe, 150, ease=ease):
            assert sees(name, areas_seen(recipe, state))


@pytest.mark.parametrize("in_view", [True, False], ids=["in-view", "anywhere"])
@pytest.mark.parametrize("name", TASKS)
def test_bodies_start_apart_on_the_field_and_at_rest(name, in_view):
    recipe = recipe_of(name)
    states = starts(recipe, 300, in_view=in_view)
    robots, field = states.shape[1] - 1, recipe.world.field
    sizes = radii(recipe, robots)
    assert not states[:, :, 3:].any()
    for body, radius in enumerate(sizes):
        assert states[:, body, 0].min() >= radius + 0.05
        assert states[:, body, 0].max() <= field.length_m - radius - 0.05
        assert states[:, body, 1].min() >= radius + 0.05
        assert states[:, body, 1].max() <= field.width_m - radius - 0.05
        for other in range(body):
            assert apart(states, body, other).min() >= radius + sizes[other] + 0.05
    if name == "avoid":
        assert 0.7 <= apart(states, 0, 1).min() <= apart(states, 0, 1).max() <= 2.0


@pytest.mark.parametrize("in_view", [True, False], ids=["in-view", "anywhere"])
@pytest.mark.parametrize("name", [name for name in TASKS if name != "defend"])
def test_starts_have_the_distribution_of_the_definition(name, in_view):
    recipe = recipe_of(name)
    drawn = starts(recipe, 1500, in_view=in_view)
    expected = uniform_starts(recipe, 700, np.random.default_rng(1), in_view=in_view)
    for body in range(drawn.shape[1]):
        for k in range(3 if body < drawn.shape[1] - 1 else 2):
            assert stats.ks_2samp(drawn[:, body, k], expected[:, body, k]).pvalue > 0.001, (body, k)
        for other in range(body):
            assert stats.ks_2samp(apart(drawn, body, other), apart(expected, body, other)).pvalue > 0.001


def test_starts_anywhere_are_uniform_on_the_field_whatever_is_seen():
    recipe = read_recipe("shoot")
    states = starts(recipe, 4000, in_view=False)
    field, sizes = recipe.world.field, radii(recipe, 1)
    for body, radius in enumerate(sizes):
        for k, size in enumerate((field.length_m, field.width_m)):
            share = (states[:, body, k] - radius - 0.05) / (size - 2.0 * (radius + 0.05))
            assert stats.kstest(share, "uniform").pvalue > 0.001
    assert stats.kstest(states[:, 0, 2] / (2.0 * math.pi) + 0.5, "uniform").pvalue > 0.001
    seen = [sees("shoot", areas_seen(recipe, state)) for state in states[:500]]
    assert 0.02 < np.mean(seen) < 0.5


@pytest.mark.parametrize("name", ["shoot", "pass", "search"])
def test_easy_starts_are_near(name):
    recipe = recipe_of(name)
    goal = np.array([recipe.world.field.length_m, 0.5 * recipe.world.field.width_m])
    diagonal = math.hypot(recipe.world.field.length_m, recipe.world.field.width_m)
    farthest = []
    for ease in (1.0, 0.9, 0.5, 0.0):
        states = starts(recipe, 300, ease=ease)
        to_ball = apart(states, 0, -1)
        assert to_ball.max() <= 0.6 + (1.0 - ease) * diagonal
        if name == "shoot":
            assert np.hypot(*(states[:, -1, :2] - goal).T).max() <= 1.0 + (1.0 - ease) * diagonal
        if name == "pass":
            assert apart(states, 1, -1).max() <= 1.0 + (1.0 - ease) * diagonal
        farthest.append(to_ball.mean())
    assert all(near < far for near, far in pairwise(farthest))


def test_no_start_is_found_where_there_is_none():
    # A camera that looks at its own feet never sees goal and ball at once from afar.
    recipe = read_recipe("shoot")
    camera = msgspec.structs.replace(recipe.world.camera, tilt_deg=-50.0, vertical_view_deg=10.0)
    recipe = msgspec.structs.replace(recipe, world=msgspec.structs.replace(recipe.world, camera=camera))
    assert starts(recipe, 1) is None
    assert starts(recipe, 1, in_view=False) is not None


def test_a_chaser_and_its_like_are_part_of_the_recipe():
    plain = {"name": "mine", "task": "shoot", "objects": [{"kind": "ball"}]}
    recipe = check(Recipe, {**plain, "task": "avoid", "mover": {"kind": "chaser", "speed": 0.3}}, "mine.toml")
    assert recipe.mover == MoverSettings(kind="chaser", speed=0.3)
    for one, robots in ((recipe, 2), (check(Recipe, plain, "mine.toml"), 1)):
        scene = solo_scene(one, provisional_skill(one), SKILL)
        assert len(scene.venue.stage.roles.role) == len(scene.minds) == robots


@pytest.mark.parametrize("in_view", [True, False], ids=["in-view", "anywhere"])
def test_an_attack_comes_from_beyond_the_ball_towards_the_defender_s_goal(in_view):
    recipe = recipe_of("defend")
    states = starts(recipe, 1500, in_view=in_view)
    goal = np.array([0.0, 0.5 * recipe.world.field.width_m])
    to_goal = {body: np.hypot(*(states[:, body, :2] - goal).T) for body in (0, 2)}
    assert 4.8 < to_goal[2].max() <= 5.0
    assert 3.8 < to_goal[0].max() <= 4.0
    assert 1.15 < apart(states, 1, 2).max() <= 1.2
    assert (states[:, 1, 0] > states[:, 2, 0]).all()
    to_ball = np.arctan2(*(states[:, 2, :2] - states[:, 1, :2]).T[::-1])
    off = np.angle(np.exp(1j * (states[:, 1, 2] - to_ball)))
    assert stats.kstest(off, "uniform", (-0.7, 1.4)).pvalue > 0.001
    if not in_view:
        assert stats.kstest(states[:, 0, 2], "uniform", (-math.pi, 2.0 * math.pi)).pvalue > 0.001
