"""Champions beside their baselines: the same fresh games for all, kept in the run folder."""

from __future__ import annotations

import json
import shutil

import msgspec
import numpy as np
import pandas as pd
import pytest

from analysis.baselines import (
    best_answer,
    compare,
    hand_typed_of,
    over_runs,
    read_hand_typed,
    shipped_hand_typed,
    table,
)
from analysis.baselines.compare import KINDS, equal_games
from analysis.commands.baselines import _several
from coevo.config import to_toml
from coevo.contest import champions, line_up, single_skills
from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator
from coevo.recipes import read_experiment
from coevo.run import create_run, open_run
from coevo.seeds import RunStream, game_seeds
from coevo.statistics import paired_difference

HAND = """
[[teams]]
name = "mine"
r0 = "search"
r1 = "IF_ball_is_lost(search, shoot)"

[[teams]]
name = "theirs"
r2 = "shoot"
"""
FEW = {"games": 30, "search_games": 300}


@pytest.fixture(scope="module")
def runs(small_settings, go_on, tmp_path_factory):
    """Return a run of two skills, with few small trees, one of random search, and one of other settings."""
    folder = tmp_path_factory.mktemp("baselines")
    (folder / "teams.toml").write_text(HAND, encoding="utf-8")
    two = ("skills.pass=", "skills.avoid=")
    return tuple(
        go_on(create_run(folder / name, small_settings(*two, setting)))
        for name, setting in (("run", "seed=0"), ("random", "gp.variation=random"), ("varying", "fitness.kind=varying"))
    )


@pytest.fixture(scope="module")
def found(runs):
    run, random, _ = runs
    hand = read_hand_typed(run.game, run.path.parent / "teams.toml")
    with Evaluator(run.config, workers=2, backend="threads") as evaluator:
        return table(run, evaluator, **FEW, hand=hand, beside=random)


def won(run, programs, opponents, team):
    """Return whether a team wins, game by game: starts are dealt to the opponents in turn."""
    seeds = game_seeds(run.config.seed, RunStream.ANSWERED, 0, count=30)
    return np.array(
        [
            run.game.play(line_up(run.game, programs, opponents[k % len(opponents)]), seeds[k : k + 1]).winner[0]
            == team
            for k in range(30)
        ]
    )


@pytest.mark.parametrize("team", [0, 1])
def test_shares_are_those_of_single_games_against_both_runs_champions(team, found, runs):
    run, *_ = runs
    last, drawn = (champions(one, one.finished - 1) for one in runs[:2])
    opponents = [last[1 - team], drawn[1 - team]]
    rows = found[found["team"] == team].set_index("kind")
    own = won(run, last[team], opponents, team)
    other = won(run, drawn[team], opponents, team)
    assert rows.loc["champions", "share"] == own.mean()
    assert rows.loc["random search", "share"] == other.mean()
    assert tuple(rows.loc["random search", ["over", "over_low", "over_high"]]) == paired_difference(own, other)
    assert np.isnan(rows.loc["champions", "over"])
    skills = dict(part.split(": ") for part in rows.loc["single skills", "trees"].split("; "))
    names = {run.number_of(robot): skill for robot, skill in skills.items()}
    best = next(part for named, part in single_skills(run.game, team) if named == names)
    assert rows.loc["single skills", "share"] == won(run, best, opponents, team).mean()


def test_a_run_of_other_settings_is_called_so_and_meets_the_same_opponents(coevo, runs, tmp_path):
    """The other run's row is its own champions' games, against both runs' opponents in turn."""
    run, _, varying = runs
    copied = shutil.copytree(run.path, tmp_path / "run", ignore=shutil.ignore_patterns("results"))
    few = ("--games", 30, "--search-games", 300, "--quiet", "--team", 1)
    said = coevo("baselines", copied, *few, "--beside", varying.path)
    assert "other run (varying)" in said.out
    assert "the champions of the other run (varying)." in said.out
    (row,) = (
        row
        for row in json.loads(coevo("baselines", copied, *few, "--beside", varying.path, "--json").out)["teams"]
        if row["kind"] == "other run"
    )
    last, other = (champions(one, one.finished - 1) for one in (run, varying))
    assert row["share"] == won(run, other[1], [last[0], other[0]], 1).mean()


