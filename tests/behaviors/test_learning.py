"""Learning: returns against their definition, repeatability, sense, and the skills that are installed."""

from __future__ import annotations

import dataclasses
import itertools

import msgspec
import numpy as np
import pytest
from scipy import stats

from behaviors.cards import make_card, measure
from behaviors.experience import experience
from behaviors.learning import evaluate, learn
from behaviors.recipe import Recipe, read_recipe, recipe_digest
from behaviors.settings import ExperienceSettings, MoverSettings
from behaviors.trials.scene import Scene
from behaviors.trials.task import COLLISION, GOING, SUCCESS
from coevo.config import check
from coevo.errors import InputError
from coevo.skill import load_skill, read_card
from coevo.skill.model import OBJECT_KINDS
from coevo.soccer.camera import BALL, ROBOTS
from coevo.stage import LEARNER, RANDOM, SKILL
from coevo.statistics import share_interval

TASKS = ("shoot", "pass", "avoid", "search")


def changed(recipe, **parts):  # noqa: ANN003 - settings of a recipe
    return msgspec.structs.replace(recipe, **parts)


def short(name, trials=500):
    """Return an installed recipe with a short learning."""
    recipe = read_recipe(name)
    few = msgspec.structs.replace(recipe.experience, windows=1500)
    often = msgspec.structs.replace(recipe.learning, check_every=250, check_games=20)
    return changed(recipe, trials=trials, experience=few, learning=often)


# ---------------------------------------------------------------------------------------------------------- experience


def test_experience_is_whole_stretches_in_view():
    recipe = changed(read_recipe("pass"), experience=ExperienceSettings(windows=800))
    found = experience(recipe, 1).stretches
    assert set(found) == {"ball", "mate"}
    codes = {(v, w) for v in (-1.0, 0.0, 1.0) for w in (-1.0, 0.0, 1.0)}
    for kind, stretches in found.items():
        assert sum(len(actions) for actions, _ in stretches) >= 800
        for actions, seen in stretches:
            assert len(actions) == len(seen) > 0
            assert seen.shape[1] == OBJECT_KINDS[kind]
            assert {tuple(action) for action in actions.tolist()} <= codes
            assert seen[:, -1].min() >= 1.0  # an area of a pixel or more: it was in view
        changes = [
            np.any(np.diff(actions, axis=0) != 0.0, axis=1).mean() for actions, _ in stretches if len(actions) > 30
        ]
        assert np.mean(changes) < 0.25  # actions are held
    again = experience(recipe, 1).stretches
    assert all(np.array_equal(a[1], b[1]) for a, b in zip(found["ball"], again["ball"], strict=True))
    other = experience(recipe, 2).stretches
    assert not np.array_equal(found["ball"][0][1], other["ball"][0][1])


@pytest.mark.parametrize("windows", [150, 800, 2500])
def test_steps_of_experience_are_those_until_each_object_was_seen_often_enough(windows, monkeypatch):
    recipe = changed(read_recipe("pass"), experience=ExperienceSettings(windows=windows))
    seen = []  # at each step whether ball and mate were in view

    def watching(scene, *args, **kwargs):  # noqa: ANN003 - passed on
        found = run(scene, *args, **kwargs)
        store = scene.minds[0].store
        seen.extend((store.areas[:, [BALL, ROBOTS]] > 0.0).tolist())
        return found

    run = Scene.run
    monkeypatch.setattr(Scene, "run", watching)
    steps = experience(recipe, 3).steps
    counts, needed = [0, 0], 0
    while min(counts) < windows:
        counts = [count + here for count, here in zip(counts, seen[needed], strict=True)]
        needed += 1
    assert steps == needed > windows


def test_a_recipe_whose_objects_are_never_seen_is_refused():
    blind = msgspec.structs.replace(read_recipe("search").world.camera, tilt_deg=-50.0, vertical_view_deg=10.0)
    recipe = read_recipe("shoot")
    recipe = changed(recipe, world=msgspec.structs.replace(recipe.world, camera=blind))
    with pytest.raises(InputError, match=r"hardly ever come into view|no start was found"):
        learn(recipe, trials=10)


