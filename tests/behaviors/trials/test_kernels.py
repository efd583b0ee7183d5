"""Trials part by part: the schedule of learning, what each end teaches, the same trials in Python and in one call."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from behaviors.recipe import read_recipe
from behaviors.settings import LearningSettings, MoverSettings
from behaviors.tabular.qlearning import make_learner
from behaviors.tabular.table import make_table
from behaviors.trials.kernels import act, begin_trial, end_trial, judge_trial
from behaviors.trials.scene import Scene
from behaviors.trials.solo import solo_scene
from behaviors.trials.task import COLLISION, FAILURE, GOING, SUCCESS
from coevo.compiled import entry
from coevo.skill import estimate, load_skill
from coevo.stage import CHASER, LEARNER, ROAMER, STANDING, run_episode
from coevo.stage.kernels import sense

RULE = LearningSettings(epsilon_start=0.8, epsilon_end=0.2)


@entry
def discrete_state(stage, time):
    return estimate.discrete_state(stage.memory, stage.bank, 0, 0, time)


def scene_of(name, *, learner=None, actions=9, **changes) -> Scene:  # noqa: ANN003 - settings of a recipe
    recipe = msgspec.structs.replace(read_recipe(name), **changes)
    skill = load_skill(name)
    table = make_table(len(skill.values), actions)
    return solo_scene(recipe, skill, LEARNER, learner=learner or make_learner(RULE), table=table)


def stream(seed):
    return np.array([seed], np.uint64)


def test_randomness_falls_from_the_first_trial_to_the_last():
    scene = scene_of("search")
    for number, epsilon in ((0, 0.8), (25, 0.65), (50, 0.5), (100, 0.2)):
        assert begin_trial(scene.trial, number, 101, stream(1))
        assert scene.trial.progress[0] == number / 100
        assert scene.trial.minds.epsilon[0] == pytest.approx(epsilon)
    assert begin_trial(scene.trial, 0, 1, stream(1))  # of a single trial there is no last
    assert scene.trial.minds.epsilon[0] == 0.8


@pytest.mark.parametrize("ends", [GOING, SUCCESS, FAILURE, COLLISION])
def test_what_follows_a_policy_learns_its_steps_and_a_limit_on_top_where_it_failed(ends):
    learner = make_learner(LearningSettings(alpha=1.0, alpha_visits=0.0, gamma=0.999))
    scene = scene_of("shoot", learner=learner._replace(gamma=1.0, follows=True, never=900.0), actions=1)
    values, made = scene.minds[0].table.values, scene.trial.minds.decisions
    assert begin_trial(scene.trial, 0, 1, stream(2))
    sense(scene.trial.stage, 0, stream(2))
    last = discrete_state(scene.trial.stage, 0)
    row = 0 if last else 1
    values[:] = 50.0
    made.rows[0, 0], made.lengths[0, 0], made.made[0] = row, 7, 1
    end_trial(scene.trial, ends, 0)
    assert values[row, 0] == {GOING: 57.0, SUCCESS: 7.0, FAILURE: 907.0, COLLISION: 907.0}[ends]
    assert (np.delete(values, row) == 50.0).all()


@pytest.mark.parametrize(
    ("mover", "roles"),
    [
        (MoverSettings(kind="standing"), {STANDING}),
        (MoverSettings(kind="random"), {ROAMER}),
        (MoverSettings(kind="chaser"), {CHASER}),
        (MoverSettings(kind="random", share_of_chasers=0.5), {ROAMER, CHASER}),
    ],
    ids=["standing", "random", "chaser", "some chase"],
)
def test_the_other_robot_is_cast_anew_in_each_trial(mover, roles):
    scene, cast = scene_of("avoid", mover=mover), []
    for seed in range(60):
        assert begin_trial(scene.trial, 0, 1, stream(seed))
        cast.append(int(scene.trial.stage.roles.role[1]))
    assert set(cast) == roles
    if len(roles) > 1:
        assert 10 < cast.count(CHASER) < 50


@pytest.mark.parametrize("name", ["shoot", "avoid", "search", "pass"])
def test_trials_put_together_in_python_are_those_of_one_call(name):
    one, two = scene_of(name, time_limit_steps=90), scene_of(name, time_limit_steps=90)
    seeds = np.arange(10, dtype=np.uint64)
    found = one.run(seeds, total=20)
    for n, seed in enumerate(seeds):
        rng = np.array([seed])
        assert begin_trial(two.trial, n, 20, rng)
        ends, steps = run_episode.py_func(
            two,
            two.time_limit,
            rng,
            lambda scene, time, rng: sense(scene.trial.stage, time, rng),
            lambda scene, time, rng: act(scene.trial, time, rng),
            lambda scene, time: judge_trial(scene.trial, time),
        )
        end_trial(two.trial, ends, steps)
        assert (ends, steps) == (found.ends[n], found.steps[n])
    assert np.array_equal(one.minds[0].table.values, two.minds[0].table.values)
    assert np.array_equal(one.minds[0].table.visits, two.minds[0].table.visits)
    assert one.minds[0].table.visits.any()