@pytest.mark.parametrize("team", [0, 1])
def test_in_cross_play_opponents_are_the_champions_of_the_other_runs_alone(team, coevo, runs, tmp_path):
    """Also with a run beside: its champions are asked about, and nobody meets those of its other side."""
    copies = [
        shutil.copytree(one.path, tmp_path / one.path.name, ignore=shutil.ignore_patterns("results")) for one in runs
    ]
    few = ("--games", 30, "--search-games", 300, "--quiet", "--team", team, "--cross-play")
    last = [champions(one, one.finished - 1) for one in runs]
    (said, data) = (coevo("baselines", *copies, *few, *more) for more in ((), ("--json",)))
    assert "Mean shares of fresh games won, against the champions of the other runs" in said.out
    rows = json.loads(data.out)["teams"]
    own = [row for row in rows if row["kind"] == "champions"]
    assert [row["run"] for row in own] == [str(path) for path in copies]
    for k, (run, row) in enumerate(zip(runs, own, strict=True)):
        met = [last[j][1 - team] for j in range(3) if j != k]
        assert row["share"] == won(run, last[k][team], met, team).mean()
    few_runs = coevo("baselines", *copies[:2], *few, "--beside", copies[2], "--beside", runs[2].path, "--json")
    beside = [row for row in json.loads(few_runs.out)["teams"] if row["kind"] == "other run"]
    assert len(beside) == 2
    for k, row in enumerate(beside):
        assert row["share"] == won(runs[k], last[2][team], [last[1 - k][1 - team]], team).mean()


def test_in_cross_play_another_team_must_evolve(coevo, tmp_path):
    runs = [
        create_run(tmp_path / f"run{seed}", read_experiment("two-learners", [f"seed={seed}"])).path for seed in (0, 1)
    ]
    said = coevo("baselines", *runs, "--cross-play")
    assert (said.code, said.out) == (2, "")
    assert f"only one team evolves in {runs[0]}" in said.err


def test_each_side_has_its_baselines_in_order(found):
    for robots, of in found.groupby("robots", sort=False):
        assert of["kind"].tolist() == list(KINDS[:-1]), robots
        assert of["chosen"].all()
        assert ((of["share"] + of["lost"] + of["time_out"]).round(9) == 1.0).all()
    assert found["name"].tolist()[3] == "mine"
    assert found["robots"].unique().tolist() == ["r0, r1", "r2"]


def test_what_was_found_is_kept_and_workers_change_nothing(found, runs, tmp_path):
    run, random, _ = runs
    hand = read_hand_typed(run.game, run.path.parent / "teams.toml")
    pd.testing.assert_frame_equal(table(open_run(run.path), None, **FEW, hand=hand, beside=random), found)
    fresh = open_run(shutil.copytree(run.path, tmp_path / "run", ignore=shutil.ignore_patterns("results")))
    with Evaluator(run.config, workers=1, backend="threads") as evaluator:
        again = table(fresh, evaluator, **FEW, hand=hand, beside=random)
    pd.testing.assert_frame_equal(again.drop(columns="run"), found.drop(columns="run"))
    for path in (run.path / "results").iterdir():
        assert path.read_bytes() == (fresh.path / "results" / path.name).read_bytes()


def test_equal_games_are_those_of_evolution_with_guests_and_of_choosing_champions(small_settings, tmp_path):
    changes = {
        "same": ["seed=9", "gp.variation=random"],
        "more": ["evaluation.games=4"],
        "guests": ["evaluation.grouping=best"],
        "chosen": ["evaluation.champion_games=40"],
    }
    run = create_run(tmp_path / "run", small_settings())
    others = {name: create_run(tmp_path / name, small_settings(*of)) for name, of in changes.items()}
    assert {name: equal_games(run, other) for name, other in others.items()} == {
        "same": True,
        "more": False,
        "guests": False,
        "chosen": False,
    }


def test_the_depth_that_is_asked_for_is_searched(coevo, runs, tmp_path, monkeypatch):
    run, asked = shutil.copytree(runs[0].path, tmp_path / "run"), []

    def search(*args, **options):  # noqa: ANN003 - those of best_answer
        asked.append(options["depth"])
        return best_answer(*args, **options)

    monkeypatch.setattr(compare, "best_answer", search)
    few = ("--team", 1, "--games", 10, "--search-games", 310, "--json", "--quiet")
    told = [json.loads(coevo("baselines", run, *few, "--depth", depth).out) for depth in (1, 2)]
    assert asked == [one["depth"] for one in told] == [1, 2]