# ------------------------------------------------------------------------------------------------------------- learning


def test_learning_is_its_seed():
    recipe = short("search", 250)
    one, two, other = learn(recipe, seed=4), learn(recipe, seed=4), learn(recipe, seed=5)
    assert one.digest == two.digest
    assert one.about == two.about
    assert one.digest != other.digest
    assert not np.array_equal(one.objects[0].memory_matrix, other.objects[0].memory_matrix)


@pytest.mark.parametrize("name", TASKS)
def test_each_task_can_be_learned_and_says_how(name):
    recipe, told = short(name, 500), []
    skill = learn(recipe, report=lambda done, total, share: told.append((done, total, share)))
    assert [(done, total) for done, total, _ in told] == [(250, 500), (500, 500)]
    assert all(0.0 <= share <= 1.0 for _, _, share in told)
    assert skill.name == name
    assert skill.actions == 9
    assert [model.kind for model in skill.objects] == [model.kind for model in recipe.objects]
    assert (skill.min_steps, skill.max_steps) == (recipe.action.min_steps, recipe.action.max_steps)
    assert np.isfinite(skill.values).all()
    assert 0 < np.count_nonzero(skill.values.any(axis=1)) <= skill.about["states_visited"] <= len(skill.values)
    assert (skill.about["seed"], skill.about["trials"]) == (recipe.seed, 500)
    assert check(Recipe, skill.about["recipe"], "about") == recipe
    assert skill.about["recipe_digest"] == recipe_digest(recipe)


@pytest.mark.parametrize("name", ["shoot", "search"])
def test_a_sparse_learning_learns_the_same_skill(name, tmp_path):
    recipe = short(name, 300)
    settings = msgspec.structs.replace(recipe.learning, storage="sparse")
    dense, sparse = learn(recipe), learn(changed(recipe, learning=settings))
    assert sparse.digest == dense.digest
    assert sparse.values.tobytes() == dense.values.tobytes()
    assert sparse.about["states_visited"] == dense.about["states_visited"]
    sparse.save(tmp_path / "sparse.npz")
    loaded = load_skill(tmp_path / "sparse.npz")
    assert np.array_equal(loaded.policy, dense.policy)
    assert (loaded.digest, loaded.sparse, dense.sparse) == (dense.digest, True, False)


def test_a_state_from_one_image_can_be_learned_with():
    recipe = short("shoot", 250)
    objects = tuple(
        msgspec.structs.replace(m, estimator="raw", history_length=None, order=None) for m in recipe.objects
    )
    skill = learn(changed(recipe, objects=objects))
    assert len(skill.values) == 11 * 29
    assert [model.order for model in skill.objects] == [2, 3]
    one_lost = tuple(msgspec.structs.replace(m, lost_states=1) for m in objects)
    assert len(learn(changed(recipe, objects=one_lost)).values) == 10 * 28


def test_a_literal_learner_can_be_asked_for():
    recipe = short("search", 250)
    parts = {"update": "one-step", "discount_per": "action", "gamma": 0.9, "alpha_visits": 0.0}
    recipe = changed(recipe, learning=msgspec.structs.replace(recipe.learning, **parts))
    skill = learn(recipe)
    assert check(Recipe, skill.about["recipe"], "about") == recipe
    # No reward but the one at the end of a trial, and no action is worth more than the last one.
    assert 0.0 < skill.values.max() <= 1.0


def test_a_table_that_no_machine_holds_is_refused():
    recipe = short("shoot", 250)
    objects = tuple(msgspec.structs.replace(m, order=8) for m in recipe.objects)
    with pytest.raises(InputError, match=r"6563 x 6563 = 43072969 states together.*smaller order"):
        learn(changed(recipe, objects=objects))


def test_the_other_drive_can_be_learned():
    recipe = short("shoot", 250)
    robot = msgspec.structs.replace(recipe.world.robot, drive="4ws")
    recipe = changed(recipe, world=msgspec.structs.replace(recipe.world, robot=robot))
    skill = learn(recipe)
    assert (skill.drive, skill.actions) == ("4ws", 7)
    assert len(evaluate(recipe, skill, games=20, seed=1).steps) == 20


