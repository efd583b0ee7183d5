"""Skills that need an object, and the tasks defend and home, learned: in which trials, what, and what is kept."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from behaviors.cards import make_card
from behaviors.learning import evaluate, learn
from behaviors.recipe import Recipe, recipe_digest
from behaviors.tabular.qlearning import make_learner
from behaviors.tabular.table import make_table
from behaviors.trials.minds import make_store
from behaviors.trials.solo import provisional_skill, solo_scene
from behaviors.trials.task import COLLISION, FAILURE, GOING, SUCCESS
from coevo.config import check
from coevo.errors import InputError
from coevo.skill import load_skill
from coevo.soccer.camera import ROBOTS
from coevo.soccer.drive import action_set
from coevo.stage import LEARNER, RANDOM

STANDING = 4  # of the nine actions of power wheeled steering
SHORT = {
    "trials": 500,
    "experience": {"windows": 1500},
    "learning": {"check_every": 250, "check_games": 20},
}


def recipe_of(task, *, needed=(), **parts):  # noqa: ANN003 - settings of a recipe
    """Return a short learning of a task, with small models of what it looks at."""
    kinds = {"shoot": ("ball", "opponent_goal"), "defend": ("ball", "own_goal"), "home": ("own_goal",)}[task]
    plain = {"name": f"narrow-{task}", "task": task, **SHORT, **parts}
    small = {"history_length": 1, "order": 1}
    plain["objects"] = [{"kind": kind, "needed": kind in needed, **small} for kind in kinds]
    if task == "defend":
        plain.setdefault("mover", {"kind": "skill", "skill": "shoot"})
    return check(Recipe, plain, "mine")


@pytest.mark.parametrize(("task", "needed"), [("defend", ("ball",)), ("home", ("own_goal",)), ("home", ())])
def test_each_can_be_learned_and_says_how(task, needed, tmp_path):
    recipe = recipe_of(task, needed=needed)
    skill = learn(recipe, seed=3)
    assert skill.domain == needed
    assert skill.digest == learn(recipe, seed=3).digest
    assert check(Recipe, skill.about["recipe"], "about") == recipe
    assert skill.about["recipe_digest"] == recipe_digest(recipe)
    assert np.isfinite(skill.values).all()
    assert skill.values.any()
    skill.save(tmp_path / "skill.npz")
    assert load_skill(tmp_path / "skill.npz").digest == skill.digest
    card = make_card(recipe, skill, games=20, seed=1)
    assert card["task"] == task
    assert card["measured"]["in-view"]["games"] == 20
    # Nothing was learned where what it needs, here the first object, is out of view: there it stood.
    sizes = [model.states for model in skill.objects]
    lost = np.unravel_index(np.arange(len(skill.values)), sizes)[0] >= 3
    assert skill.values[lost].any() == (not needed)
    assert (skill.policy[lost] == STANDING).all() == bool(needed)


def test_while_a_learner_does_not_see_what_it_needs_it_stands_and_decides_nothing():
    recipe = recipe_of("shoot", needed=("ball",), learning={"patience_steps": 12, "epsilon_start": 1.0})
    assert action_set(recipe.world.robot).standing == STANDING
    blank = dataclasses.replace(load_skill("shoot"), domain=("ball",))
    table = make_table(len(blank.values), 9)
    scene = solo_scene(recipe, blank, LEARNER, learner=make_learner(recipe.learning), table=table)
    seeds = np.arange(150, dtype=np.uint64)
    watched, cut = scene.watch(seeds), 0
    states = (29, 29)  # of ball and goal, 27 of each with the object in view
    assert blank.values.shape == (29 * 29, 9)
    for one in watched:
        lost = np.unravel_index(one.trace.perceived[:, 0], states)[0] >= 27
        begins = np.flatnonzero(np.diff(one.trace.actions[:, 0], prepend=-1))
        assert (one.trace.actions[begins[lost[begins]], 0] == STANDING).all()
        if one.ends == FAILURE and lost[-12:].all():
            cut += 1
        longest = max((len(run) for run in "".join("x" if gone else " " for gone in lost).split()), default=0)
        assert longest <= 13  # and then the trial is over
    assert cut > 20
    visits = scene.minds[0].table.visits.reshape(*states, 9)
    assert visits[:27].any()
    assert not visits[27:].any()


def test_what_comes_before_the_first_decision_is_nobody_s_doing():
    """The last place of the decisions, which comes before the first, stays as it is."""
    recipe = check(
        Recipe,
        {
            "name": "mine",
            "task": "avoid",
            "starts": "anywhere",
            "objects": [{"kind": "ball", "needed": True}],
            "mover": {"kind": "chaser"},
            "learning": {"patience_steps": 9000},
        },
        "mine",
    )
    blind = dataclasses.replace(provisional_skill(recipe), domain=("ball",))
    learner = make_learner(recipe.learning)
    scene = solo_scene(recipe, blind, LEARNER, learner=learner, table=make_table(len(blind.values), 9))
    decisions = scene.trial.minds.decisions
    decisions.rewards[:] = 7.0
    undecided = 0
    for seed in range(40):
        found = scene.run(np.array([seed], np.uint64), total=1)
        if found.ends[0] == COLLISION and decisions.made[0] == 0:
            assert (decisions.rewards == 7.0).all()
            undecided += 1
        decisions.rewards[:] = 7.0
    assert undecided > 5


def test_experience_of_defending_ends_with_a_goal():
    recipe = recipe_of("defend")
    store = make_store(5000, ROBOTS + 2)
    scene = solo_scene(recipe, provisional_skill(recipe), RANDOM, store=store)
    found = scene.run(np.full(5000, 7, np.uint64), limit=900)
    trials = np.unique(scene.minds[0].store.trial)
    assert len(trials) > 10  # without it, six would fill the store
    assert (found.ends[: len(trials) - 1] == FAILURE).sum() > 5


def test_a_defender_that_stands_before_its_goal_concedes_as_a_whole_count_says():
    recipe = recipe_of("defend")
    found = evaluate(recipe, "random", games=60, seed=5)
    assert np.array_equal(found.success, found.outcomes != FAILURE)
    assert set(found.outcomes.tolist()) <= {GOING, SUCCESS, FAILURE}
    informed = evaluate(recipe, "informed", games=60, seed=5)
    assert informed.success_rate > found.success_rate


def test_an_attacker_that_is_not_there_is_refused_before_anything_is_learned():
    with pytest.raises(InputError, match=r"no installed skill 'shot'\. Did you mean 'shoot'"):
        learn(recipe_of("defend", mover={"kind": "skill", "skill": "shot"}))
