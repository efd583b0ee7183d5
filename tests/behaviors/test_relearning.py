"""One skill of several: the trials against those of plain learning, what is kept of the skills, and what is refused."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from scipy import stats

from behaviors import learning, study_coordination
from behaviors.commands import learn as learn_command
from behaviors.composite import count_steps, relearn_trials
from behaviors.coordination import component
from behaviors.learning import evaluate, learn, learner, make_scene
from behaviors.recipe import Recipe, read_recipe
from behaviors.relearning import coordinate, expected_steps, learn_recipe
from behaviors.task import COLLISION, SUCCESS
from behaviors.trials import run_trials
from coevo.config import check, to_toml
from coevo.errors import InputError
from coevo.skill import load_skill, make_bank
from coevo.soccer.rng import game_seed

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


def test_the_recipe_of_the_dissertations_task_is_this_one(pytestconfig):
    found = read_recipe(str(pytestconfig.rootpath / "runs" / "chapter3" / "shoot-avoiding.toml"))
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
    skill = learn_recipe(recipe(), seed=3, report=lambda *state: told.append(state[:2]))
    assert told == [(250, 250)]
    assert np.array_equal(skill.values[start.fixed], start.skill.values[start.fixed])
    changed = (skill.values != start.skill.values).any(axis=1)
    assert 0 < changed.sum() <= skill.about["states_visited"]
    assert skill.about["coordination"]["states"] == start.sizes
    assert skill.about["coordination"]["skills"] == {name: load_skill(name).digest for name in ("shoot", "avoid")}
    assert skill.digest == learn_recipe(recipe(), seed=3).digest
    assert skill.digest != learn_recipe(recipe(), seed=4).digest


def test_without_areas_the_trials_are_those_of_plain_learning():
    plain = recipe(coordination={"areas": "none", "initial": "zero"}, learning={"anywhere_share": 0.3})
    begun = coordinate(plain, seed=1)
    assert not begun.fixed.any()
    assert not begun.values.any()
    numbers, seeds = learner(plain), np.array([game_seed(1, 1, n) for n in range(150)], np.uint64)
    tables = []
    for other in (False, True):
        scene = make_scene(plain, make_bank([begun.skill], drive="pws", actions=9))
        values, visits = np.zeros(begun.values.shape), np.zeros(begun.values.shape, np.int64)
        outcomes, steps = np.zeros(150, np.int64), np.zeros(150, np.int64)
        if other:
            assert run_trials(scene, numbers, True, False, 0, 200, seeds, values, visits, outcomes, steps)
        else:
            assert relearn_trials(scene, numbers, begun.fixed, 0, 200, seeds, values, visits, outcomes, steps)
        tables.append((values, visits, outcomes, steps))
    assert {SUCCESS, COLLISION} <= set(tables[0][2].tolist())  # the other robot matters when shooting, too
    for mine, theirs in zip(*tables, strict=True):
        assert np.array_equal(mine, theirs)


def test_fewer_steps_to_the_goal_are_where_a_skill_values_a_state_more():
    # A value is the mean of gamma^steps by the learning itself; the steps are counted in other trials, by another rule.
    one, shoot = read_recipe("shoot"), load_skill("shoot")
    found = expected_steps(one, shoot, trials=1000, seed=1)
    met = found != one.time_limit_steps
    assert 100 < met.sum() < len(found)
    assert found.min() >= 1.0
    assert stats.spearmanr(found[met], shoot.values.max(axis=1)[met]).statistic < -0.7


def test_no_start_is_said_by_both_kernels(start):
    blind = msgspec.structs.replace(recipe().world.camera, tilt_deg=-50.0, vertical_view_deg=10.0)
    hidden = msgspec.structs.replace(recipe(), world=msgspec.structs.replace(recipe().world, camera=blind))
    scene = make_scene(hidden, make_bank([start.skill], drive="pws", actions=9))
    counts, ones = np.zeros(1, np.int64), np.zeros(1, np.uint64)
    visits = np.zeros(start.values.shape, np.int64)
    numbers = learner(hidden)._replace(easy_share=0.0)  # near enough, it does see both
    assert not relearn_trials(
        scene, numbers, start.fixed, 0, 1, ones, start.values.copy(), visits, counts, counts.copy()
    )
    expected = np.zeros((len(visits), 1))
    assert not count_steps(scene, numbers, 900.0, ones, expected, np.zeros(expected.shape, np.int64))


def test_no_world_is_made_to_be_thrown_away(monkeypatch):
    made = []
    build = learning.World
    monkeypatch.setattr(learning, "World", lambda *arguments: made.append(arguments) or build(*arguments))
    other = recipe(world={"ball": {"mass_kg": 0.36}})
    for _ in range(3):
        evaluate(other, None, games=1, seed=1)
    assert len(made) == 1


# ------------------------------------------------------------------------------------------------------------- refusals


def test_skills_that_see_one_object_through_different_models_are_refused():
    objects = [{"kind": "ball"}, {"kind": "opponent_goal"}, {"kind": "mate"}]
    passing = recipe(task="pass", objects=objects, coordination={"skills": ["shoot", "pass"]})
    with pytest.raises(InputError, match="'shoot' and 'pass' look at the ball through different models"):
        learn_recipe(passing)


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
        learn_recipe(recipe(objects=[OBJECTS[0], OBJECTS[2]]))


def test_skills_whose_actions_are_others_are_refused():
    with pytest.raises(InputError, match="'shoot' last 5 to 30 steps, those of the recipe 'mine' 5 to 20"):
        learn_recipe(recipe(action={"max_steps": 20}))
    with pytest.raises(InputError, match="drive"):
        learn_recipe(recipe(world={"robot": {"drive": "4ws"}}))


def test_a_skill_that_knows_nothing_is_refused(tmp_path):
    skill = load_skill("avoid")
    dataclasses.replace(skill, values=np.zeros_like(skill.values)).save(tmp_path / "skill.npz")
    with pytest.raises(InputError, match=r"avoid values all states alike.*choose other skills"):
        learn_recipe(recipe(coordination={"skills": ["shoot", str(tmp_path / "skill.npz")]}))


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"coordination": {"skills": ["shoot"]}}, "coordination.skills"),
        ({"coordination": {"areas": "all"}}, "'isodata'"),
        ({"coordination": {"split": 1.0}}, "Did you mean 'split_std'?"),
        ({"objects": [*OBJECTS, {"kind": "ball"}]}, "every object stands once"),
    ],
)
def test_a_wrong_setting_is_named(changes, part):
    with pytest.raises(InputError, match=part.replace("?", r"\?")):
        recipe(**changes)


def test_learning_from_nothing_does_not_pass_over_the_skills():
    with pytest.raises(InputError, match="'mine' coordinates skills"):
        learn(recipe())


# ------------------------------------------------------------------------------------------------------------- commands


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


def test_the_study_measures_every_way(monkeypatch, tmp_path):
    monkeypatch.setattr(study_coordination, "_WAYS", dict(list(study_coordination._WAYS.items())[3:4]))
    path = tmp_path / "mine.toml"
    path.write_text(to_toml(recipe()), encoding="utf-8")
    arguments = [str(path), "--seeds", "1", "--trials", "20", "--games", "20", "--workers", "1"]
    said = CliRunner().invoke(study_coordination.main, arguments)
    assert said.exit_code == 0, said.output
    assert "the first skill alone" in said.output
    assert "no areas, first values the sum" in said.output
    refused = CliRunner().invoke(study_coordination.main, ["shoot"])
    assert "coordinates no skills" in refused.output
