"""Sets of chapter 3 as files: the same whatever runs them, finished or failed, and gone on with after a stop."""

from __future__ import annotations

import csv
import json
import re
import shutil

import numpy as np
import pytest
from click.testing import CliRunner

from behaviors.schedule.course import Course
from behaviors.schedule.recipe import read_schedule
from behaviors.studies.chapter3 import chapter3
from behaviors.studies.watching import chapter3_watch
from coevo.errors import InputError
from coevo.seeds import game_seed
from coevo.skill import load_skill

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


@pytest.mark.slow
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


@pytest.fixture
def begun(finished, tmp_path):
    """Return a folder with one finished set, and the checkpoint of another that has been through period A."""
    shutil.copytree(finished / "schedule" / "set-00", tmp_path / "schedule" / "set-00")
    schedule = read_schedule("chapter3/schedule", SMALL)
    course = Course(schedule, int(game_seed(schedule.seed, 1)))
    assert course.advance() == ("A", 60, 60)
    course.save(tmp_path / "schedule" / ".set-01.npz")
    return tmp_path


def test_a_set_under_way_is_gone_on_with_and_leaves_no_checkpoint(finished, begun, capfd):
    result = run(begun, "--sets", "2", "--workers", "1")
    assert result.exit_code == 0, result.output
    assert "1 sets to run, 1 are finished" in result.output
    told = capfd.readouterr().err  # of the process that ran it
    assert "schedule set 1: period B, 60 of 60 trials" in told
    assert "period A" not in told
    assert files(begun) == files(finished)


def test_a_checkpoint_that_does_not_serve_is_told_with_the_remedy_and_stays(begun):
    checkpoint = begun / "schedule" / ".set-01.npz"
    checkpoint.write_bytes(checkpoint.read_bytes()[:-100])
    before = checkpoint.read_bytes()
    result = run(begun, "--sets", "2", "--workers", "1")
    assert result.exit_code == 1
    assert "failed: schedule set 1: " in result.output
    assert "remove it, and the set begins anew" in result.output
    assert "Traceback" not in result.output
    assert checkpoint.read_bytes() == before
    checkpoint.unlink()
    assert run(begun, "--sets", "2", "--workers", "1").exit_code == 0


# ------------------------------------------------------------------------------------------------ watching a set


def watched(folder, *options):
    return CliRunner().invoke(chapter3_watch, [str(folder), "--quiet", *map(str, options)])


def page_of(path):
    found = re.search(r'type="application/json">(.*?)</script>', path.read_text(encoding="utf-8"), re.DOTALL)
    return json.loads(found[1])


@pytest.mark.parametrize("number", [0, 1])
def test_the_trials_that_are_watched_are_those_that_were_measured_afterwards(finished, tmp_path, number):
    folder, out = finished / "schedule" / f"set-0{number}", tmp_path / "pair.html"
    after = json.loads((folder / "set.json").read_text(encoding="utf-8"))["after"]
    result = watched(folder, "--games", after["games"], "--out", out, "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["trials"] == list(range(1, 21))
    data = page_of(out)
    games = data["games"]
    assert np.mean([game["steps"] for game in games]) == pytest.approx(after["steps"])
    assert np.mean([game["point"] == 0 for game in games]) == pytest.approx(after["shooting"])
    assert np.mean([not game["ending"].endswith(", 0 passes") for game in games]) == pytest.approx(after["passing"])
    assert np.mean(["collision" in game["ending"] for game in games]) == pytest.approx(after["collisions"])
    assert [robot["name"] for robot in data["robots"]] == ["P", "S"]
    assert all(all(game["images"]) for game in games)


def test_trials_can_be_chosen_by_what_happens_in_them(finished, tmp_path):
    folder, out = finished / "schedule" / "set-00", tmp_path / "pair.html"
    assert watched(folder, "--games", 20, "--out", out).exit_code == 0
    scored = [n for n, game in enumerate(page_of(out)["games"], 1) if game["point"] == 0]
    found = watched(folder, "--only", "goal", "--games", 20, "--out", out, "--json")
    if scored:
        assert json.loads(found.stdout)["trials"] == scored
        assert [game["title"] for game in page_of(out)["games"]] == [f"trial {n}" for n in scored]
    else:
        assert "none of the 20 trials" in str(found.exception)


def test_what_is_no_finished_set_is_refused_in_words(finished, tmp_path):
    for folder in (finished, finished / "schedule", tmp_path):
        result = watched(folder, "--out", tmp_path / "pair.html")
        assert isinstance(result.exception, InputError)
        assert "is no finished set: cannot read" in str(result.exception)