def test_over_runs_a_run_counts_once_whatever_its_games():
    """Won and lost apart: here the champions win more in three of four runs, and lose more in all."""
    rows = [
        (run, robots, kind, chosen, share, lost, over)
        for robots in ("r0", "r2")
        for run, over, more in (("a", 0.1, 0.1), ("b", 0.2, 0.0), ("c", -0.1, 0.1), ("d", 0.2, 0.2))
        for kind, chosen, share, lost in (
            ("champions", True, 0.5, 0.3 + more),
            ("small trees", True, 0.5 - over, 0.2 if robots == "r0" else 0.6),
            ("hand-typed", False, 0.0, 0.0),
        )
    ]
    tables = pd.DataFrame(rows, columns=["run", "robots", "kind", "chosen", "share", "lost", "over"])
    (row, other) = over_runs(tables).to_dict("records")
    assert (row["robots"], row["kind"], row["runs"], row["better"]) == ("r0", "small trees", 4, 3)
    assert row["over"] == pytest.approx(0.1)
    assert row["champions"] == pytest.approx(0.5)
    assert row["low"] < 0.1 < row["high"]
    assert (row["champions_lost"], row["lost"], row["less"]) == pytest.approx((0.4, 0.2, -0.2))
    assert row["less_low"] < -0.2 < row["less_high"] < 0.0
    assert row["safer"] == 0
    assert (other["robots"], other["less"], other["safer"]) == ("r2", pytest.approx(0.2), 4)
    told = _several(over_runs(tables), cross_play=False)
    assert "as small trees; they are ahead in 3 of 4 runs." in told
    assert "says nothing" not in told
    apart = over_runs(tables, {"a": "x", "b": "y", "c": "x", "d": "y"}).to_dict("records")
    assert [(of["group"], of["robots"], of["runs"]) for of in apart] == [
        ("x", "r0", 2),
        ("y", "r0", 2),
        ("x", "r2", 2),
        ("y", "r2", 2),
    ]
    assert [of["over"] for of in apart] == pytest.approx([0.0, 0.2, 0.0, 0.2])


def test_a_recipe_may_hold_teams_and_a_shipped_one_of_the_same_name_gives_way(coevo, small_run, tmp_path):
    shipped = shipped_hand_typed(small_run.game)
    tables = [
        {"name": "mine", "r2": "IF_ball_is_lost(pass, shoot)"},
        {"name": shipped[0].name, "r0": "pass", "r1": "pass"},
    ]
    recipe = tmp_path / "recipe.toml"
    recipe.write_text(to_toml(msgspec.structs.replace(small_run.config, hand_typed=tuple(tables))), encoding="utf-8")
    assert coevo("evolve", recipe, "--generations", 1, "--unseen", 0, "--out", tmp_path / "run").code == 0
    found = hand_typed_of(open_run(tmp_path / "run"))
    assert [(one.name, one.team) for one in found[:2]] == [("mine", 1), (shipped[0].name, 0)]
    assert {role: str(tree) for role, tree in found[1].trees.items()} == {0: "pass", 1: "pass"}
    assert found[2:] == shipped[1:]
    typed = coevo("evolve", recipe, "--set", "hand_typed.1.r1=shout", "--out", tmp_path / "other")
    assert typed.code == 2
    assert "hand_typed: team 2, r1: tree: unknown name 'shout'" in typed.err
    assert not (tmp_path / "other").exists()


