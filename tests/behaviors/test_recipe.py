"""Recipes are checked, and the starts they ask for are what they say, by an independent look at the world."""

from __future__ import annotations

import math
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from scipy import stats

from behaviors.recipe import (
    MoverSettings,
    Recipe,
    installed_recipes,
    is_recipe_of,
    plain_recipe,
    read_recipe,
    recipe_digest,
)
from behaviors.trials.solo import provisional_skill, solo_scene
from behaviors.trials.starts import start_one
from coevo.compiled import entry
from coevo.config import check, to_toml
from coevo.errors import InputError
from coevo.skill import load_skill
from coevo.soccer.camera import (
    BALL,
    FEATURES,
    OPPONENT_GOAL,
    ROBOTS,
    camera_params,
    make_retina,
    object_count,
    see,
)
from coevo.stage import SKILL

TASKS = ("shoot", "pass", "avoid", "search")
PLAIN = {"name": "mine", "task": "shoot", "objects": [{"kind": "ball"}]}


def refused(changes):
    """Return what is said about a recipe that differs from a right one."""
    with pytest.raises(InputError) as caught:
        check(Recipe, {**PLAIN, **changes}, "mine.toml")
    message = str(caught.value)
    assert message.startswith("mine.toml: ")
    assert "\n" not in message
    return message


# ------------------------------------------------------------------------------------------------------------ checking


def test_a_plain_recipe_takes_the_rest_from_the_dissertation():
    recipe = check(Recipe, PLAIN, "mine.toml")
    assert recipe.trials == 25_000
    assert recipe.time_limit_steps == 900
    assert (recipe.goal_reward, recipe.collision_reward) == (1.0, -0.3)
    assert recipe.learning.epsilon_start == 0.2
    assert recipe.objects[0].history_length is recipe.objects[0].order is None
    assert recipe.mover.kind == "none"


@pytest.mark.parametrize(
    ("changes", "key", "meant"),
    [
        ({"trails": 5}, "trails", "trials"),
        ({"learning": {"gama": 0.9}}, "learning.gama", "gamma"),
        ({"objects": [{"kind": "ball", "history_lenght": 2}]}, "objects.0.history_lenght", "history_length"),
        ({"action": {"min_step": 2}}, "action.min_step", "min_steps"),
        ({"world": {"robot": {"drivee": "4ws"}}}, "world.robot.drivee", "drive"),
    ],
)
def test_a_misspelt_key_is_answered_with_the_nearest_name(changes, key, meant):
    assert refused(changes) == f"mine.toml: unknown setting {key!r}. Did you mean {meant!r}?"


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"task": "dribble"}, ["task", "'shoot'", "'search'", "got 'dribble'"]),
        ({"trials": 0}, ["trials", "got 0"]),
        ({"trials": "many"}, ["trials", "expected int", "got str"]),
        ({"starts": "near"}, ["starts", "'in-view'", "'anywhere'", "got 'near'"]),
        ({"objects": []}, ["objects"]),
        ({"objects": [{"kind": "moon"}]}, ["objects", "kind", "'ball'", "got 'moon'"]),
        ({"objects": [{"kind": "ball", "order": 9}]}, ["order", "got 9"]),
        ({"learning": {"gamma": 1.0}}, ["learning.gamma", "got 1.0"]),
        ({"learning": {"epsilon_end": math.nan}}, ["learning.epsilon_end", "finite"]),
        ({"learning": {"update": "two-step"}}, ["learning.update", "'lambda-returns', 'one-step'", "got 'two-step'"]),
        ({"learning": {"storage": "spars"}}, ["learning.storage", "'dense', 'sparse'", "got 'spars'"]),
        ({"learning": {"alpha_visits": -1.0}}, ["learning.alpha_visits", ">= 0.0", "got -1"]),
        ({"objects": [{"kind": "ball", "lost_states": 3}]}, ["objects.0.lost_states", "int <= 2", "got 3"]),
        ({"objects": [{"kind": "ball", "estimator": "pca"}]}, ["objects.0.estimator", "'cva', 'raw'", "got 'pca'"]),
        (
            {"objects": [{"kind": "ball", "estimator": "raw", "order": 5}]},
            ["order must be at most 4 for 'ball'", "'raw'", "got 5"],
        ),
        (
            {"objects": [{"kind": "ball", "estimator": "raw", "history_length": 2}]},
            ["history_length must be 1", "'raw'", "got 2"],
        ),
        ({"action": {"min_steps": 31, "max_steps": 30}}, ["min_steps must be at most max_steps", "got 31"]),
        ({"experience": {"hold_min_steps": 40, "hold_max_steps": 20}}, ["hold_min_steps", "got 40"]),
        ({"task": "pass"}, ["'pass' needs another robot", "mover.kind"]),
        ({"task": "avoid"}, ["'avoid' needs another robot", "mover.kind"]),
        ({"world": {"robot": {"drive": "legs"}}}, ["world.robot.drive", "'pws'", "'4ws'", "got 'legs'"]),
    ],
    ids=str,
)
def test_a_wrong_value_is_named_with_what_was_expected(changes, parts):
    message = refused(changes)
    for part in parts:
        assert part in message


