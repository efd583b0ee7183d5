"""Whether a preset is worth evolving in: the measures by single games, the command, and the shipped presets."""

from __future__ import annotations

import json

import numpy as np
import pytest

from analysis.baselines import gain, in_text
from analysis.baselines.search import Measured
from analysis.calibration.presets import PRESETS, WANTED, kept_teams, properties
from analysis.calibration.presets_search import Budget, search_preset, team_of
from coevo.evolution.evaluation import Evaluator
from coevo.game import make_game, programs_of
from coevo.recipes import read_experiment
from coevo.seeds import RunStream, game_seeds

SH = "IF_ball_is_lost(search, shoot)"
FOUND = {
    "rounds": [
        {"team": 0, "before": {"r0": "search", "r1": "search"}, "after": {"r0": SH, "r1": SH}, "met": {"r2": "search"}},
        {"team": 1, "before": {"r2": "search"}, "after": {"r2": SH}, "met": {"r0": SH, "r1": SH}},
    ],
    "sides": [
        {
            "team": 0,
            "met": [{"r2": SH}, {"r2": "search"}],
            "single": {"r0": "search", "r1": "search"},
            "small": {"r0": SH, "r1": SH},
            "passing": {"r0": "pass", "r1": SH},
            "silent": {"r0": "avoid", "r1": SH},
        },
        {"team": 1, "met": [{"r0": SH, "r1": SH}], "single": {"r2": "avoid"}, "small": {"r2": SH}},
    ],
}


@pytest.fixture(scope="module")
def settings(small_settings):
    """Return a game in which r0 shoots from near, and r2 is far away."""
    return small_settings(
        "game.time_limit_steps=150",
        "game.ball_start={x_m=[6.6,7.0],y_m=[2.0,2.6]}",
        "players.0.start={x_m=[5.7,6.1],y_m=[2.0,2.6],facing='ball'}",
        "players.2.start={x_m=[1.0,1.5],y_m=[2.0,2.6],facing='ball'}",
    )


@pytest.fixture(scope="module")
def measured(settings):
    with Evaluator(settings, workers=2, backend="threads") as evaluator:
        found = properties(make_game(settings), evaluator, FOUND, games=60, seed=3, recipe="mine")
    return found.set_index(["property", "side"])


def single_games(settings, team, own, met, number):
    """Return the games of a team one by one, against its opponents in turn."""
    game = make_game(settings)
    winners = []
    for k, seed in enumerate(game_seeds(3, RunStream.ANSWERED, number, count=60)):
        trees = team_of(game, {**own, **met[k % len(met)]})
        programs = programs_of(game, [trees[role] for role in range(3)])
        winners.append(int(game.play(programs, np.array([seed])).winner[0]))
    winner = np.array(winners)
    none = np.zeros(60, np.int64)
    return Measured(winner == team, (winner >= 0) & (winner != team), none, none)


def test_differences_are_those_of_the_same_single_games(measured, settings):
    for team, robots in ((0, "r0, r1"), (1, "r2")):
        side = FOUND["sides"][team]
        small, single = (
            single_games(settings, team, side[which], side["met"], 2000 + team) for which in ("small", "single")
        )
        row = measured.loc["small trees over single skills", robots]
        assert (row["value"], row["low"], row["high"]) == gain(small, single)
    side = FOUND["sides"][0]
    passing, silent = (single_games(settings, 0, side[which], side["met"], 2100) for which in ("passing", "silent"))
    row = measured.loc["passing over not passing", "r0, r1"]
    assert (row["value"], row["low"], row["high"]) == gain(passing, silent)
    assert ("passing over not passing", "r2") not in measured.index


def test_decided_games_are_those_of_what_stood_after_each_round(measured, settings):
    games, moved = [], 0
    for number, one in enumerate(FOUND["rounds"]):
        before, after = (
            single_games(settings, one["team"], one[which], [one["met"]], 2200 + number)
            for which in ("before", "after")
        )
        better = gain(after, before)[1] > 0.0
        moved += better
        games.append(after if better else before)
    won = games[0].won.sum() + games[1].lost.sum()
    lost = games[0].lost.sum() + games[1].won.sum()
    assert measured.loc[("rounds that moved", ""), "value"] == moved == 1
    assert measured.loc[("share of decided games", "r0, r1"), "value"] == won / (won + lost)
    assert measured.loc[("time-outs", ""), "value"] == (120 - won - lost) / 120


def test_what_holds_lies_within_what_is_wanted(measured):
    assert {name for name, _ in measured.index} == set(WANTED)
    for (name, _), row in measured.iterrows():
        least, most = WANTED[name]
        assert row["holds"] == (least <= row["value"] <= most)


@pytest.fixture
def small_search():
    """Return the settings of a game of few small trees."""
    changes = ["skills.avoid=", "skills.search=", "game.time_limit_steps=60"]
    return read_experiment("smoke", changes)


