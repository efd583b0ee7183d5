"""What a placement leaves to evolve, against single games and sums by hand."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import stats

from analysis.calibration.placement import hand_typed_table, placement, random_goals
from coevo.config import RunSettings
from coevo.errors import InputError
from coevo.evolution import random_teams
from coevo.game import SoccerGame, programs_of
from coevo.recipes import read_settings
from coevo.seeds import RunStream, game_seeds
from coevo.tree import parse

GAMES, SEED = 40, 5
SHORTER = "game.time_limit_steps=300"


def single_games(game, trees, games=GAMES):
    """Return what happened in each game, played by itself: by name (games, robots), and who won."""
    programs = programs_of(game, trees)
    played = [game.play(programs, np.array([seed])) for seed in game_seeds(SEED, RunStream.UNSEEN, count=games)]
    counts = {name: np.concatenate([one.counts[name] for one in played]) for name in game.counts}
    return counts, np.concatenate([one.winner for one in played])


@pytest.mark.parametrize(
    ("preset", "team", "typed"),
    [
        (
            "chapter6/dissertation-two-learners",
            "r0 searches, then passes, r1 shoots",
            ("IF_ball_is_lost(search, pass)", "shoot"),
        ),
        ("chapter6/dissertation-stationary-opponent", "r0 shoots", ("shoot", "search")),
        ("chapter6/dissertation-three-learners", "both shoot", ("shoot", "shoot")),
    ],
)
def test_a_row_is_the_sum_of_single_games(preset, team, typed):
    game = SoccerGame(read_settings(RunSettings, preset))
    table = hand_typed_table(game, games=GAMES, seed=SEED)
    assert len(table) == len(table.drop_duplicates(["team", "opponent"]))
    assert len(table) == (16 if preset == "chapter6/dissertation-three-learners" else 8)
    rows = table[table["team"] == team].to_dict("records")
    assert [row["opponent"] for row in rows] == (
        ["search", "IF_ball_is_lost(search, shoot)"] if preset == "chapter6/dissertation-three-learners" else [None]
    )
    for row in rows:
        others = {"chapter6/dissertation-two-learners": []}.get(
            preset, [None if row["opponent"] is None else parse(row["opponent"])]
        )
        counts, winner = single_games(game, [*map(parse, typed), *others])
        won = (winner == 0).astype(float)
        half = stats.t.ppf(0.975, GAMES - 1) * won.std(ddof=1) / math.sqrt(GAMES)
        expected = {
            "goals": 20 * won.mean(),
            "low": max(0.0, 20 * (won.mean() - half)),
            "high": min(20.0, 20 * (won.mean() + half)),
            "lost": 20 * (winner == 1).mean(),
            "steps": counts["steps"][:, 0].mean(),
            "passes": 20 * counts["passes"][:, 0].mean(),
            "kicks_r0": 20 * counts["kicks"][:, 0].mean(),
            "kicks_r1": 20 * counts["kicks"][:, 1].mean(),
            "collisions": 20 * max(counts["collisions"].mean(axis=0)),
        }
        assert {name: row[name] for name in expected} == pytest.approx(expected)
    assert table["goals"].max() > 0.0
    assert table["lost"].max() > 0.0


def test_random_teams_are_those_of_generation_0_and_their_goals_those_of_single_games():
    settings = read_settings(
        RunSettings, "chapter6/dissertation-three-learners", ["gp.creation_depth_max=3", "gp.population=6"]
    )
    game = SoccerGame(settings)
    found = random_goals(game, settings.gp, teams=6, seed=SEED)
    teams = random_teams(game, settings.gp, seed=SEED, teams=6)
    assert found.tolist() == [int((single_games(game, trees, 20)[1] == 0).sum()) for trees in teams]
    assert random_goals(game, settings.gp, teams=3, seed=SEED).tolist() == found[:3].tolist()
    assert len(random_goals(game, settings.gp, teams=60, seed=SEED)) == 6  # a population has no more


def test_the_command_tells_what_the_tables_hold():
    words = [
        "chapter6/dissertation-two-learners",
        "--games",
        "20",
        "--random-teams",
        "5",
        "--seed",
        str(SEED),
        "--set",
        SHORTER,
    ]
    settings = read_settings(RunSettings, "chapter6/dissertation-two-learners", [SHORTER])
    game = SoccerGame(settings)
    table, found = hand_typed_table(game, games=20, seed=SEED), random_goals(game, settings.gp, teams=5, seed=SEED)
    told = json.loads(CliRunner().invoke(placement, [*words, "--json"], catch_exceptions=False).stdout)
    assert [row["goals"] for row in told["teams"]] == table[["goals", "low", "high"]].to_numpy().tolist()
    assert [row["lost"] for row in told["teams"]] == table["lost"].tolist()
    assert told["random_teams"] == found.tolist()
    lines = CliRunner().invoke(placement, words, catch_exceptions=False).stdout.splitlines()
    assert lines[2].startswith("r0 shoots")
    assert lines[2].split()[2] == f"{table['goals'][0]:.1f}"
    mean, spread = np.mean(found), math.sqrt(np.mean((found - np.mean(found)) ** 2))
    assert lines[-1] == (
        f"random trees (5 teams, 20 games each): mean {mean:.1f}, standard deviation {spread:.1f}, best {max(found)},"
        f" none in {100 * sum(found == 0) / 5:.0f}%"
    )


def test_a_setting_without_two_team_mates_is_refused(tmp_path):
    text = """
kind = "evolution"
[[players]]
team = 0
start = { x_m = [1.0, 2.0], y_m = [1.0, 2.0] }
[game]
ball_start = { x_m = [3.0, 4.0], y_m = [1.0, 2.0] }
"""
    (tmp_path / "one.toml").write_text(text, encoding="utf-8")
    refused = CliRunner().invoke(placement, [str(tmp_path / "one.toml")])
    assert isinstance(refused.exception, InputError)
    assert "they must be in one team, and both evolve" in str(refused.exception)
