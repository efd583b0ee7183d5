"""coevo play: games, traces and replays."""

from __future__ import annotations

import weakref

import pandas as pd

from coevo.evolution.evaluation import group_seeds
from coevo.game import Arena
from coevo.replay import trace_digest
from coevo.usage import play_seeds


def test_play_tells_what_happened_in_games_of_the_best(coevo, small_run, one_object, best_programs):
    data = one_object(coevo("play", small_run.path, "--games", "5", "--seed", "7", "--json"))
    arena, programs = Arena(small_run.config), best_programs(small_run, 2)
    played = [arena.trace(programs, seed) for seed in play_seeds(7, 5)]
    scorers = [int(outcome.scorer[0]) for outcome, _ in played]
    teams = [player.team for player in small_run.config.players]
    assert data["games"] == 5
    assert data["goals"] == {f"r{i}": scorers.count(teams[i]) for i in range(3)}
    assert data["lost"] == {f"r{i}": scorers.count(1 - teams[i]) for i in range(3)}
    for name in ("kicks", "collisions"):
        assert data[name] == {f"r{i}": sum(int(getattr(one, name)[0, i]) for one, _ in played) for i in range(3)}
    assert data["steps"] == sum(int(outcome.steps[0]) for outcome, _ in played)
    assert data["digest"] == trace_digest([trace for _, trace in played])


def test_the_digest_is_that_of_the_games_and_of_nothing_else(coevo, small_run, one_object):
    def digest(*arguments):
        return one_object(coevo("play", small_run.path, "--json", "--games", "3", *arguments))["digest"]

    assert digest() == digest("--generation", "2") == digest("--seed", "1")
    assert len({digest(), digest("--seed", "2"), digest("--games", "4")}) == 3


def test_games_are_not_kept_when_nobody_looks_at_them(coevo, small_run, one_object, monkeypatch):
    trace, living, most = Arena.trace, [0], [0]

    def counted(arena, programs, seed):
        outcome, seen = trace(arena, programs, seed)
        living[0] += 1
        most[0] = max(most[0], living[0])
        weakref.finalize(seen.states, lambda: living.__setitem__(0, living[0] - 1))
        return outcome, seen

    monkeypatch.setattr(Arena, "trace", counted)
    assert one_object(coevo("play", small_run.path, "--json", "--games", "60"))["games"] == 60
    assert 1 <= most[0] <= 3


def test_games_of_play_are_never_those_of_evolution():
    evolution = {int(seed) for g in range(5) for group in range(20) for seed in group_seeds(1, g, group, 20)}
    assert evolution.isdisjoint(int(seed) for seed in play_seeds(1, 5000))


def test_a_trace_has_a_row_for_each_game_step_and_body(coevo, small_run, tmp_path, one_object):
    path = tmp_path / "games.csv"
    data = one_object(coevo("play", small_run.path, "--games", "3", "--trace", path, "--json"))
    table = pd.read_csv(path, keep_default_na=False)
    assert list(table) == ["game", "step", "body", "x_m", "y_m", "heading_rad", "skill"]
    assert set(table["game"]) == {0, 1, 2}
    assert len(table) == (data["steps"] + 3) * 4  # each game has its start, too
    assert table.groupby(["game", "step"])["body"].agg(sorted).map(tuple).unique().tolist() == [
        ("ball", "r0", "r1", "r2")
    ]
    robots = table[table.body != "ball"]
    assert set(table[table.body == "ball"]["skill"]) == {""}
    assert set(robots["skill"]) <= {"", "shoot", "pass", "avoid", "search"}
    last = table.groupby("game")["step"].transform("max")
    assert ((robots["skill"] == "") == (robots["step"] == last[robots.index])).all()
    start = table[table.step == 0].set_index(["game", "body"])
    for number, player in enumerate(small_run.config.players):
        places = start.xs(f"r{number}", level="body")
        assert places["x_m"].between(*player.start.x_m).all()
        assert places["y_m"].between(*player.start.y_m).all()


def test_a_replay_is_written(coevo, small_run, tmp_path):
    said = coevo("play", small_run.path, "--games", "1", "--video", tmp_path / "game.html")
    assert said.code == 0
    assert str(tmp_path / "game.html") in said.out
    assert "<html" in (tmp_path / "game.html").read_text(encoding="utf-8")
