"""First and last generation in unseen games: against single games, sums by hand and Student's formula."""

from __future__ import annotations

import json
import math
import shutil

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from scipy import stats

from analysis.unseen import gain_intervals, gains_table, unseen, unseen_table
from coevo.config import RunSettings, check, override
from coevo.errors import InputError
from coevo.game import SoccerGame, programs_of
from coevo.run import create_run, open_run
from coevo.seeds import RunStream, game_seeds

GAMES, SEED = 60, 3
SMALL = (
    "gp.population=12",
    "gp.generations=2",
    "gp.tournament=3",
    "gp.creation_depth_max=3",
    "evaluation.games=3",
    "game.time_limit_steps=400",
)


@pytest.fixture(scope="module")
def evolved(recipe, go_on, tmp_path_factory):
    """Return a function that evolves a small run of games long enough for goals."""

    def run_of(preset, *assignments, standing=0):
        plain = override(recipe(preset), [*SMALL, *assignments])
        for player in plain["players"][:standing]:
            player["control"] = "stationary"
        settings = check(RunSettings, plain, preset)
        return go_on(create_run(tmp_path_factory.mktemp("unseen") / "run", settings))

    return run_of


@pytest.fixture(scope="module")
def alone(evolved):
    """Return two runs of one team."""
    return [evolved("chapter6/dissertation-two-learners", f"seed={seed}") for seed in (1, 2)]


@pytest.fixture(scope="module")
def against(evolved):
    """Return two runs of two teams."""
    return [evolved("chapter6/dissertation-three-learners", f"seed={seed}", "gp.generations=3") for seed in (1, 2)]


def single_games(run, generations):
    """Return each game between the best trees of a generation for each robot: who won, passes of all, steps."""
    game = SoccerGame(run.config)
    trees = [run.champion_tree(f"r{robot}", generation) for robot, generation in enumerate(generations)]
    played = []
    for seed in game_seeds(SEED, RunStream.UNSEEN, count=GAMES):
        one = game.play(programs_of(game, trees), np.array([seed]))
        played.append((int(one.winner[0]), int(one.counts["passes"].sum()), int(one.counts["steps"][0, 0])))
    return np.array(played)


def check_row(row, played):
    winner, passes, steps = played.T
    won = (winner == 0).astype(float)
    assert row["goals"] == won.mean()
    assert row["lost"] == (winner == 1).mean()
    assert row["passes"] == passes.mean()
    assert row["steps"] == steps.mean()
    half = stats.t.ppf(0.975, GAMES - 1) * won.std(ddof=1) / math.sqrt(GAMES)
    assert (row["low"], row["high"]) == pytest.approx((max(0.0, won.mean() - half), min(1.0, won.mean() + half)))