def learned_and_random(name, trials, games):
    """Return what a short learning comes to, and what random actions do, from the same starts."""
    recipe = short(name, trials)
    recipe = changed(recipe, learning=msgspec.structs.replace(recipe.learning, check_every=500, check_games=50))
    mover = MoverSettings(kind="random") if name == "avoid" else None
    return [evaluate(recipe, skill, games=games, seed=11, mover=mover) for skill in (learn(recipe), "random")]


@pytest.mark.parametrize(("name", "trials"), [("shoot", 3000), ("avoid", 1500)])
def test_a_short_learning_beats_random_actions_clearly(name, trials):
    found = learned_and_random(name, trials, 300)
    counts = [[int(one.success.sum()), int((~one.success).sum())] for one in found]
    assert stats.fisher_exact(counts, alternative="greater").pvalue < 1e-6, counts


def test_a_short_learning_to_search_is_quicker_than_random_actions():
    # Random actions find the ball in 10 s nearly always, too: it is the time that tells.
    learned, random = learned_and_random("search", 500, 300)
    assert stats.mannwhitneyu(learned.steps, random.steps, alternative="less").pvalue < 1e-6
    assert learned.success_rate > 0.95


# ----------------------------------------------------------------------------------------------------------- evaluation


def test_evaluation_is_its_seed_and_never_changes_the_skill():
    recipe, skill = read_recipe("shoot"), load_skill("shoot")
    before = skill.digest
    one, two, other = (evaluate(recipe, skill, games=40, seed=seed) for seed in (3, 3, 4))
    assert np.array_equal(one.steps, two.steps)
    assert np.array_equal(one.outcomes, two.outcomes)
    assert not np.array_equal(one.steps, other.steps)
    first = evaluate(recipe, skill, games=10, seed=3)
    assert np.array_equal(first.steps, one.steps[:10])  # a trial does not depend on how many there are
    assert skill.digest == before


def test_starts_of_evaluation_are_never_those_of_learning(monkeypatch):
    drawn = {LEARNER: set(), SKILL: set(), RANDOM: set()}
    run = Scene.run

    def spy(scene, seeds, **rest):  # noqa: ANN003 - of Scene.run
        drawn[int(scene.trial.stage.roles.role[0])].update(seeds.tolist())
        return run(scene, seeds, **rest)

    monkeypatch.setattr(Scene, "run", spy)
    recipe = short("search", 500)
    skill = learn(recipe, seed=6)
    checks = set(drawn[SKILL])
    assert len(drawn[LEARNER]) == 500
    assert checks  # the table that is kept is chosen by these
    drawn[SKILL].clear()
    evaluate(recipe, skill, games=300, seed=6)
    assert len(drawn[SKILL]) == 300
    assert drawn[RANDOM]  # models are made of these
    for one, other in itertools.combinations([*drawn.values(), checks], 2):
        assert one.isdisjoint(other)


def test_success_is_what_each_task_calls_so():
    for name in TASKS:
        found = evaluate(read_recipe(name), "random", games=60, seed=2)
        if name == "avoid":
            assert np.array_equal(found.success, found.outcomes != COLLISION)
            assert set(found.outcomes.tolist()) <= {GOING, COLLISION}
        else:
            assert np.array_equal(found.success, found.outcomes == SUCCESS)
        limit = read_recipe(name).time_limit_steps
        assert np.all(found.steps[found.outcomes == GOING] == limit)
        assert found.steps.max() <= limit
        assert found.success_rate == np.mean(found.success)
        assert found.collision_rate == np.mean(found.outcomes == COLLISION)


def test_success_is_measured_as_promised():
    assert read_recipe("shoot").time_limit_steps == read_recipe("pass").time_limit_steps == 900  # 30 s
    assert read_recipe("avoid").time_limit_steps == read_recipe("search").time_limit_steps == 300  # 10 s


def test_a_skill_for_something_else_is_refused():
    with pytest.raises(InputError, match="'search' looks at ball; the task avoid needs robot"):
        evaluate(read_recipe("avoid"), load_skill("search"), games=5, seed=1)


# ----------------------------------------------------------------------------------------------------- installed skills


