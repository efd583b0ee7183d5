"""Learning from easy to hard: levels and axes move as they should, and what is learned is what it would be without."""

from __future__ import annotations

import csv
import io
import itertools
import json

import msgspec
import numpy as np
import pytest
import tomli_w

from behaviors.curriculum import TABLES, growth_order
from behaviors.experience import make_models
from behaviors.learning import Learning, learn
from behaviors.recipe import Recipe
from behaviors.tabular.growing import origins
from coevo.config import check, override, to_toml
from coevo.errors import InputError

KEYS = [{"world.robot.max_turn_rate_dps": [30.0, 60.0, 120.0]}]
SEARCH = {
    "kind": "skill",
    "name": "look",
    "task": "search",
    "trials": 1200,
    "time_limit_steps": 120,
    "objects": [{"kind": "ball", "history_length": 3, "order": 3}],
    "experience": {"windows": 500},
    "learning": {"check_every": 400, "check_games": 20, "check_from": 0.0},
    "curriculum": {
        "keys": KEYS,
        "raise_when": {"success": {"at_least": 0.7}},
        "trials": 50,
        "window": 2,
        "patience": 2,
        "improvement": 0.05,
        "grow": ["ball"],
        "dimension": 1,
        "most_dimensions": 3,
    },
}


def made(*changes, **parts):  # noqa: ANN003 - settings of the curriculum
    """Return the recipe with settings replaced."""
    data = {**SEARCH, "curriculum": {**SEARCH["curriculum"], **parts}}
    return check(Recipe, override(data, changes), "mine")


def begin(recipe):
    return Learning(recipe, seed=recipe.seed, trials=recipe.trials)


def finished(learning):
    while not learning.is_finished:
        learning.advance()
    return learning


def tables(learning):
    """Return the rows of levels.csv and of observations.csv."""
    return [
        list(csv.DictReader(io.StringIO(data.decode()))) for name, data in learning.files().items() if name in TABLES
    ]


# ---------------------------------------------------------------------------------------------------- what it does


def test_with_all_axes_on_the_highest_level_it_is_the_learning_without():
    recipe = made(first=2, dimension=3, at_the_top="stay", patience=0)
    plain = msgspec.structs.replace(recipe, curriculum=msgspec.UNSET)
    mine, other = learn(recipe), learn(plain)
    assert mine.digest == other.digest
    assert mine.about["curriculum"]["trials"] == 1200
    assert "curriculum" not in other.about


@pytest.mark.parametrize("storage", ["dense", "sparse"])
def test_it_moves_when_the_criteria_say_so_and_growth_changes_no_policy(storage):
    recipe = made(f"learning.storage={storage}", raise_when={"success": {"at_least": 0.97}})
    learning, at = begin(recipe), None
    grown = []
    while not learning.is_finished:
        at = learning._curriculum.controller
        before = at.level, at.dimension
        sizes = [(model.order, model.lost_states) for model in learning._blank.objects]
        learning.advance()
        if learning.moved and at.dimension > before[1]:
            origin = origins(sizes, 0)
            best = learning._practice.values_kept()[0]
            assert len(learning._practice.values_now()[0]) == len(origin) == len(best)
            by_origin = [learning._practice.values_now()[0][origin == state] for state in range(origin.max() + 1)]
            assert all((cells == cells[0]).all() for cells in by_origin)
            assert not learning._practice.at.tables[0].visits.any()
            grown.append(learning.done)
    moved, observed = tables(learning)
    assert [row["event"] for row in moved if row["event"] == "axis_added"] == ["axis_added"] * 2
    assert [int(row["trial"]) for row in moved if row["event"] == "axis_added"] == grown
    for row, after in itertools.pairwise(moved):
        run = [one for one in observed if int(row["trial"]) < int(one["trial"]) <= int(after["trial"])]
        assert {(one["level"], one["dimension"]) for one in run} <= {(row["level"], row["dimension"])}
        windows = [
            (int(a["success"]) + int(b["success"])) / (int(a["trials"]) + int(b["trials"]))
            for a, b in itertools.pairwise(run)
        ]
        assert all(rate < 0.97 for rate in windows[:-1])
        if after["event"] == "raised":
            assert windows[-1] == float(after["success_rate"]) >= 0.97
    assert sum(int(one["trials"]) for one in observed) == learning.done
    assert sum(int(one["steps"]) for one in observed) == learning._practice.at.results.steps.sum()