def test_of_one_team_the_first_and_the_last_play_the_same_games(alone):
    table = unseen_table(alone, games=GAMES, seed=SEED)
    assert table["run"].tolist() == [str(run.path) for run in alone for _ in range(2)]
    assert table["who"].tolist() == ["generation 0", "generation 1"] * 2
    for k, row in enumerate(table.to_dict("records")):
        generation = k % 2
        assert (row["first_side"], row["second_side"], row["first_robots"]) == (generation, -1, "r0, r1")
        check_row(row, single_games(alone[k // 2], [generation, generation]))
    assert table["goals"].max() > 0.0


def test_two_teams_also_meet_each_others_opponents(against):
    run = against[0]
    table, last = unseen_table([run], games=GAMES, seed=SEED), run.finished - 1
    pairs = {
        "generation 0": (0, 0),
        f"generation {last}": (last, last),
        "last r0, r1 / first r2": (last, 0),
        "first r0, r1 / last r2": (0, last),
    }
    assert table["who"].tolist() == list(pairs)
    for row, (ours, theirs) in zip(table.to_dict("records"), pairs.values(), strict=True):
        assert (row["first_side"], row["second_side"]) == (ours, theirs)
        assert (row["first_robots"], row["second_robots"]) == ("r0, r1", "r2")
        check_row(row, single_games(run, [ours, ours, theirs]))
    assert table["goals"].max() > 0.0
    assert table["lost"].max() > 0.0


def test_games_are_seen_from_the_team_that_evolves(evolved):
    run = evolved("chapter6/dissertation-three-learners", standing=2)
    table = unseen_table([run], games=200, seed=SEED)
    game, seeds = SoccerGame(run.config), game_seeds(SEED, RunStream.UNSEEN, count=200)
    played = [game.play(programs_of(game, [None, None, run.champion_tree("r2", k)]), seeds) for k in (0, 1)]
    assert table["first_robots"].tolist() == ["r2", "r2"]
    assert table["goals"].tolist() == [(one.winner == 1).mean() for one in played]
    assert table["lost"].tolist() == [(one.winner == 0).mean() for one in played]
    assert max(abs(table["goals"] - table["lost"])) > 0.0


BY_HAND = pd.DataFrame(
    [
        # run, who, goals, lost: 0.1 behind, then 0.3 ahead
        ("a", "generation 0", 0.2, 0.3, "r0, r1", ""),
        ("a", "generation 9", 0.5, 0.2, "r0, r1", ""),
        ("b", "generation 0", 0.1, 0.4, "r0, r1", "r2"),
        ("b", "generation 9", 0.3, 0.3, "r0, r1", "r2"),
        ("b", "last / first", 0.6, 0.1, "r0, r1", "r2"),
        ("b", "first / last", 0.0, 0.7, "r0, r1", "r2"),
    ],
    columns=["run", "who", "goals", "lost", "first_robots", "second_robots"],
)


def test_gains_are_differences_of_goals_less_lost_goals():
    gains = gains_table(BY_HAND)
    assert gains["run"].tolist() == ["a", "b", "b", "b"]
    assert gains["gain"].tolist() == [
        "last against first generation",
        "last against first generation",
        "r0, r1: last against first, same first r2",
        "r2: last against first, same first r0, r1",
    ]
    # b: 0.0 - -0.3; 0.5 - -0.3 for r0 and r1; r2 is better by what they are worse: -0.3 - -0.7
    assert gains["value"].tolist() == pytest.approx([0.4, 0.3, 0.8, 0.4])


def test_an_interval_over_two_runs_is_students_in_closed_form():
    intervals = gain_intervals(gains_table(BY_HAND)).set_index("gain")
    both = intervals.loc["last against first generation"]
    # Half the difference times tan(0.475 pi), the quantile of t with one degree of freedom.
    half = 0.05 * math.tan(0.475 * math.pi)
    assert (both["mean"], both["low"], both["high"]) == pytest.approx((0.35, 0.35 - half, 0.35 + half))
    assert intervals["runs"].tolist() == [2, 1, 1]


def test_the_command_tells_what_the_tables_hold(against):
    folders = [str(run.path) for run in against]
    words = [*folders, folders[0], "--games", str(GAMES), "--seed", str(SEED)]
    said = CliRunner().invoke(unseen, [*words, "--json"], catch_exceptions=False)
    found = json.loads(said.stdout)
    table = unseen_table(against, games=GAMES, seed=SEED)  # a run that is named twice counts once
    assert [row["run"] for row in found["teams"]] == table["run"].tolist()
    assert [row["goals"] for row in found["teams"]] == table[["goals", "low", "high"]].to_numpy().tolist()
    assert [row["steps"] for row in found["teams"]] == table["steps"].tolist()
    values = gains_table(table).query("gain == 'last against first generation'")["value"]
    assert values.nunique() == 2
    low, high = stats.t.interval(0.95, 1, values.mean(), stats.sem(values))
    assert found["gains"]["last against first generation"] == pytest.approx([values.mean(), low, high])

    text = CliRunner().invoke(unseen, words, catch_exceptions=False).stdout.splitlines()
    assert text[1].split()[-4:] == [f"{table['high'][0]:.3f}]", *_told(table.iloc[0])]
    assert text[-1].endswith("over 2 runs")
    one = CliRunner().invoke(unseen, [folders[0], *words[3:]], catch_exceptions=False).stdout
    assert one.endswith(" in 1 run\n")  # one run has no interval over runs


def _told(row):
    return f"{row['lost']:.3f}", f"{row['passes']:.2f}", f"{row['steps']:.0f}"


def test_of_an_unfinished_run_the_last_finished_generation_plays(against, tmp_path):
    finished = against[0]
    shutil.copytree(finished.path, tmp_path / "run")
    (tmp_path / "run" / "checkpoint.npz").unlink()
    (tmp_path / "run" / "individuals.parquet" / f"part-{finished.finished - 1:05d}.parquet").unlink()
    rows = (tmp_path / "run" / "generations.csv").read_text().splitlines(keepends=True)
    (tmp_path / "run" / "generations.csv").write_text("".join(rows[: 1 + 3 * (finished.finished - 1)]))
    run = open_run(tmp_path / "run")
    assert run.finished == finished.finished - 1
    table = unseen_table([run], games=GAMES, seed=SEED)
    assert table["who"][1] == f"generation {run.finished - 1}"
    check_row(table.to_dict("records")[1], single_games(finished, [run.finished - 1] * 3))


FOREIGN = """
kind = "evolution"
name = "own"
[game]
kind = "own:make"
[fitness]
kind = "own:score"
"""


def test_what_has_no_generation_or_is_another_game_is_refused(small_settings, tmp_path):
    created = create_run(tmp_path / "run", small_settings())
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "config.toml").write_text(FOREIGN, encoding="utf-8")
    for path, said in (
        (created.path, "has no finished generation yet; go on with 'coevo resume"),
        (tmp_path / "foreign", "is about another game; this compares games of soccer"),
    ):
        refused = CliRunner().invoke(unseen, [str(path)])
        assert isinstance(refused.exception, InputError)
        assert said in str(refused.exception)