@pytest.fixture(scope="module")
def cards():
    return {name: read_card(name) for name in TASKS}


@pytest.mark.parametrize("name", TASKS)
def test_the_card_of_an_installed_skill_is_that_of_its_file(cards, name):
    card, skill = cards[name], load_skill(name)
    assert card["digest"] == skill.digest
    assert card["name"] == skill.name == name
    assert card["drive"] == skill.drive == "pws"
    assert card["states"] == len(skill.values)
    assert card["orders"] == {model.kind: model.order for model in skill.objects}
    assert card["history_lengths"] == {model.kind: model.history_length for model in skill.objects}
    assert card["learned_with"] == {"seed": skill.about["seed"], "trials": skill.about["trials"]}


@pytest.mark.parametrize("name", TASKS)
def test_an_installed_skill_was_learned_by_the_recipe_beside_it(name):
    skill, recipe = load_skill(name), read_recipe(name)
    assert check(Recipe, skill.about["recipe"], "about") == recipe
    assert skill.about["recipe_digest"] == recipe_digest(recipe)


@pytest.mark.parametrize("name", TASKS)
def test_a_card_says_what_its_counts_say(cards, name):
    card = cards[name]
    for data in [one for key in ("measured", "random_actions", "true_state_controller") for one in card[key].values()]:
        successes = data["success_rate"] * data["games"]
        assert successes == pytest.approx(round(successes))
        assert data["ci95"] == pytest.approx(share_interval(round(successes), data["games"]))
        assert data["games"] >= 1000
    starts = ["in-view"] if name in ("avoid", "search") else ["in-view", "anywhere"]
    assert [list(card[key]) for key in ("measured", "random_actions", "true_state_controller")] == [starts] * 3


@pytest.mark.parametrize(
    ("name", "starts"),
    [
        ("shoot", "in-view"),
        ("shoot", "anywhere"),
        ("pass", "in-view"),
        ("pass", "anywhere"),
        ("avoid", "in-view"),
        ("search", "in-view"),
    ],
)
def test_a_card_can_be_measured_again(cards, name, starts):
    data, games = cards[name]["measured"][starts], 200
    recipe, skill = read_recipe(name), load_skill(name)
    found = measure(recipe, skill, games=games, seed=77, starts=starts)
    counts = [
        [round(one["success_rate"] * one["games"]), round((1.0 - one["success_rate"]) * one["games"])]
        for one in (data, found)
    ]
    assert stats.fisher_exact(counts).pvalue > 0.001, counts  # other starts, the same share
    if "collision_rate_chaser" in data:
        both = [round(data["collision_rate_chaser"] * data["games"]), round(found["collision_rate_chaser"] * games)]
        assert stats.fisher_exact([[both[0], data["games"] - both[0]], [both[1], games - both[1]]]).pvalue > 0.001


@pytest.mark.parametrize("name", TASKS)
def test_an_installed_skill_is_better_than_random_actions(cards, name):
    card = cards[name]
    margin = 0.0 if name == "search" else 0.2  # random actions find the ball nearly always, in 10 s
    assert card["measured"]["in-view"]["ci95"][0] > card["random_actions"]["in-view"]["ci95"][1] + margin


def test_a_card_is_made_of_measurements():
    recipe, skill = read_recipe("search"), load_skill("search")
    card = make_card(recipe, skill, games=50, seed=9)
    found = evaluate(recipe, skill, games=50, seed=9, starts="in-view")
    assert card["measured"]["in-view"]["success_rate"] == found.success_rate
    assert card["measured"]["in-view"]["mean_steps"] == pytest.approx(found.steps.mean())
    assert card["digest"] == skill.digest
    assert card["description"] == read_card("search")["description"]
    blind = dataclasses.replace(skill, values=np.zeros_like(skill.values))  # always the first action
    worse = make_card(recipe, blind, games=50, seed=9)
    assert worse["digest"] != card["digest"]
    for beside in ("random_actions", "true_state_controller"):
        assert worse[beside] == card[beside]
    mine = make_card(msgspec.structs.replace(recipe, description="looks about"), skill, games=10, seed=9)
    assert mine["description"] == "looks about"
