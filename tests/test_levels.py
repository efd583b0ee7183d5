"""An environment that co-evolves: its level follows from the games, which are played on it, once and again."""

from __future__ import annotations

import json
import sys

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.levels import level_chart, level_table, level_words
from coevo.cli import main
from coevo.config import check_experiment, read_toml, to_toml
from coevo.errors import InputError
from coevo.evolution import evolve
from coevo.evolution.evaluation import Evaluator
from coevo.game import Played, SoccerGame, make_game, programs_of
from coevo.levels import Levels, check_levels
from coevo.run import create_run, open_run
from coevo.usage import group_trees, play_seeds, seeds_of_group, tree_usage

STRENGTHS = [0.2, 0.6, 1.0]
KEYS = f'levels.keys=[{{"players.2.strength" = {STRENGTHS}, "world.ball.mass_kg" = [0.5, 0.4, 0.37]}}]'
# The level goes up where robots meet the ball in most games, and down where they do in few: both happens.
MOVING = (
    KEYS,
    "levels.window=1",
    "levels.raise_when={with_kicks = {at_least = 0.5}}",
    "levels.lower_when={with_kicks = {at_most = 0.49}}",
    "gp.generations=6",
    "evaluation.games=3",
)
BOTH = (KEYS, 'levels.keep="both sides winning"')


@pytest.fixture(scope="module")
def moving(small_settings):
    return small_settings(*MOVING)


@pytest.fixture(scope="module")
def moved(moving, go_on, tmp_path_factory):
    """Return a finished run whose level moved: only to be read."""
    return go_on(create_run(tmp_path_factory.mktemp("moved") / "run", moving))


def files_of(run, results_of):
    return {**results_of(run.path), "levels.csv": (run.path / "levels.csv").read_bytes()}


def table_of(run):
    return pd.read_csv(run.path / "levels.csv")


# ---------------------------------------------------------------------------------------------- what the level follows


def test_the_level_is_that_of_the_rule_and_of_what_individuals_counted(moved):
    individuals, table = moved.individuals, table_of(moved)
    level, expected = 0, []
    for generation in range(6):
        expected.append(level)
        seen = replayed(moved, generation, strength=STRENGTHS[level], mass=[0.5, 0.4, 0.37][level])
        rows = individuals[individuals["generation"] == generation]
        assert seen["kicks"].sum() == rows["kicks"].sum()  # so these are the games that were played
        share = (seen["kicks"] > 0).any(axis=1).mean()
        level = min(level + 1, 2) if share >= 0.5 else max(level - 1, 0)
    assert len(set(expected)) > 1
    assert [*expected, expected[-1]] == table["level"].tolist()
    assert table["event"].tolist()[0] == "start"
    assert table["event"].tolist()[-1] == "end"
    words = {1: "raised", 0: "stayed", -1: "lowered"}
    assert table["event"].tolist()[1:-1] == [words[step] for step in np.diff(expected).tolist()]
    assert table["players.2.strength"].tolist() == [STRENGTHS[one] for one in table["level"]]


def replayed(run, generation, *, strength, mass):
    """Return the counts (games, robots) of a generation's games, by a game that was made by hand."""
    data = read_toml(run.path / "config.toml")
    data["players"][2]["strength"], data["world"]["ball"]["mass_kg"] = strength, mass
    del data["levels"]
    game = make_game(check_experiment(data, "by hand"))
    assert isinstance(game, SoccerGame)
    played = [
        game.play(programs_of(game, group_trees(run, generation, group)), seeds_of_group(run, generation, group))
        for group in range(run.config.gp.population)
    ]
    return {name: np.concatenate([one.counts[name] for one in played]) for name in game.counts}


outcomes = st.lists(st.lists(st.sampled_from([-1, 0, 0, 1, 1]), min_size=1, max_size=6), min_size=1, max_size=25)


