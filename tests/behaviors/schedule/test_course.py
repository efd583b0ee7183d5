"""The periods of chapter 3: who stores, renews and learns when (Table 3.1), and sets as files."""

from __future__ import annotations

import csv
import json
import shutil

import numpy as np
import pytest
from behaviors.pair.agents import PERIODS
from behaviors.pair.data import FIXED
from behaviors.pair.recipe import read_schedule, transfer_world
from behaviors.pair.schedule import Schooling
from click.testing import CliRunner

from behaviors.studies.chapter3 import chapter3
from behaviors.tabular.table import make_table
from coevo.errors import InputError
from coevo.recipes import recipe_names
from coevo.skill import load_skill
from coevo.soccer.drive import action_set

SMALL = (
    "trials=60",
    "games=20",
    "time_limit_steps=100",
    "experience.windows=300",
    "store.steps=3000",
    "store.least_windows=100",
    "store.report_orders=false",
    "transfer.trials_e=1",
    "transfer.trials_f=1",
    *(f"{who}.learning.{what}" for who in ("passer", "shooter") for what in ("check_every=50", "check_games=10")),
)


def known(agent):
    """Return what a robot knows and stores, as bytes: its models, its values, its store."""
    models = b"".join(model.memory_matrix.tobytes() for model in agent.models)
    values = b"" if agent.values is None else agent.values.tobytes()
    return {"models": models, "values": values, "store": b"".join(part.tobytes() for part in agent.store)}


# What changes in each period: Table 3.1, and for the shooter in B "store and update".
CHANGES = {
    "A": ({"models", "values", "store"}, set()),
    "B": ({"store"}, {"models", "values", "store"}),
    "C": ({"models", "values"}, {"store"}),
    "D": ({"store"}, {"models", "values"}),
}


@pytest.mark.parametrize("reuse", ["mixture", "cold", "copy"])
def test_what_changes_in_a_period_is_what_table_3_1_says(reuse):
    one = Schooling(read_schedule("chapter3/schedule", [*SMALL, f"reuse={reuse}", "fixed_epsilon=0.5"]), 3)
    for period in PERIODS["scheduled"]:
        before = [known(agent) for agent in one.agents]
        one.learn((period,))
        after = [known(agent) for agent in one.agents]
        found = tuple({key for key in b if a[key] != b[key]} for a, b in zip(before, after, strict=True))
        assert found == CHANGES[period.name], period.name
        learner = one.agents[0 if period.name in "AC" else 1]
        assert (learner.old is not None) == (reuse == "mixture" and period.name in "CD")
    assert set(one.gathered) == {"A", "B"}
    assert [len(one.trials[p].ends) for p in "ABCD"] == [60] * 4


def test_a_pass_is_what_the_rules_of_the_world_say_in_both_worlds():
    schedule = read_schedule(
        "chapter3/schedule", ["world.rules.pass_window_s=1.0", "world.rules.collision_release_m=0.1"]
    )
    for world in (schedule.world, transfer_world(schedule)):
        one = Schooling(schedule, 3, world=world)
        tables = [make_table(1, len(action_set(world.robot).codes)) for _ in one.agents]
        assert one.pair((FIXED, FIXED), tables).limits == (0.004, 0.1, 30)


def test_with_simultaneous_learning_both_learn_in_as_many_trials():
    one = Schooling(read_schedule("chapter3/simultaneous", SMALL), 3)
    one.learn(PERIODS["simultaneous"])
    assert all(agent.values is not None and agent.values.any() for agent in one.agents)
    assert len(one.trials["S"].ends) == 240


def files(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def run(out, *options, recipe="schedule"):
    changes = [part for change in SMALL for part in ("--set", change)]
    return CliRunner().invoke(chapter3, [f"chapter3/{recipe}", "--out", str(out), *changes, *options])


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("one-worker")
    result = run(out, "--sets", "2", "--workers", "1")
    assert result.exit_code == 0, result.output
    return out


def test_the_number_of_workers_changes_no_byte(finished, tmp_path):
    assert run(tmp_path, "--sets", "2", "--workers", "2").exit_code == 0
    assert files(tmp_path) == files(finished)
    first, second = ((finished / "schedule" / f"set-0{n}" / "trials.csv").read_bytes() for n in range(2))
    assert first != second


def test_a_set_says_what_its_rows_say(finished):
    folder = finished / "schedule" / "set-00"
    told = json.loads((folder / "set.json").read_text(encoding="utf-8"))
    with (folder / "trials.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["period"] for row in rows] == [p for p in "ABCD" for _ in range(60)] + [*"EF"]
    for period, numbers in told["periods"].items():
        mine = [row for row in rows if row["period"] == period]
        assert numbers["trials"] == len(mine)
        assert numbers["passing"] == pytest.approx(np.mean([int(row["passes"]) > 0 for row in mine]))
        assert numbers["shooting"] == pytest.approx(np.mean([row["end"] == "1" for row in mine]))
    assert {row["nearer"] for row in rows} == {"passer", "shooter"}
    after = told["after"]
    parts = after["nearer"].values()
    assert sum(part["games"] for part in parts) == after["games"] == 20
    assert sum(part["games"] * part["passing"] for part in parts) == pytest.approx(20 * after["passing"])
    assert {row["period"] for row in told["models"]} == set("ABCDF")
    for name, states in told["states"].items():
        assert len(load_skill(folder / f"{name}.npz").values) == states


def test_finished_sets_are_not_run_again(finished, tmp_path):
    before = {path: path.stat().st_mtime_ns for path in (finished / "schedule").glob("set-*/*")}
    result = run(finished, "--sets", "2")
    assert result.exit_code == 0
    assert "0 sets to run, 2 are finished" in result.output
    assert {path: path.stat().st_mtime_ns for path in (finished / "schedule").glob("set-*/*")} == before
    other = run(finished, "--sets", "2", "--set", "trials=61")
    assert isinstance(other.exception, InputError)
    assert "holds sets of other settings" in str(other.exception)
    assert tmp_path.exists()


def test_a_set_that_fails_is_told_and_leaves_the_others(finished, tmp_path):
    shutil.copytree(finished / "schedule" / "set-00", tmp_path / "schedule" / "set-00")
    result = run(tmp_path, "--sets", "2", "--set", "store.least_windows=2990")
    assert result.exit_code == 1
    assert "failed: schedule set 1: schedule: random actions brought" in result.output
    assert "raise store.steps, or lower store.least_windows" in result.output
    assert "Traceback" not in result.output
    assert [path.name for path in (tmp_path / "schedule").glob("set-*")] == ["set-00"]


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ("pasess_rewarded=each", ["unknown setting 'pasess_rewarded'", "Did you mean 'passes_rewarded'?"]),
        ("passes_rewarded=none", ["passes_rewarded", "'first', 'each'", "got 'none'"]),
        ("transfer.supersample=2", ["supersample must be odd", "got 2"]),
        ("passer.also.0.kind=ball", ["'ball' is there twice"]),
        ("passer.action.min_steps=31", ["min_steps must be at most max_steps"]),
    ],
)
def test_a_wrong_setting_is_named_with_what_was_expected(change, parts):
    with pytest.raises(InputError) as caught:
        read_schedule("chapter3/schedule", [change])
    for part in parts:
        assert part in str(caught.value)


@pytest.mark.parametrize("name", recipe_names("schedule"))
def test_each_recipe_can_be_read_and_is_named_as_its_file(name):
    assert f"chapter3/{read_schedule(name).name}" == name
