"""One skill of several: the trials against those of plain learning, what is kept of the skills, and what is refused."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from scipy import stats

from behaviors.commands import learn as learn_command
from behaviors.coordination.areas import component
from behaviors.coordination.relearning import coordinate, expected_steps
from behaviors.learning import Learning, evaluate, learn
from behaviors.recipe import Recipe, read_recipe
from behaviors.studies import coordination as study_coordination
from behaviors.tabular.qlearning import make_learner
from behaviors.tabular.table import make_table
from behaviors.trials import scene
from behaviors.trials.solo import solo_scene
from behaviors.trials.task import COLLISION, SUCCESS
from coevo.config import check, to_toml
from coevo.errors import InputError
from coevo.seeds import game_seeds
from coevo.skill import load_skill
from coevo.stage import LEARNER, SKILL

OBJECTS = [{"kind": "ball"}, {"kind": "opponent_goal"}, {"kind": "robot"}]
MINE = {
    "name": "mine",
    "task": "shoot",
    "trials": 250,
    "objects": OBJECTS,
    "mover": {"kind": "random", "share_of_chasers": 0.5},
    "learning": {"check_every": 250, "check_games": 10},
    "coordination": {"skills": ["shoot", "avoid"], "steps_trials": 300},
}


def recipe(**changes):  # noqa: ANN003 - settings of a recipe
    together = {**MINE["coordination"], **changes.pop("coordination", {})}
    return check(Recipe, {**MINE, **changes, "coordination": together}, "mine.toml")


@pytest.fixture(scope="module")
def start():
    return coordinate(recipe(), seed=3)


def test_the_recipe_of_the_dissertations_task_is_this_one():
    found = read_recipe("chapter3/shoot-avoiding")
    assert found.coordination == msgspec.structs.replace(recipe().coordination, steps_trials=5000)
    assert (found.task, found.objects, found.mover) == (recipe().task, recipe().objects, recipe().mover)


def test_each_skill_acts_in_its_area_as_it_always_did(start):
    sizes = [model.states for model in start.skill.objects]
    assert [model.kind for model in start.skill.objects] == ["ball", "opponent_goal", "robot"]
    assert start.skill.values.shape == (int(np.prod(sizes)), 9)
    assert start.sizes.keys() == {"shoot", "avoid", "re-learning"}
    assert sum(start.sizes.values()) == len(start.skill.values)
    assert all(start.sizes.values())
    for i, (name, axes) in enumerate({"shoot": [0, 1], "avoid": [2]}.items()):
        skill, here = load_skill(name), start.areas.area == i
        own = component(sizes, axes)[here]
        assert np.array_equal(start.skill.values[here], skill.values[own])
        assert np.array_equal(start.values[here].argmax(axis=1), skill.values[own].argmax(axis=1))
    # What an area is worth: shots by the steps to the goal, avoiding by its values.
    steps = expected_steps(read_recipe("shoot"), load_skill("shoot"), trials=300, seed=3)
    shoots, avoids = start.areas.area == 0, start.areas.area == 1
    worth = 0.99 ** steps[component(sizes, [0, 1])[shoots]]
    np.testing.assert_allclose(start.values[shoots].max(axis=1), worth, atol=1e-12)
    best = load_skill("avoid").values.max(axis=1)[component(sizes, [2])[avoids]]
    np.testing.assert_allclose(start.values[avoids].max(axis=1), best, atol=1e-12)


def test_learning_again_leaves_the_areas_as_they_are(start):
    told = []
    skill = learn(recipe(), seed=3, report=lambda *state: told.append(state[:2]))
    assert told == [(250, 250)]
    assert np.array_equal(skill.values[start.fixed], start.skill.values[start.fixed])
    changed = (skill.values != start.skill.values).any(axis=1)
    assert 0 < changed.sum() <= skill.about["states_visited"]
    assert skill.about["coordination"]["states"] == start.sizes
    assert skill.about["coordination"]["skills"] == {name: load_skill(name).digest for name in ("shoot", "avoid")}
    assert skill.digest == learn(recipe(), seed=3).digest
    assert skill.digest != learn(recipe(), seed=4).digest


@pytest.mark.parametrize("update", ["lambda-returns", "one-step"])
def test_where_all_is_an_area_the_skill_acts_and_nothing_is_learned(update):
    shoot, seeds = load_skill("shoot"), game_seeds(1, 1, count=100)
    plain = read_recipe("shoot")
    plain = msgspec.structs.replace(plain, starts="anywhere")
    rule = msgspec.structs.replace(plain.learning, update=update, easy_share=0.0, epsilon_start=1.0)
    found = []
    for role in (SKILL, LEARNER):
        table = make_table(*shoot.values.shape)
        table.fixed[:] = True
        learner = make_learner(rule)
        if role == SKILL:
            learner = learner._replace(epsilon_start=0.0, epsilon_end=0.0)
        trials = solo_scene(plain, shoot, role, learner=learner, table=table)
        outcome = trials.run(seeds, total=100)
        assert not trials.minds[0].table.values.any()
        assert not trials.minds[0].table.visits.any()
        found.append((outcome.ends.tolist(), outcome.steps.tolist()))
    assert SUCCESS in found[0][0]
    assert found[0] == found[1]


@pytest.mark.parametrize("update", ["lambda-returns", "one-step"])
def test_the_other_robot_matters_when_shooting_and_areas_keep_their_values(start, update):
    mine = recipe(learning={"update": update})
    trials = solo_scene(mine, start.skill, LEARNER, learner=make_learner(mine.learning), table=start.table())
    found, table = trials.run(game_seeds(1, 1, count=150), total=200), trials.minds[0].table
    assert {SUCCESS, COLLISION} <= set(found.ends.tolist())
    assert np.array_equal(table.values[start.fixed], start.values[start.fixed])
    assert not table.visits[start.fixed].any()
    assert table.visits.any()


def test_fewer_steps_to_the_goal_are_where_a_skill_values_a_state_more():
    # A value is the mean of gamma^steps by the learning itself; the steps are counted in other trials, by another rule.
    one, shoot = read_recipe("shoot"), load_skill("shoot")
    found = expected_steps(one, shoot, trials=1000, seed=1)
    met = found != one.time_limit_steps
    assert 100 < met.sum() < len(found)
    assert found.min() >= 1.0
    assert stats.spearmanr(found[met], shoot.values.max(axis=1)[met]).statistic < -0.7


def test_no_start_is_said(start):
    blind = msgspec.structs.replace(recipe().world.camera, tilt_deg=-50.0, vertical_view_deg=10.0)
    hidden = msgspec.structs.replace(recipe(), world=msgspec.structs.replace(recipe().world, camera=blind))
    learner = make_learner(hidden.learning)._replace(follows=True, easy_share=0.0)
    trials = solo_scene(hidden, start.skill, LEARNER, learner=learner, table=start.table())
    assert trials.run(np.zeros(1, np.uint64)) is None
    assert not trials.minds[0].table.visits.any()
    with pytest.raises(InputError, match="no start was found"):
        learn(hidden)


def test_no_world_is_made_to_be_thrown_away(monkeypatch):
    made = []
    build = scene.World
    monkeypatch.setattr(scene, "World", lambda *arguments: made.append(arguments) or build(*arguments))
    other = recipe(world={"ball": {"mass_kg": 0.36}})
    for _ in range(3):
        evaluate(other, "random", games=1, seed=1)
    assert len(made) == 1


# ------------------------------------------------------------------------------------------------------------- refusals


def test_skills_that_see_one_object_through_different_models_are_refused():
    objects = [{"kind": "ball"}, {"kind": "opponent_goal"}, {"kind": "mate"}]
    passing = recipe(task="pass", objects=objects, coordination={"skills": ["shoot", "pass"]})
    with pytest.raises(InputError, match="'shoot' and 'pass' look at the ball through different models"):
        learn(passing)


def test_skills_can_be_learned_to_share_a_model(tmp_path):
    plain = read_recipe("pass")
    ball, mate = plain.objects
    seen = msgspec.structs.replace(ball, history_length=None, order=None, model_of="shoot")
    few = msgspec.structs.replace(plain.experience, windows=1500)
    passing = msgspec.structs.replace(plain, name="pass", trials=250, objects=(seen, mate), experience=few)
    skill = learn(passing)
    theirs = load_skill("shoot").objects[0]
    assert np.array_equal(skill.objects[0].memory_matrix, theirs.memory_matrix)
    skill.save(tmp_path / "skill.npz")
    objects = [{"kind": "ball"}, {"kind": "opponent_goal"}, {"kind": "mate"}]
    sources = {"skills": ["shoot", str(tmp_path / "skill.npz")], "steps_trials": 100}
    both = coordinate(recipe(task="pass", objects=objects, coordination=sources), seed=1)
    assert len(both.skill.values) == 29**3  # the ball once
    assert set(both.sizes) == {"shoot", "pass", "re-learning"}


def test_a_model_that_is_not_there_is_refused():
    objects = [{"kind": "ball", "model_of": "avoid"}]
    with pytest.raises(InputError, match="'avoid' looks at robot, so it has no model of ball"):
        learn(check(Recipe, {"name": "mine", "task": "shoot", "objects": objects}, "mine.toml"))
    with pytest.raises(InputError, match="leave them out"):
        check(Recipe, {"name": "mine", "task": "shoot", "objects": [{**objects[0], "order": 3}]}, "mine.toml")


def test_a_recipe_that_lists_other_objects_than_its_skills_is_refused():
    with pytest.raises(
        InputError, match="lists the objects ball, robot; its skills look at ball, opponent_goal, robot"
    ):
        learn(recipe(objects=[OBJECTS[0], OBJECTS[2]]))


def test_skills_whose_actions_are_others_are_refused():
    with pytest.raises(InputError, match="'shoot' last 5 to 30 steps, those of the recipe 'mine' 5 to 20"):
        learn(recipe(action={"max_steps": 20}))
    with pytest.raises(InputError, match="drive"):
        learn(recipe(world={"robot": {"drive": "4ws"}}))


def test_a_skill_that_knows_nothing_is_refused(tmp_path):
    skill = load_skill("avoid")
    dataclasses.replace(skill, values=np.zeros_like(skill.values)).save(tmp_path / "skill.npz")
    with pytest.raises(InputError, match=r"avoid values all states alike.*choose other skills"):
        learn(recipe(coordination={"skills": ["shoot", str(tmp_path / "skill.npz")]}))


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"coordination": {"skills": ["shoot"]}}, "coordination.skills"),
        ({"coordination": {"areas": "all"}}, "'isodata'"),
        ({"coordination": {"split": 1.0}}, "Did you mean 'split_std'?"),
        ({"objects": [*OBJECTS, {"kind": "ball"}]}, "every object stands once"),
        ({"learning": {"storage": "sparse"}}, "has values from the start: 'dense'"),
    ],
)
def test_a_wrong_setting_is_named(changes, part):
    with pytest.raises(InputError, match=part.replace("?", r"\?")):
        recipe(**changes)


# ---------------------------------------------------------------------------------------------------------- going on


@pytest.mark.slow
def test_a_learning_that_was_stopped_goes_on_to_the_same_bytes(tmp_path):
    mine = recipe(trials=750)
    learning = Learning(mine, seed=3, trials=750)
    learning.advance()
    learning.save(tmp_path / "learning.npz")
    again = Learning.load(tmp_path / "learning.npz", mine, seed=3, trials=750)
    assert again.done == 250
    for one in (learning, again):
        while not one.is_finished:
            one.advance()
    assert again.skill().digest == learning.skill().digest == learn(mine, seed=3).digest


def test_a_learning_does_not_go_on_with_another_skill_of_the_same_name(tmp_path):
    skill, path = load_skill("avoid"), tmp_path / "avoid.npz"
    skill.save(path)
    mine = recipe(coordination={"skills": ["shoot", str(path)], "steps_trials": 10})
    Learning(mine, seed=1, trials=250).save(tmp_path / "learning.npz")
    dataclasses.replace(skill, values=skill.values * 2.0).save(path)
    with pytest.raises(InputError, match=r"another learning: coordination\.digests"):
        Learning.load(tmp_path / "learning.npz", mine, seed=1, trials=250)


# ------------------------------------------------------------------------------------------------------------- commands


@pytest.mark.slow
def test_the_command_learns_measures_and_writes_it(tmp_path):
    path, out = tmp_path / "mine.toml", tmp_path / "learned"
    path.write_text(to_toml(recipe()), encoding="utf-8")
    said = CliRunner().invoke(learn_command, [str(path), "--games", "20", "--out", str(out), "--quiet"])
    assert said.exit_code == 0, said.output
    skill = load_skill(out)
    assert skill.name == "mine"
    assert read_recipe(str(out / "recipe.toml")) == recipe()  # object models without numbers stay without
    assert check(Recipe, dict(skill.about["recipe"]), "about") == recipe()
    assert (out / "card.json").exists()


@pytest.mark.slow
def test_the_study_measures_every_way(monkeypatch, tmp_path):
    monkeypatch.setattr(study_coordination, "_WAYS", dict(list(study_coordination._WAYS.items())[3:4]))
    path = tmp_path / "mine.toml"
    path.write_text(to_toml(recipe()), encoding="utf-8")
    arguments = [str(path), "--seeds", "1", "--trials", "20", "--games", "20", "--workers", "1"]
    said = CliRunner().invoke(study_coordination.coordination, arguments)
    assert said.exit_code == 0, said.output
    assert "the first skill alone" in said.output
    assert "no areas, first values the sum" in said.output
    refused = CliRunner().invoke(study_coordination.coordination, ["shoot"])
    assert "coordinates no skills" in str(refused.exception)