@settings(max_examples=50)
@given(generations=outcomes, window=st.integers(1, 3), against=st.integers(0, 1))
def test_the_level_moves_against_the_side_that_wins_too_much(generations, window, against, small_settings):
    experiment = small_settings(*BOTH, f"levels.window={window}", f"levels.against={against}")
    game = make_game(experiment)
    levels, level, since = Levels(experiment, game, []), 0, 0
    for now, winners in enumerate(generations, 1):
        counts = {name: np.zeros((len(winners), 3), np.int64) for name in game.counts}
        record = levels.observe([Played(counts, np.array(winners), [])])
        assert record.level == level
        decided = [team for seen in generations[max(since, now - window) : now] for team in seen if team >= 0]
        if now - since >= window and decided:
            lost_by_the_other = 10 * decided.count(1 - against) > 7 * len(decided)
            up, down = not lost_by_the_other and level < 2, lost_by_the_other and level > 0
            level += int(up) - int(down)
            since = now if up or down else since
        assert levels.level == level
        assert levels.settings.players[2].strength == STRENGTHS[level]


def test_what_was_kept_of_the_past_brings_it_back_to_where_it_stood(moving, moved):
    game = make_game(moving)
    records = moved.level_records(6)
    for done in range(7):
        again = Levels(moving, game, records[:done])
        if done < 6:
            assert (again.level, records[done].level) == (records[done].level, again.level)


def test_games_against_guests_of_the_past_do_not_count(small_settings, go_on, tmp_path):
    changes = ('evaluation.grouping="hall-of-fame"', "evaluation.partners=4", "evaluation.games=4")
    run = go_on(create_run(tmp_path / "run", small_settings(*MOVING, *changes, "gp.generations=3")))
    # Four rounds with a game each; later than generation 0, two of them are against champions of the past.
    games = [record.counted["decided"][1] for record in run.level_records(3)]
    assert games == [4 * 6, 2 * 6, 2 * 6]


# ----------------------------------------------------------------------------------------------------------- same bytes


@pytest.mark.parametrize(("workers", "backend"), [(2, "threads"), pytest.param(2, "processes", marks=pytest.mark.slow)])
def test_workers_change_nothing(workers, backend, moving, moved, go_on, results_of, tmp_path):
    again = go_on(create_run(tmp_path / "run", moving), workers=workers, backend=backend)
    assert files_of(again, results_of) == files_of(moved, results_of)


class StopError(Exception):
    pass


@pytest.mark.parametrize("lost", ["nothing", "checkpoint.npz", "levels.csv", "the last part"])
def test_a_run_that_was_stopped_goes_on_to_the_same_bytes(lost, moving, moved, go_on, results_of, tmp_path):
    run = create_run(tmp_path / "run", moving)

    def stop(of):
        if of.generation == 3:
            raise StopError

    with Evaluator(run.config, workers=1, backend="threads") as evaluator, pytest.raises(StopError):
        evolve(run, evaluator, stop)
    if lost == "the last part":  # as if it had been stopped between the tables and the part
        (run.path / "individuals.parquet" / "part-00003.parquet").unlink()
        (run.path / "checkpoint.npz").unlink()
    elif lost != "nothing":
        (run.path / lost).unlink()
    assert files_of(go_on(open_run(run.path)), results_of) == files_of(moved, results_of)


def test_a_run_without_levels_tells_of_none(small_run):
    assert not (small_run.path / "levels.csv").exists()
    assert small_run.level_records(3) == []
    assert small_run.game_of(1) is small_run.game
    assert "levels" not in to_toml(small_run.config)


# -------------------------------------------------------------------------------------------------------------- replays


def test_a_tree_is_followed_on_the_level_that_it_was_scored_on(moved):
    for generation in range(6):
        for robot in ("r0", "r2"):
            row = moved.record(generation, robot).iloc[0]
            usage = tree_usage(moved, generation, robot, int(row["index"]))
            assert usage.steps == row["steps"]
            chosen = {name: row[f"chose_{name}"] / row["steps"] for name in usage.skill_use}
            assert usage.skill_use == pytest.approx(chosen)


