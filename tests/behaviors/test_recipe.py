"""Recipes are checked, and the starts they ask for are what they say, by an independent look at the world."""

from __future__ import annotations

import math

import msgspec
import pytest

from behaviors.recipe import Recipe, installed_recipes, is_recipe_of, plain_recipe, read_recipe, recipe_digest
from coevo.config import check, to_toml
from coevo.errors import InputError
from coevo.skill import load_skill

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
        ({"task": "defend"}, ["'defend' needs another robot", "mover.kind"]),
        ({"mover": {"kind": "skill"}}, ["mover", "skill", "what the other robot plays"]),
        ({"mover": {"kind": "random", "skill": "shoot"}}, ["mover", 'kind = "skill"', "only there"]),
        ({"mover": {"kind": "skil"}}, ["mover.kind", "'chaser'", "'skill'", "got 'skil'"]),
        ({"conceded_reward": math.inf}, ["conceded_reward", "finite"]),
        ({"learning": {"patience_steps": -1}}, ["learning.patience_steps", "got -1"]),
        ({"objects": [{"kind": "ball", "needed": 1}]}, ["needed", "expected bool", "got int"]),
        ({"task": "search", "objects": [{"kind": "ball", "needed": True}]}, ["'search'", "cannot be needed"]),
        (
            {"objects": [{"kind": "ball", "needed": True}], "coordination": {"skills": ["shoot", "search"]}},
            ["with coordination", "none can be needed"],
        ),
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
        "choice": "sum",
        "actor": "literal",
        "beta": 0.1,
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
        younger |= {"method", "choice", "actor", "beta"}  # chapter 5
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
    found |= {
        recipe_digest(check(Recipe, {**PLAIN, **one}, "")) for one in ({"ends": "goal"}, {"credit": "last-touch"})
    }
    assert len(found | {recipe_digest(plain)}) == 18


def test_the_literal_learner_has_the_numbers_of_the_text():
    recipe = read_recipe("chapter3/literal-shoot")
    assert (recipe.learning.update, recipe.learning.gamma, recipe.learning.discount_per) == ("one-step", 0.9, "action")
    assert recipe.learning.epsilon_start == recipe.learning.epsilon_end
    assert [(model.cell, model.lost_states) for model in recipe.objects] == [(1.0, 1), (1.0, 1)]


def test_a_missing_key_is_named():
    with pytest.raises(InputError, match=r"mine\.toml.*task"):
        check(Recipe, {"name": "mine", "objects": [{"kind": "ball"}]}, "mine.toml")


def test_the_recipes_of_the_skills_are_installed():
    tasks = {**{name: name for name in (*TASKS, "defend", "home")}, "shoot-in-view": "shoot", "pass-in-view": "pass"}
    assert installed_recipes() == sorted(tasks)
    for name, task in tasks.items():
        recipe = read_recipe(name)
        assert (recipe.name, recipe.task) == (name, task)


@pytest.mark.parametrize(
    ("name", "needed"), [("shoot-in-view", ("ball",)), ("pass-in-view", ("ball",)), ("defend", ("ball",))]
)
def test_installed_skills_that_are_for_what_is_in_view_have_the_domain_of_their_recipes(name, needed):
    recipe, skill = read_recipe(name), load_skill(name)
    assert tuple(model.kind for model in recipe.objects if model.needed) == skill.domain == needed
    assert all(load_skill(complete).domain == () for complete in TASKS)


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