@pytest.mark.parametrize("kind", ["mate", "robot"])
@pytest.mark.parametrize("task", ["shoot", "search"])
def test_an_object_that_no_trial_has_is_refused(task, kind):
    with pytest.raises(InputError, match=r"mover\.kind"):
        check(Recipe, {**PLAIN, "task": task, "objects": [{"kind": kind}]}, "mine.toml")


LATER = {
    "objects": [
        {"kind": "ball", "estimator": "raw"},
        {"kind": "opponent_goal", "lost_states": 1},
        {"kind": "own_goal", "needed": True},
    ],
    "learning": {
        "update": "one-step",
        "discount_per": "action",
        "storage": "sparse",
        "alpha_visits": 0.0,
        "patience_steps": 10,
    },
}


@pytest.mark.parametrize("parts", [LATER, {}, {"learning": {"discount_per": "action"}}], ids=["all", "none", "one"])
def test_a_skill_file_tells_younger_settings_only_where_they_are_not_the_default(parts):
    recipe = check(Recipe, {**PLAIN, **parts}, "mine.toml")
    plain = plain_recipe(recipe)
    assert check(Recipe, plain, "told") == recipe
    assert "kind" not in plain
    assert "rules" not in plain["world"]
    every = msgspec.to_builtins(recipe)
    for told, known, given in [
        (plain["learning"], every["learning"], parts.get("learning", {})),
        *zip(plain["objects"], every["objects"], parts.get("objects", PLAIN["objects"]), strict=True),
    ]:
        younger = {"estimator", "lost_states", "needed", "update", "discount_per", "storage", "patience_steps"}
        assert set(known) - set(told) == (set(known) & younger) - set(given)
    assert recipe_digest(recipe) != recipe_digest(msgspec.structs.replace(recipe, trials=24_999))


def test_a_description_is_told_where_there_is_one():
    recipe, silent = (check(Recipe, {**PLAIN, **said}, "mine.toml") for said in ({"description": "runs about"}, {}))
    assert plain_recipe(recipe)["description"] == "runs about"
    assert "description" not in plain_recipe(silent)
    assert recipe_digest(recipe) != recipe_digest(silent)


def test_other_rules_of_play_are_told_and_in_the_digest():
    told = {"pass_window_s": 2.0, "collision_release_m": 0.02}  # as before there was a rule for a stuck ball
    for rules, expected in (
        ({"pass_window_s": 2.0}, told),
        ({"pass_window_s": 2.0, "stuck_after_s": 3.0}, {**told, "stuck_after_s": 3.0}),
    ):
        recipe = check(Recipe, {**PLAIN, "world": {"rules": rules}}, "mine.toml")
        assert plain_recipe(recipe)["world"]["rules"] == expected
        assert check(Recipe, plain_recipe(recipe), "told") == recipe
    assert recipe_digest(recipe) != recipe_digest(check(Recipe, PLAIN, "mine.toml"))