def test_play_repeats_a_group_on_its_level_and_plays_new_games_by_the_recipe(moved, monkeypatch, capsys):
    def play(*words):
        monkeypatch.setattr(sys, "argv", ["coevo", "play", str(moved.path), "--json", *words])
        main()
        return json.loads(capsys.readouterr().out)

    table = table_of(moved)
    generation = int(table.index[table["level"] < 2][-1] if (table["level"] < 2).any() else 0)
    generation = min(generation, 5)
    rows = moved.individuals.query(f"generation == {generation} and group == 0").set_index("robot")
    told = play("--generation", str(generation), "--group", "0")
    assert told["kicks"] == rows["kicks"].to_dict()
    assert told["steps"] == rows["steps"].iloc[0]
    new = play("--generation", str(generation), "--games", "3", "--seed", "5")
    game = make_game(moved.config)
    names = [moved.evolving[role] for role in range(3)]
    trees = [moved.champion_tree(name, generation) for name in names]
    played = game.play(programs_of(game, trees), play_seeds(5, 3))
    assert list(new["kicks"].values()) == played.counts["kicks"].sum(axis=0).tolist()


def test_a_page_says_how_far_the_levels_came(moved):
    table, whole = level_table(moved), table_of(moved)
    assert len(table) == len(whole) - 1 == 6
    raised, lowered = ((whole["event"] == word).sum() for word in ("raised", "lowered"))
    words = level_words(moved, table)
    assert f"ended at {whole['level'].iloc[-1]} of 0 to 2 (players.2.strength = " in words
    assert f"raised {raised} times and lowered {lowered} times" in words
    assert level_chart(table).to_dict()["vconcat"]


# -------------------------------------------------------------------------------------------------------------- refused


@pytest.mark.parametrize(
    ("assignments", "says"),
    [
        (['levels.keys=[{"players.2.strenth" = [0.2, 1.0]}]'], "unknown setting 'players.2.strenth'. Did you mean"),
        (['levels.keys=[{"players.3.strength" = [0.2, 1.0]}]'], "expected an index from 0 to 2, got '3'"),
        (['levels.keys=[{"players.2.strength" = [0.2, 1.5]}]'], "level 1 of levels.keys"),
        (['levels.keys=[{"gp.population" = [10, 20]}]'], "got 'gp.population'"),
        (['levels.keys=[{"players.2.control" = ["stationary", "evolve"]}]'], "changes who plays"),
        (['levels.keys=[{"world.ball.radius_m" = [0.1025, 0.2]}]'], "was learned for a world with ball.radius_m"),
        (["levels.against=2"], "needs two teams that evolve"),
        (["levels.raise_when={won_2 = {at_least = 0.5}}"], "nobody measures a rate 'won_2'. Did you mean"),
        (["levels.raise_when={won_0 = {at_least = 0.8}}"], "at_least 0.8 can never be met while no team wins more"),
        (
            ["levels.raise_when={decided = {at_least = 0.6}, undecided = {at_least = 0.6}}"],
            "decided and undecided are 1 together",
        ),
    ],
)
def test_levels_that_cannot_be_played_are_refused(assignments, says, small_settings):
    with pytest.raises(InputError) as caught:
        check_levels(small_settings(*BOTH, *assignments))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_evolve_refuses_levels_before_there_is_a_folder(small_settings, tmp_path, monkeypatch, capsys):
    recipe = tmp_path / "mine.toml"
    text = to_toml(small_settings(*BOTH)).replace('"players.2.strength"', '"players.2.strenth"')
    recipe.write_text(text, encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["coevo", "evolve", str(recipe), "--out", str(tmp_path / "run")])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    assert "Did you mean 'strength'?" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_starts_of_a_level_that_do_not_fit_are_found_before_any_game(small_settings, go_on, tmp_path):
    start = "{ x_m = [3.0, 3.0], y_m = [1.0, 1.0], facing = 'ball', spread_deg = 0.0 }"
    far = start.replace("3.0", "5.0")
    keys = f'levels.keys=[{{"players.0.start" = [{far}, {start}], "players.1.start" = [{start}, {start}]}}]'
    run = create_run(tmp_path / "run", small_settings(*BOTH, keys))
    with pytest.raises(InputError, match="do not fit"):
        go_on(run)
    assert run.finished == 0
