"""How games of several runs end: a run counts once."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from analysis.settlements import RATIO, over_runs
from coevo.run import create_run
from coevo.settlement import PATTERNS, Settled


def settled(*counts):
    return Settled("run", ("r0", "r1"), ("r2",), np.repeat(np.arange(len(PATTERNS)), counts), None)


def test_over_runs_a_run_counts_once():
    runs = [settled(30, 0, 10, 0, 0, 0), settled(10, 0, 30, 0, 0, 0), settled(0, 0, 4, 0, 0, 4000)]
    found = over_runs(runs).set_index("pattern")
    assert found.loc["interception", "share"] == pytest.approx(np.mean([0.25, 0.75, 4 / 4004]))
    assert found.loc[RATIO, "share"] == pytest.approx(np.mean([0.75, 0.25, 0.0]))
    assert found.loc[RATIO, "most"] == 1
    assert found["most"].tolist() == [1, 0, 2, 0, 0, 0, 1]
    assert ((found["low"] >= 0.0) & (found["low"] <= found["share"]) & (found["high"] <= 1.0)).all()


def test_the_command_tells_runs_and_groups(coevo, small_run, small_settings, begun, tmp_path):
    """The second run is of another seed, and stopped after its first generation."""
    out = tmp_path / "settled.csv"
    other = begun(create_run(tmp_path / "other", small_settings("seed=5")))
    said = coevo("settlements", small_run.path, other.path, "--games", 20, "--json", "--out", out)
    assert f"{other.path} is not finished: its last champions are those of generation 1 of 3" in said.err
    data = json.loads(said.out)
    assert said.code == 0
    assert [row["pattern"] for row in data["groups"][0]["patterns"]] == [*PATTERNS, RATIO]
    assert len(pd.read_csv(out)) == len(data["runs"]) == 2
    text = coevo("settlements", small_run.path, "--games", 20, "--quiet")
    assert text.out.startswith("smoke: how games between the last champions end")
    assert text.err == ""


def test_a_copy_is_not_another_run(coevo, small_run, copied_run):
    said = coevo("settlements", small_run.path, copied_run)
    assert (said.code, said.out) == (2, "")
    assert f"{copied_run} and {small_run.path} have the same settings and seed" in said.err


def test_a_game_that_does_not_count_what_is_needed_is_told(coevo, ladder_run):
    said = coevo("settlements", ladder_run.path)
    assert (said.code, said.out) == (2, "")
    assert "patterns are told by kicks, passes, own_goals, but this game counts points" in said.err