@pytest.mark.slow
def test_a_search_finds_teams_that_can_be_measured_and_are_what_they_are_called(small_search):
    game, budget = make_game(small_search), Budget(search_games=100, fresh_games=10, rounds=2)
    with Evaluator(small_search, workers=2, backend="threads") as evaluator:
        found = search_preset(game, evaluator, budget)
        assert found == search_preset(game, evaluator, budget)
        properties(game, evaluator, found, games=10, seed=1)
    assert [one["team"] for one in found["rounds"]] == [0, 1]
    assert [one["team"] for one in found["sides"]] == [0, 1]
    first, second = found["sides"]
    assert any("pass" in text for text in first["passing"].values())
    assert not any("pass" in text for text in first["silent"].values())
    assert {"passing", "silent"}.isdisjoint(second)
    for side, own, others in ((first, ["r0", "r1"], ["r2"]), (second, ["r2"], ["r0", "r1"])):
        assert list(side["small"]) == list(side["single"]) == own
        assert all(list(one) == others for one in side["met"])
        assert set(side["single"].values()) <= {"shoot", "pass"}
        assert in_text(game, team_of(game, side["small"])) == side["small"]


def test_the_command_writes_teams_that_are_measured_again(coevo, tmp_path):
    teams = tmp_path / "teams.toml"
    small = ["smoke", "--games", 10, "--set", "skills.avoid=", "--set", "skills.search=", "--json"]
    small += ["--set", "game.time_limit_steps=60"]
    first = coevo("reproduce", "presets", *small, "--search-games", 100, "--rounds", 1, "--depth", 1, "--teams", teams)
    assert first.code == 0
    again = coevo("reproduce", "presets", *small, "--again", teams, "--quiet")
    assert again.err == ""
    assert json.loads(again.out)["properties"] == json.loads(first.out)["properties"]
    text = coevo("reproduce", "presets", *small[:-3], *small[-2:], "--again", teams, "--quiet")
    assert "small trees over single skills (r0, r1)" in text.out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["shmoke"], "there is no recipe 'shmoke'. Did you mean 'smoke'"),
        (["smoke", "--passing", "shout"], "smoke has no such terminal; it has avoid, pass, search, shoot"),
        (["smoke", "--again", "absent.toml"], "cannot read absent.toml"),
        (["smoke", "--again", "EMPTY"], "has no teams of smoke; it has those of none"),
        (["smoke", "--again", "WRONG"], "expected what 'coevo reproduce presets --teams' writes"),
        (["smoke", "--again", "SHOUT"], "unknown name 'shout'"),
        (["smoke", "--again", "NO_ROUND"], "expected what 'coevo reproduce presets --teams' writes"),
        (["smoke", "--again", "NO_TEAM"], "expected what 'coevo reproduce presets --teams' writes (KeyError('team'))"),
        (["smoke", "--again", "TEAM_3"], "(IndexError('no team 3 that evolves'))"),
    ],
)
def test_wrong_input_is_told(arguments, message, coevo, tmp_path):
    files = {
        "EMPTY": "",
        "WRONG": "[smoke]\nrounds = [3]",
        "SHOUT": '[smoke]\nrounds = [{ team = 1, before = { r2 = "shout" }, after = {}, met = {} }]\nsides = []',
        "NO_ROUND": "[smoke]\nrounds = []\nsides = []",
        "NO_TEAM": "[smoke]\nrounds = []\nsides = [{ single = {}, small = {}, met = [] }]",
        "TEAM_3": "[smoke]\nrounds = [{ team = 3, before = {}, after = {}, met = {} }]\nsides = []",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    said = coevo("reproduce", "presets", *(tmp_path / word if word in files else word for word in arguments))
    assert (said.code, said.out) == (2, "")
    assert message in said.err
    assert "Traceback" not in said.err


# presets.toml holds what 'coevo reproduce presets --teams' found: some games of these teams show it again.
# What is wanted and is not so: docs/decisions/0015-presets.md.
MISSED = {
    ("two-learners", "passing over not passing"),
    ("two-learners", "rounds that moved"),
    ("stationary-opponent", "rounds that moved"),
    ("three-learners", "passing over not passing"),
    ("three-learners", "rounds that moved"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
def test_a_shipped_preset_is_worth_evolving_in(name):
    settings = read_experiment(name)
    with Evaluator(settings, workers=2, backend="threads") as evaluator:
        found = properties(make_game(settings), evaluator, kept_teams()[name], games=600, seed=11)
    for row in found.to_dict("records"):
        least, most = WANTED[row["property"]]
        if (name, row["property"]) in MISSED:
            assert not row["holds"], row
            continue
        # A round that moved little may not show it in so few games.
        low, high = (row["value"], row["value"] + 1) if np.isnan(row["low"]) else (row["low"], row["high"])
        assert high >= least, row
        assert low <= most, row
