"""Recipes and experience that cannot be learned from: told in plain lines, or a fallback that is written down."""

from __future__ import annotations

import sys
import warnings

import msgspec
import numpy as np
import pytest

from behaviors import experience as experience_module
from behaviors.experience import Experience, make_models
from behaviors.learning import evaluate, learn
from behaviors.lpm import PersistentExcitationWarning
from behaviors.recipe import Recipe, read_recipe
from coevo.cli import main
from coevo.config import check
from coevo.errors import InputError
from coevo.skill import load_skill

PLAIN = """
name = "mine"
task = "search"
trials = 20
[[objects]]
kind = "ball"
"""
# A camera that looks at its own feet: from afar it never sees a goal and the ball at once.
BLIND = "[world.camera]\ntilt_deg = -50.0\nvertical_view_deg = 10.0\n"
UPWARDS = "[world.camera]\ntilt_deg = 29.0\nvertical_view_deg = 6.0\n"


@pytest.fixture
def coevo(monkeypatch, capsys, tmp_path):
    """Return a function that learns a recipe in this process and returns its exit code, stdout and stderr."""

    def run(text, *arguments):
        (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
        command = ["coevo", "learn", tmp_path / "mine.toml", "--out", tmp_path / "out", "--games", "20", *arguments]
        monkeypatch.setattr(sys, "argv", list(map(str, command)))
        code = 0
        try:
            main()
        except SystemExit as stop:
            code = stop.code
        return code or 0, *capsys.readouterr()

    return run


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        pytest.param(PLAIN.replace("trials", "trails"), ["'trails'. Did you mean 'trials'?"], id="misspelt"),
        pytest.param(PLAIN + "[learning]\nupdates = 'x'", ["'learning.updates'. Did you mean 'update'?"], id="younger"),
        pytest.param(PLAIN.replace("mine", "../mine"), ["name", "got '../mine'"], id="a name that is a path"),
        pytest.param(
            PLAIN + "history_length = 12\n[experience]\ntrial_steps = 10\n",
            ["the model of ball", "history_length 12 needs a segment of at least 24 rows", "record longer"],
            id="short stretches",
        ),
        pytest.param(
            PLAIN + "order = 8\nhistory_length = 1\n",
            ["the model of ball", "order 8 is too large", "at most 4"],
            id="order",
        ),
        pytest.param(
            PLAIN + "history_length = 12\n[experience]\nwindows = 100\n",
            ["the model of ball", "needs more than", "record more"],
            id="few windows",
        ),
        pytest.param(
            PLAIN.replace("search", "shoot") + BLIND, ["no start was found", "'shoot'", "world.camera"], id="no start"
        ),
        pytest.param(
            PLAIN.replace("search", "shoot") + 'starts = "anywhere"\n' + BLIND,
            ["unknown setting 'objects.0.starts'"],
            id="in the wrong table",
        ),
        pytest.param(
            PLAIN + UPWARDS, ["its ball came into view in 0 of 20000 steps", "experience.windows"], id="never seen"
        ),
        pytest.param(
            PLAIN + "order = 8\nhistory_length = 3\n" + '[[objects]]\nkind = "ball"\norder = 8\nhistory_length = 3\n',
            ["states together", "smaller order"],
            id="too many states",
        ),
        pytest.param(PLAIN + "[world.camera]\nheight_px = 8\nwidth_px = 8\n", [], id="hardly an image"),
        pytest.param("goal_reward = 1e300\n" + PLAIN, ["goal_reward", "<= 1000000.0"], id="reward"),
    ],
)
def test_a_recipe_that_cannot_be_learned_is_told_without_a_traceback(text, parts, coevo, tmp_path):
    code, out, err = coevo(text)
    assert "Traceback" not in err
    if not parts:  # it can be learned, whatever comes of it
        assert code == 0
        return
    assert (code, out) == (2, "")
    for part in parts:
        assert part in err
    assert err.count("\n") <= 3
    assert not (tmp_path / "out" / "skill.npz").exists()