@pytest.mark.parametrize("name", TASKS)
def test_the_installed_skills_tell_the_recipe_that_they_were_learned_by(name):
    about, recipe = load_skill(name).about, read_recipe(name)
    assert recipe_digest(recipe) == about["recipe_digest"]
    assert check(Recipe, dict(about["recipe"]), name) == recipe


def test_every_younger_setting_is_in_the_digest():
    plain = check(Recipe, PLAIN, "mine.toml")
    found = {
        recipe_digest(check(Recipe, {**PLAIN, "learning": {key: LATER["learning"][key]}}, ""))
        for key in LATER["learning"]
    }
    found |= {
        recipe_digest(check(Recipe, {**PLAIN, "objects": [{**one, "kind": "ball"}]}, "")) for one in LATER["objects"]
    }
    found |= {
        recipe_digest(check(Recipe, {**PLAIN, "world": {"rules": {key: 0.7}}}, ""))
        for key in ("stuck_after_s", "stuck_within_m", "stuck_off_goals_m")
    }
    found.add(recipe_digest(check(Recipe, {**PLAIN, "conceded_reward": -0.5}, "")))
    assert len(found | {recipe_digest(plain)}) == 13


def test_the_literal_learner_has_the_numbers_of_the_text():
    recipe = read_recipe("chapter3/literal-shoot")
    assert (recipe.learning.update, recipe.learning.gamma, recipe.learning.discount_per) == ("one-step", 0.9, "action")
    assert recipe.learning.epsilon_start == recipe.learning.epsilon_end
    assert [(model.cell, model.lost_states) for model in recipe.objects] == [(1.0, 1), (1.0, 1)]


def test_a_missing_key_is_named():
    with pytest.raises(InputError, match=r"mine\.toml.*task"):
        check(Recipe, {"name": "mine", "objects": [{"kind": "ball"}]}, "mine.toml")


def test_the_recipes_of_the_four_skills_are_installed():
    assert installed_recipes() == sorted(TASKS)
    for name in TASKS:
        recipe = read_recipe(name)
        assert recipe.name == recipe.task == name


def test_a_file_of_ones_own_is_read_as_it_was_written(tmp_path):
    recipe = msgspec.structs.replace(read_recipe("pass"), trials=7, seed=3)
    path = tmp_path / "mine.toml"
    path.write_text(to_toml(recipe), encoding="utf-8")
    assert read_recipe(str(path)) == recipe
    assert is_recipe_of(str(path), tmp_path) is False
    path.rename(tmp_path / "recipe.toml")
    assert is_recipe_of(str(tmp_path / "recipe.toml"), tmp_path) is True


@pytest.mark.parametrize(
    ("content", "says"), [(None, "cannot read"), (b"name = ", "not valid TOML"), (b"\xff", "UTF-8")]
)
def test_a_file_that_cannot_be_read_is_named(tmp_path, content, says):
    path = tmp_path / "mine.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=says) as caught:
        read_recipe(str(path))
    assert str(path) in str(caught.value)


# -------------------------------------------------------------------------------------------------------------- starts


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
    recipe = read_recipe(name)
    for ease in (0.0, 0.5, 1.0):
        for state in starts(recipe, 150, ease=ease):
            assert sees(name, areas_seen(recipe, state))


@pytest.mark.parametrize("in_view", [True, False], ids=["in-view", "anywhere"])
@pytest.mark.parametrize("name", TASKS)
def test_bodies_start_apart_on_the_field_and_at_rest(name, in_view):
    recipe = read_recipe(name)
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
@pytest.mark.parametrize("name", TASKS)
def test_starts_have_the_distribution_of_the_definition(name, in_view):
    recipe = read_recipe(name)
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
    recipe = read_recipe(name)
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
    recipe = check(Recipe, {**PLAIN, "task": "avoid", "mover": {"kind": "chaser", "speed": 0.3}}, "mine.toml")
    assert recipe.mover == MoverSettings(kind="chaser", speed=0.3)
    for one, robots in ((recipe, 2), (check(Recipe, PLAIN, "mine.toml"), 1)):
        scene = solo_scene(one, provisional_skill(one), SKILL)
        assert len(scene.venue.stage.roles.role) == len(scene.minds) == robots
