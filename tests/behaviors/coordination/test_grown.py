"""Coordinated skills in a table that grows: against one built by hand, and what is chosen before and after."""

from __future__ import annotations

import dataclasses
import itertools

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import behaviors.learning
from behaviors.coordination.relearning import coordinate, shared_models
from behaviors.learning import Learning
from behaviors.recipe import Recipe, plain_recipe
from behaviors.tabular.growing import grown_table, origins
from behaviors.tabular.table import all_states
from coevo.config import check
from coevo.errors import InputError
from coevo.skill import ObjectModel, Skill, load_skill
from coevo.skill.model import INPUTS, OBJECT_KINDS

ACTIONS, LOST = 7, 2
WORLD = {"robot": {"drive": "4ws"}}
CHASED = {"kind": "random", "share_of_chasers": 0.5}


def model(kind, order, seed):
    rng = np.random.default_rng(seed)
    past = 2 * (INPUTS + OBJECT_KINDS[kind])
    return ObjectModel(kind, 2, rng.normal(size=(order, past)), rng.normal(size=past), 0.6, LOST)


def first_axes(whole, count):
    return dataclasses.replace(whole, memory_matrix=whole.memory_matrix[:count])


BALL, GOAL, ROBOT = model("ball", 2, 1), model("opponent_goal", 1, 2), model("robot", 3, 3)