def test_the_world_is_that_of_the_level():
    slow = made(raise_when={"success": {"at_least": 1.0}}, patience=0, at_the_top="stay")
    plain = override(
        msgspec.to_builtins(msgspec.structs.replace(slow, curriculum=msgspec.UNSET)),
        ["world.robot.max_turn_rate_dps=30.0", "trials=100"],
    )
    learning = begin(slow)
    for _ in range(2):
        learning.advance()
    other = check(Recipe, plain, "slow")
    models = learning._models
    alone = Learning(other, seed=slow.seed, trials=1200, kept=None)
    assert alone._models[0].memory_matrix.shape == models[0].memory_matrix.shape
    assert learning._here.world == other.world
    assert not np.array_equal(
        alone._models[0].memory_matrix, models[0].memory_matrix
    )  # identified in the hardest world


def test_a_criterion_may_be_about_the_greedy_policy_and_values_may_converge():
    recipe = made(raise_when={"greedy_success": {"at_least": 0.9}}, converged_below=0.5, patience=0)
    learning = finished(begin(recipe))
    moved, observed = tables(learning)
    assert {row["games"] for row in observed} == {"20"}
    assert "axis_added" in [row["event"] for row in moved]  # values that change little ask for an axis


def test_axes_in_other_orders_are_the_same_axes():
    found = {}
    models = make_models(made(), 1)[0]
    for order in ("model", "reversed", "random"):
        orders = [growth_order(made(axis_order=order), models, seed) for seed in range(20)]
        assert all(sorted(one) == [(0, 0), (0, 1), (0, 2)] for one in orders)
        found[order] = {tuple(one) for one in orders}
    assert found["model"] == {((0, 0), (0, 1), (0, 2))}
    assert found["reversed"] == {((0, 2), (0, 1), (0, 0))}
    assert len(found["random"]) > 3


def test_axes_of_several_objects_are_added_in_turn():
    goal = {"kind": "opponent_goal", "history_length": 1, "order": 2}
    data = {**SEARCH, "objects": [*SEARCH["objects"], goal]}
    data["curriculum"] = {**SEARCH["curriculum"], "grow": ["ball", "opponent_goal"], "dimension": 2, "patience": 1}
    data["curriculum"] |= {"most_dimensions": 5, "raise_when": {"success": {"at_least": 1.0}}}
    learning = finished(begin(check(Recipe, data, "mine")))
    axes = learning.skill().about["curriculum"]["axes"]
    assert axes == [["ball", 0], ["opponent_goal", 0], ["ball", 1], ["opponent_goal", 1], ["ball", 2]]
    assert [model.order for model in learning.skill().objects] == [3, 2]


# ----------------------------------------------------------------------------------------------- stopped, and told


@pytest.mark.parametrize("storage", ["dense", "sparse"])
def test_a_curriculum_stopped_after_any_block_ends_in_the_same_bytes(storage, tmp_path):
    recipe = made(f"learning.storage={storage}", "trials=900", converged_below=0.05)
    whole = finished(begin(recipe))
    assert whole.skill().about["curriculum"]["weak_critical_periods"]
    path, learning = tmp_path / "learning.npz", begin(recipe)
    while not learning.is_finished:
        learning.save(path)
        learning = Learning.load(path, recipe, seed=recipe.seed, trials=recipe.trials)
        learning.advance()
    assert learning.skill().to_bytes() == whole.skill().to_bytes()
    assert learning.files() == whole.files()