def test_the_shipped_teams_that_a_game_has_place_for(small_run):
    found = shipped_hand_typed(small_run.game)
    assert {one.team for one in found} == {0, 1}
    assert all(set(one.trees) == ({0, 1} if one.team == 0 else {2}) for one in found)
    assert len({(one.team, one.name) for one in found}) == len(found) > 10


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"expected \[\[teams\]\] with name"),
        ('[[team]]\nname = "x"', "got 'team' beside it"),
        ('[[teams]]\nr2 = "shoot"', "team 1: expected name = what it is called, got None"),
        ('[[teams]]\nname = "x"\nr2 = "shout"', "team 1, r2: tree: unknown name 'shout'.*Did you mean 'shoot'"),
        ('[[teams]]\nname = "x"\nr2 = 3', "expected a tree for r2, as text; got 3"),
        ('[[teams]]\nname = "x"\nr3 = "shoot"', "'r3' does not evolve here"),
        ('[[teams]]\nname = "x"\nr0 = "shoot"', r"each robot of one team \(r0, r1 or r2\), got trees for r0"),
        ('[[teams]]\nname = "x"\nr2 = "shoot"\n[[teams]]\nname = "x"\nr2 = "pass"', "got 'x' twice"),
        ("teams = 3", "once or more"),
        ("[[teams]", "is not valid TOML"),
    ],
)
def test_a_list_of_teams_that_is_wrong_is_told(text, message, small_run, tmp_path):
    (tmp_path / "teams.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_hand_typed(small_run.game, tmp_path / "teams.toml")


def test_the_command_tells_one_run_and_several(coevo, runs, tmp_path):
    run, random, _ = runs
    few = ("--games", 30, "--search-games", 300, "--quiet")
    one = coevo("baselines", run.path, *few, "--hand", run.path.parent / "teams.toml", "--random", random.path)
    assert (one.code, one.err) == (0, "")
    assert "Shares of 30 fresh games" in one.out
    assert one.out.count("The champions win") == 8
    out = tmp_path / "all.csv"
    several = [
        coevo("baselines", run.path, random.path, *few, "--team", 1, "--out", out, *m) for m in ((), ("--json",))
    ]
    data = json.loads(several[1].out)
    assert {row["run"] for row in data["teams"]} == {str(run.path), str(random.path)}
    assert {row["robots"] for row in data["over_runs"]} == {"r2"}
    groups = [
        "smoke gp.variation=genetic",
        "smoke gp.variation=random",
    ]  # which evolved is not averaged with which did not
    assert [(row["group"], row["runs"]) for row in data["over_runs"]] == [
        (name, 1) for name in groups for _ in range(3)
    ]
    assert all(row["low"] is row["high"] is None for row in data["over_runs"])  # of one run there is no interval
    assert several[0].out.count(": champions win") == 0
    assert "says nothing about other seeds of its kind" in several[0].out
    assert len(pd.read_csv(out)) == len(data["teams"])


def test_who_is_not_finished_is_told_and_a_copy_is_no_other_run(coevo, runs, small_settings, begun, tmp_path):
    run = runs[0]
    part = begun(create_run(tmp_path / "part", small_settings("skills.pass=", "skills.avoid=", "seed=7")))
    few = ("--games", 10, "--search-games", 300, "--team", 1)
    said = coevo("baselines", run.path, *few, "--beside", part.path)
    assert said.err.count("is not finished") == 1
    assert f"{part.path} is not finished: its last champions are those of generation 1 of 3" in said.err
    assert "the same of all against the same opponents:" in said.out
    copied = shutil.copytree(run.path, tmp_path / "copy")
    refused = coevo("baselines", run.path, copied, *few)
    assert (refused.code, refused.out) == (2, "")
    assert f"{copied} and {run.path} have the same settings and seed" in refused.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["absent"], "absent"),
        (["RUN", "--team", 2], r"expected a team that evolves (0, 1), got 2"),
        (["RUN", "--random", "LADDER"], "is about another game"),
        (["RUN", "--beside", "LADDER"], "is about another game"),
        (["RUN", "--beside", "RUN", "--random", "OTHER"], "expected --beside once for each of 1 runs"),
        (["RUN", "--cross-play"], "expected two runs or more with --cross-play"),
        (["RUN", "LADDER", "--cross-play"], "is about another game"),
        (["RUN", "--hand", "absent.toml"], "cannot read absent.toml"),
        (["RUN", "--out", "table.svg"], "expected a file ending in .csv"),
        ([], "Missing argument"),
    ],
)
def test_wrong_input_is_told_and_nothing_is_played(arguments, message, coevo, copied_run, runs, ladder_run):
    folders = {"RUN": copied_run, "OTHER": runs[1].path, "LADDER": ladder_run.path}
    shutil.rmtree(copied_run / "results", ignore_errors=True)
    said = coevo("baselines", *(folders.get(word, word) for word in arguments))
    assert (said.code, said.out) == (2, "")
    assert message in said.err
    assert "Traceback" not in said.err
    assert not (copied_run / "results").exists()