def write_skill(path, task, objects, seed):
    """Write a skill that values actions at random: like one that shoots, or one that avoids."""
    mine = {"name": task, "task": task, "objects": [{"kind": one.kind} for one in objects], "world": WORLD}
    recipe = check(Recipe, {**mine, "mover": CHASED} if task == "avoid" else mine, "mine")
    rng = np.random.default_rng(seed)
    values = rng.random((int(np.prod([one.states for one in objects])), ACTIONS)).astype(np.float32)
    about = {"recipe": plain_recipe(recipe), "seed": 0, "trials": 10}
    Skill(task, "4ws", tuple(objects), -0.3 * values if task == "avoid" else values, 5, 30, about=about).save(path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("skills")
    for seed in (0, 1):
        write_skill(path / f"shoot-{seed}.npz", "shoot", [BALL, GOAL], seed)
        for count in (1, 2, 3):
            write_skill(path / f"avoid-{count}-{seed}.npz", "avoid", [first_axes(ROBOT, count)], 10 * count + seed)
    write_skill(path / "avoid-other.npz", "avoid", [model("robot", 1, 9)], 5)
    return path


def recipe(folder, axes=1, *, dimension=1, whole=3, skill=None, learning=None, worth="values", **curriculum):  # noqa: ANN003 - settings
    avoid = skill or f"avoid-{axes}-{{seed}}.npz"
    data = {
        "name": "mine",
        "task": "shoot",
        "trials": 120,
        "time_limit_steps": 300,
        "objects": [
            {"kind": "ball"},
            {"kind": "opponent_goal"},
            {"kind": "robot", "model_of": str(folder / f"avoid-{whole}-{{seed}}.npz")},
        ],
        "mover": {"kind": "ball-chaser"},
        "learning": {"check_every": 40, "check_games": 10, "check_from": 0.0, **(learning or {})},
        "world": WORLD,
        "coordination": {
            "skills": [str(folder / "shoot-{seed}.npz"), str(folder / avoid)],
            "worth": worth,
            "steps_trials": 50,
        },
        "curriculum": {
            "keys": [{"mover.speed": [0.0, 0.5, 1.0]}],
            "raise_when": {"success": {"at_least": 0.9}, "collisions": {"at_most": 0.1}},
            "trials": 20,
            "window": 1,
            "patience": 1,
            "improvement": 0.0,
            "grow": ["robot"],
            "dimension": dimension,
            "most_dimensions": 3,
            **curriculum,
        },
    }
    return check(Recipe, data, "mine")


def places(order):
    """Return an object's states in their order: cells as (first axis, second, ...), then the lost ones."""
    return [*(cell[::-1] for cell in itertools.product(range(3), repeat=order)), *range(LOST)]


def called(axes):
    """Return what composite states are called, the robot told by so many axes."""
    return list(itertools.product(places(BALL.order), places(GOAL.order), places(axes)))


def without(name, axes):
    """Return what a composite state is called if the robot is told by its first axes only."""
    ball, goal, robot = name
    return ball, goal, robot if isinstance(robot, int) else robot[:axes]


@given(st.integers(1, 2), st.integers(0, 10**6))
@settings(deadline=None, max_examples=6)
def test_grown_skills_are_those_built_by_hand(folder, axes, seed):
    whole = shared_models(recipe(folder), 0)
    assert np.array_equal(whole[2].memory_matrix, ROBOT.memory_matrix)
    start = coordinate(recipe(folder, axes), seed=0, models=(*whole[:2], first_axes(whole[2], axes)))
    table = start.table()
    table.values[~start.fixed] = np.random.default_rng(seed).normal(size=(int((~start.fixed).sum()), ACTIONS))
    origin = origins([(one.order, one.lost_states) for one in start.skill.objects], 2)
    grown, larger = start.grown((*whole[:2], first_axes(whole[2], axes + 1)), origin), grown_table(table, origin)
    before = {name: state for state, name in enumerate(called(axes))}
    by_hand = np.array([before[without(name, axes)] for name in called(axes + 1)])  # (4.3)
    assert len(grown.skill.values) == len(by_hand)
    assert np.array_equal(grown.skill.values, start.skill.values[by_hand])
    assert np.array_equal(grown.areas.area, start.areas.area[by_hand])
    assert np.array_equal(grown.areas.distance, start.areas.distance[by_hand])
    assert np.array_equal(larger.fixed, grown.fixed)
    assert np.array_equal(larger.values, table.values[by_hand])
    assert np.array_equal(by_hand[grown.areas.kernels], start.areas.kernels)
    old = start.keep(all_states(table.values, table.rows))
    new = grown.keep(all_states(larger.values, larger.rows))
    assert np.array_equal(new, old[by_hand])  # so the greedy choice is that of before
    assert start.fixed.any()
    assert not start.fixed.all()


def test_a_skill_that_looks_at_the_first_axes_is_in_the_state_of_these(folder):
    start = coordinate(recipe(folder, 1), seed=1)  # of all three axes from the beginning
    avoid, shoot = start.areas.area == 1, start.areas.area == 0
    names = called(3)
    of_robot = {name: state for state, name in enumerate(places(1))}
    of_rest = {name: state for state, name in enumerate(itertools.product(places(2), places(1)))}
    avoids = load_skill(folder / "avoid-1-1.npz").values[[of_robot[without(name, 1)[2]] for name in names]]
    shoots = load_skill(folder / "shoot-1.npz").values[[of_rest[name[:2]] for name in names]]
    assert avoid.any()
    assert shoot.any()
    assert np.array_equal(start.skill.values[avoid], avoids[avoid])
    assert np.array_equal(start.skill.values[shoot], shoots[shoot])


@pytest.mark.parametrize("update", ["lambda-returns", "one-step"])
def test_a_learning_that_grows_chooses_as_before_keeps_its_areas_and_can_be_stopped(folder, update, tmp_path):
    mine = recipe(folder, learning={"update": update})
    learning, grown, path = Learning(mine, seed=0, trials=mine.trials), [], tmp_path / "learning.npz"
    stopped = Learning(mine, seed=0, trials=mine.trials)
    while not learning.is_finished:
        sizes = [(one.order, one.lost_states) for one in learning.skill().objects]
        axes = sizes[2][0]
        learning.advance()
        table, start = learning._practice.at.tables[0], learning._start
        assert np.array_equal(table.fixed, start.fixed)
        assert np.array_equal(table.values[start.fixed], start.values[start.fixed])
        assert not table.visits[table.fixed].any()
        skill = learning.skill()
        if skill.objects[2].order > axes:
            origin = origins(sizes, 2)
            now = learning._kept(learning._practice.values_now()[0])
            first = np.unique(origin, return_index=True)[1]
            assert np.array_equal(now, now[first][origin])
            assert np.array_equal(skill.values, skill.values[first][origin])
            grown.append(learning.done)
        bank = learning._scene.trial.stage.bank
        assert np.array_equal(bank.policy[: len(skill.values)][start.fixed], skill.values.argmax(axis=1)[start.fixed])
        stopped.advance()
        stopped.save(path)
        stopped = Learning.load(path, mine, seed=0, trials=mine.trials)
    assert len(grown) == 2
    assert learning._models[2].order == learning.skill().objects[2].order == 3
    assert stopped.skill().to_bytes() == learning.skill().to_bytes()
    assert stopped.files() == learning.files()


def test_each_seed_has_skills_of_its_own(folder):
    found = {seed: coordinate(recipe(folder), seed=seed) for seed in (0, 1)}
    assert set(found[1].digests) == {str(folder / "shoot-1.npz"), str(folder / "avoid-1-1.npz")}
    assert not np.array_equal(found[0].skill.values, found[1].skill.values)
    with pytest.raises(InputError, match=r"there is no skill file .*shoot-7\.npz"):
        Learning(recipe(folder), seed=7, trials=40)


def test_a_greedy_criterion_is_about_the_skills_in_their_areas(folder, monkeypatch):
    mine = recipe(folder, raise_when={"greedy_success": {"at_least": 0.9}}, worth="steps")
    learning, asked = Learning(mine, seed=0, trials=40), []
    measured = behaviors.learning.run_greedy
    monkeypatch.setattr(behaviors.learning, "run_greedy", lambda *of: asked.append(of[1]) or measured(*of))
    start = learning._start
    learning.advance()
    assert asked
    assert all(np.array_equal(one.values[start.fixed], start.skill.values[start.fixed]) for one in asked)


def test_skills_of_other_axes_are_refused(folder):
    wrong = {
        r"looks at 2 axes of the robot, which are not the first of the 1": recipe(folder, 2),
        r"are not the first of those of the skill": recipe(folder, skill="avoid-other.npz"),
        r"looks at 1 axes of the robot, which are not the first": recipe(folder, axis_order="reversed"),
        r"are not the first of those of the skill .*avoid-1-0": recipe(folder, 2, whole=1, most_dimensions=1),
    }
    for said, one in wrong.items():
        with pytest.raises(InputError, match=said):
            Learning(one, seed=0, trials=40)
    plain = msgspec.structs.replace(recipe(folder, skill="avoid-1-1.npz"), curriculum=msgspec.UNSET)
    assert coordinate(plain, seed=0).skill.objects[2].order == 3
