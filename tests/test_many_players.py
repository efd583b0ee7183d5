"""Two against two, and up to three against three: every command that plays or reads runs takes them."""

from __future__ import annotations

import json
import sys

import pandas as pd
import pytest

from analysis.report import gather
from coevo.cli import main
from coevo.config import check_experiment
from coevo.recipes import read_recipe
from coevo.run import create_run

SMALL = {
    "gp": {"population": 4, "generations": 2, "tournament": 2, "creation_depth_max": 3},
    "evaluation": {"games": 2},
}


def settings_of(players):
    data = read_recipe("chapter6/equal-complexity", "evolution") | SMALL
    data["game"]["time_limit_steps"] = 120
    four = data["players"]
    if players == 6:
        goal = {"x_m": [0.5, 1.0], "y_m": [2.0, 2.5], "facing": "ball"}
        own = {"team": 0, "start": goal}
        other = {"team": 1, "start": goal | {"x_m": [7.22, 7.72], "y_m": [2.075, 2.575]}}
        data["players"] = [*four[:2], own, *four[2:], other]
    return check_experiment(data, "many")


@pytest.fixture(scope="module", params=[4, 6])
def run(request, go_on, tmp_path_factory):
    path = tmp_path_factory.mktemp("many") / "run"
    return go_on(create_run(path, settings_of(request.param)))


@pytest.fixture
def coevo(monkeypatch, capsys):
    def run(*words):
        monkeypatch.setattr(sys, "argv", ["coevo", *map(str, words)])
        main()
        return capsys.readouterr().out

    return run


def test_every_robot_evolves_and_is_in_the_tables(run):
    robots = [f"r{number}" for number in range(len(run.config.players))]
    assert list(run.evolving.values()) == robots
    assert len(run.individuals) == 2 * 4 * len(robots)
    assert pd.read_csv(run.path / "generations.csv")["robot"].tolist() == robots * 2
    # r0 can ask about ball and goals, and about all others: seven situations each.
    assert len(run.game.function_set(0).functions) == 7 * (3 + len(robots) - 1)


def test_they_are_inspected_and_play(run, coevo, tmp_path):
    last = f"r{len(run.config.players) - 1}"
    told = json.loads(coevo("inspect", run.path, "--robot", last, "--json"))
    assert told["robot"] == last
    assert sum(told["skill_use"].values()) == pytest.approx(1.0)
    page, trace = tmp_path / "game.html", tmp_path / "game.csv"
    said = json.loads(coevo("play", run.path, "--games", 2, "--json", "--video", page, "--trace", trace))
    assert len(said["kicks"]) == len(run.config.players)
    assert page.stat().st_size > 10_000
    bodies = set(pd.read_csv(trace)["body"])
    assert bodies == {"ball", *run.evolving.values()}


def test_they_play_tournaments(run, coevo):
    told = json.loads(coevo("tournament", run.path, "--games", 4, "--json"))
    assert [side["team"] for side in told["sides"]] == [0, 1]


@pytest.mark.slow
def test_a_page_reports_on_them(run, coevo, tmp_path, monkeypatch):
    if len(run.config.players) < 6:
        pytest.skip("a page about six has all that one about four has, and takes long")
    for number in ("_UNSEEN", "_GAMES", "_OUTSIDE", "_REPEATS"):  # of games: here they only have to be played
        monkeypatch.setattr(gather, number, 2)
    page = tmp_path / "report.html"
    coevo("report", run.path, "--out", page, "--quiet")
    text = page.read_text(encoding="utf-8")
    assert all(robot in text for robot in run.evolving.values())