def test_coevo_learn_tells_what_moved_and_leaves_tables(tmp_path, coevo):
    (tmp_path / "look.toml").write_text(to_toml(made("trials=600")))
    out = tmp_path / "out"
    said = coevo("learn", tmp_path / "look.toml", "--out", out, "--games", "20", "--json")
    assert said.code == 0
    card = json.loads(said.out)
    assert card["curriculum"] == json.loads((out / "card.json").read_text())["curriculum"]
    assert "level 0 of 0 to 2, 2 axes" in said.err
    with (out / "levels.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:6] == ["trial", "event", "level", "dimension", "success_rate", "collision_rate"]
    assert (rows[0]["event"], rows[-1]["event"]) == ("start", "end")
    assert {row["world.robot.max_turn_rate_dps"] for row in rows} <= {"30.0", "60.0", "120.0"}
    assert int(rows[-1]["trial"]) == card["curriculum"]["trials"] <= 600


# -------------------------------------------------------------------------------------------------------- bad input

WRONG = {
    "no setting": ({"keys": [{"world.robot.max_sped_mps": [0.5, 1.0]}]}, "Did you mean 'max_speed_mps'"),
    "not a level's": ({"keys": [{"objects.0.order": [1, 2]}]}, "a level may change settings of world"),
    "another drive": ({"keys": [{"world.robot.drive": ["pws", "4ws"]}]}, "but not world.robot.drive"),
    "part of a drive": ({"keys": [{"world.robot": [{}, {"drive": "4ws"}]}]}, "but not world.robot.drive"),
    "refused": ({"keys": [{"world.robot.max_speed_mps": [0.5, 5.0]}]}, "level 1 of curriculum.keys"),
    "no start": (
        {"keys": [{"world.camera.tilt_deg": [-26.0, -50.0], "world.camera.vertical_view_deg": [60.0, 10.0]}]},
        "level 1 of curriculum.keys: the recipe 'look': no start was found",
    ),
    "no rate": ({"raise_when": {"succes": {"at_least": 0.7}}}, "Did you mean 'success'"),
    "too much": (
        {"raise_when": {"success": {"at_least": 0.7}, "timeouts": {"at_least": 0.4}}},
        "can never be met",
    ),
    "nobody there": ({"raise_when": {"collisions": {"at_least": 0.1}}}, "without another robot"),
    "never looked at": ({"window": 100}, "can never be met in trials = 1200"),
    "excluding": ({"raise_when": {"success": {"at_least": 0.7, "at_most": 0.5}}}, "can never be met together"),
    "no such axis": ({"most_dimensions": 4}, "have 3 axes"),
    "no such object": ({"grow": ["robot"]}, "expected objects that stand once"),
    "whose axes": ({"grow": []}, "expected grow"),
    "no axis": ({"dimension": 0}, "expected the first axis of each object"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_learned_is_refused_before_anything_is(name, coevo, tmp_path):
    parts, said = WRONG[name]
    task = "shoot" if name == "no start" else "search"
    data = {**SEARCH, "task": task, "curriculum": {**SEARCH["curriculum"], **parts}}
    (tmp_path / "wrong.toml").write_text(tomli_w.dumps(data))
    found = coevo("learn", tmp_path / "wrong.toml", "--out", tmp_path / "out", "--quiet")
    assert found.code == 2
    assert said in found.err
    assert "Traceback" not in found.err
    assert not list((tmp_path / "out").glob("*"))


def test_axes_that_a_chosen_order_lacks_are_refused_when_models_are_known():
    data = {**SEARCH, "objects": [{"kind": "ball"}]}
    data["curriculum"] = {**SEARCH["curriculum"], "most_dimensions": 100}
    recipe = check(Recipe, data, "mine")
    with pytest.raises(InputError, match="axes, got 100"):
        begin(recipe)
