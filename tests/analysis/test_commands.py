"""The commands that read runs, as a user calls them."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pandas as pd
import pytest

from analysis.progress import LABELS
from analysis.tournament import stored_tournaments
from coevo.errors import InputError
from coevo.run import open_run


@pytest.fixture
def no_results(copied_run):
    """Return a copy of the small run of which nothing was found out yet."""
    shutil.rmtree(copied_run / "results", ignore_errors=True)
    return copied_run


def refused(said, *parts):
    assert (said.code, said.out) == (2, "")
    assert "Traceback" not in said.err
    for part in parts:
        assert part in said.err


def test_a_tournament_is_one_object_of_what_it_kept(coevo, no_results):
    said = coevo("tournament", no_results, "--games", 2, "--again", 2, "--json")
    data = json.loads(said.out)
    assert said.code == 0
    (kept,) = stored_tournaments(open_run(no_results))
    assert data["generations"] == list(kept.generations) == [0, 1, 2]
    assert [side["team"] for side in data["sides"]] == [0, 1]
    for number, side in enumerate(data["sides"]):
        assert side["wins"] == kept.share(number).tolist()
    assert set(data["diagnosis"]) <= set(LABELS)
    assert {row["outsider"] for row in data["against"]} == {"shoot", "pass", "avoid", "search"}
    assert {row["generation"] for row in data["ratings"]} == {0, 1, 2}
    assert "9 of 9 pairs of generations" in said.err


def test_a_second_tournament_is_read(coevo, no_results):
    first = coevo("tournament", no_results, "--games", 2, "--every", 2, "--json")
    kept = {path.name: path.read_bytes() for path in (no_results / "results").iterdir()}
    again = coevo("tournament", no_results, "--games", 2, "--every", 2, "--json", "--workers", 1, "--quiet")
    assert again.out == first.out
    assert again.err == ""
    assert {path.name: path.read_bytes() for path in (no_results / "results").iterdir()} == kept


@pytest.mark.parametrize("suffix", [".csv", ".svg", ".png", ".html"])
def test_the_matrices_are_written(suffix, coevo, no_results, tmp_path):
    out = tmp_path / f"matrix{suffix}"
    said = coevo("tournament", no_results, "--games", 1, "--every", 2, "--again", 0, "--out", out)
    assert said.code == 0
    assert f"Written: {out}" in said.out
    if suffix == ".csv":
        table = pd.read_csv(out)
        assert list(table.columns) == ["side", "generation", "met", "share", "lost"]
        assert len(table) == 2 * 2 * 2
    assert out.stat().st_size > 0


@pytest.mark.slow
def test_a_report_goes_into_the_run_folder_by_default(coevo, no_results):
    said = coevo("report", no_results, "--json")
    data = json.loads(said.out)
    assert data["report"] == str(no_results / "report.html")
    assert Path(data["report"]).read_text(encoding="utf-8").startswith("<!doctype html>")
    assert data["short"][0].startswith("r0 and r1 against r2 co-evolved for 3 generations")
    assert "Judging the last champions" in said.err


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["tournament", "absent"], ["absent"]),
        (["tournament", "RUN", "--against", "shout"], ["unknown name 'shout'", "Did you mean 'shoot'"]),
        (["tournament", "RUN", "--out", "matrix.jpg"], ["expected a file ending in .svg, .png, .html, .csv"]),
        (["tournament", "RUN", "--out", "absent/matrix.svg"], ["there is no folder absent; make it first"]),
        (["report", "absent"], ["absent"]),
        (["report", "RUN", "--out", "report.pdf"], ["expected a file ending in .html"]),
        (["report", "RUN", "RUN"], ["is named twice"]),
        (["report"], ["Missing argument"]),
    ],
)
def test_wrong_input_is_told_and_nothing_is_played(arguments, parts, coevo, no_results, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused(coevo(*(str(no_results) if word == "RUN" else word for word in arguments)), *parts)
    assert not (no_results / "results").exists()


def test_tables_need_no_altair(coevo, no_results, monkeypatch, tmp_path):
    monkeypatch.setattr(
        "importlib.util.find_spec", lambda name: None if name in ("altair", "vl_convert", "statsmodels") else object()
    )
    for module in ("altair", "vl_convert", "statsmodels", "statsmodels.api"):
        monkeypatch.setitem(sys.modules, module, None)
    for charts in ("analysis.tournament.charts", "analysis.ancestry.charts"):
        monkeypatch.delitem(sys.modules, charts, raising=False)
    said = coevo("tournament", no_results, "--games", 1, "--again", 0, "--out", tmp_path / "matrix.csv", "--json")
    assert json.loads(said.out)["ratings"] == []
    assert coevo("ancestry", no_results, "--out", tmp_path / "ancestors.csv").code == 0
    assert len(pd.read_csv(tmp_path / "ancestors.csv")) > 0


def test_two_runs_of_one_name_are_two_outsiders(coevo, no_results, tmp_path):
    for name in ("a", "b"):
        shutil.copytree(no_results, tmp_path / name / "run")
    others = [word for name in ("a", "b") for word in ("--against", tmp_path / name / "run")]
    said = coevo("tournament", no_results, "--games", 1, "--again", 0, *others, *others)
    assert said.code == 0
    assert "6 of 6 outsiders" in said.err


def test_a_run_that_cannot_be_judged_is_whole_all_the_same(coevo, copied_run, monkeypatch):
    def fail(_run, _evaluator, *, games):  # noqa: ARG001 - as of judge
        raise InputError("the robots and the ball do not fit")

    monkeypatch.setattr("coevo.contest.judge", fail)
    said = coevo("resume", copied_run, "--unseen", 40)
    assert said.code == 0
    assert "could not be judged: the robots and the ball do not fit" in said.err


def test_charts_without_altair_say_what_to_install(coevo, no_results, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "altair" else object())
    refused(coevo("report", no_results), "charts need altair", "pip install 'coevo[report]'")


def test_evolve_ends_with_games_that_evolution_has_not_seen(coevo, small_run, tmp_path):
    recipe, out = small_run.path / "config.toml", tmp_path / "run"
    said = coevo("evolve", recipe, "--out", out, "--unseen", 40, "--json")
    told = json.loads(said.out)["unseen"]
    assert [one["team"] for one in told] == [0, 1]
    for one in told:
        assert one["games"] == 40
        for key in ("last", "first", "single_skills"):
            share, low, high = one[key]
            assert 0.0 <= low <= share <= high <= 1.0
    again = coevo("resume", out, "--unseen", 40)
    assert "Share of 40 unseen games won" in again.out
    for one in told:
        assert f"{one['last'][0]:.3f} [{one['last'][1]:.3f}, {one['last'][2]:.3f}]" in again.out
    for next_command in ("coevo report", "coevo inspect", "coevo play"):
        assert next_command in again.out
    assert "unseen games won" not in coevo("resume", out, "--unseen", 0).out
    assert json.loads(coevo("resume", out, "--unseen", 0, "--json").out)["unseen"] == []