def test_orders_that_are_left_out_are_chosen_and_the_recipe_is_written_as_it_was_read(coevo, tmp_path):
    code, _, err = coevo(PLAIN + "[experience]\nwindows = 1000\n", "--quiet")
    assert (code, err) == (0, "")
    assert read_recipe(str(tmp_path / "out" / "recipe.toml")) == read_recipe(str(tmp_path / "mine.toml"))
    (model,) = load_skill(tmp_path / "out").objects
    assert model.order >= 1
    assert model.history_length >= 1


def test_actions_that_never_change_in_a_trial_are_warned_of_and_learned_with(coevo):
    text = PLAIN + "history_length = 2\norder = 3\n[experience]\nhold_min_steps = 900\nhold_max_steps = 900\n"
    code, _, err = coevo(text)
    assert code == 0
    assert "Beware: the actions are not persistently exciting of order 3" in err
    assert "record actions that vary more" in err


# -------------------------------------------------------------------------------------------------- hostile experience


@pytest.fixture
def told(monkeypatch):
    """Return a function that makes the ball's model of made-up stretches."""

    def make(stretches, **settings):  # noqa: ANN003 - of the model
        monkeypatch.setattr(experience_module, "experience", lambda _recipe, _seed: Experience({"ball": stretches}, 1))
        text = {"name": "mine", "task": "search", "objects": [{"kind": "ball", **settings}]}
        ((model,), _) = make_models(check(Recipe, text, "mine"), 1)
        return model

    return make


def stretch(rows=400, seed=1):
    """Return actions and what a ball might look like that they push about."""
    rng = np.random.default_rng(seed)
    actions = rng.integers(-1, 2, (rows, 2)).astype(np.float64)
    seen = 30.0 + np.cumsum(actions @ rng.normal(size=(2, 4)), axis=0) + rng.normal(size=(rows, 4))
    return actions, seen


def test_constant_observations_are_refused_by_either_estimator(told):
    actions, seen = stretch()
    still = [(actions, np.full_like(seen, 7.0))]
    with pytest.raises(InputError, match=r"'mine', the model of ball: all 4 observations are constant"):
        told(still)
    with pytest.raises(InputError, match=r"the area of ball took 1 different values"):
        told(still, estimator="raw")


def test_a_single_constant_feature_says_nothing_and_changes_nothing(told):
    actions, seen = stretch()
    seen[:, 2] = 5.0
    model = told([(actions, seen)], history_length=2, order=2)
    assert np.isfinite(model.memory_matrix).all()
    assert np.abs(model.memory_matrix[:, [4 + 2, 8 + 2]]).max() < 1e-12  # the radius, now and a step before
    assert np.abs(model.memory_matrix).max() > 1e-3


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_observations_that_are_no_numbers_are_refused_by_either_estimator(told, value):
    actions, seen = stretch()
    seen[17, 3] = value
    with pytest.raises(InputError, match=r"the model of ball: segment 0 holds NaN or infinite values, first in row 17"):
        told([(actions, seen)])
    with pytest.raises(InputError, match=r"features of ball are not all finite"):
        told([(actions, seen)], estimator="raw")


def test_one_action_only_is_warned_of_and_gives_a_finite_model(told):
    actions, seen = stretch()
    actions[:] = (1.0, 0.0)
    with pytest.warns(PersistentExcitationWarning, match="not persistently exciting"):
        model = told([(actions, seen)], history_length=2, order=2)
    assert np.isfinite(model.memory_matrix).all()


def test_stretches_shorter_than_the_history_are_left_out(told):
    # Documented in behaviors.lpm.identify: no window crosses two segments, those with T < 2l hold none.
    whole, short = stretch(), stretch(3, seed=2)
    one, both = (told(parts, history_length=2, order=2) for parts in ([whole], [short, whole, short]))
    assert np.array_equal(one.past_mean, both.past_mean)


def test_trials_of_one_step_can_be_learned_and_measured():
    recipe = msgspec.structs.replace(read_recipe("search"), time_limit_steps=1, trials=20)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        skill = learn(recipe)
    assert set(evaluate(recipe, skill, games=20, seed=1).steps.tolist()) == {1}
