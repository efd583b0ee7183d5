"""Tables of chapter 6: sizes are those of the trees themselves, shares and take-overs of rows put down by hand."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from analysis.chapter6 import (
    TABLES,
    Evolved,
    differences,
    endings,
    figures,
    late_and_early,
    levels,
    play,
    read_conditions,
    sizes,
    worth,
)
from analysis.tournament import play_tournament
from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator
from coevo.run import create_run, open_run

RECIPE = "dissertation-three-learners"
ENDS = ("pass_and_shoot", "alone", "interception", "unopposed", "own_goal", "time_out")
COLUMNS = (
    *("recipe", "seed", "fitness.kind", "run"),
    *(f"team{team}_{who}" for team in (0, 1) for who in ("last", "first", "single_skills")),
    *(f"settled_{end}" for end in ENDS),
    *("settled_ratio", "took_over", "take_over"),
)
ROWS = {
    0: (*(0.5, 0.1, 0.4, 0.2, 0.3, 0.1), *(0.1, 0.2, 0.3, 0.1, 0.1, 0.2), 0.25, 1, 2),
    1: (*(0.3, 0.2, 0.4, 0.3, 0.2, 0.1), *(0.3, 0.2, 0.1, 0.0, 0.1, 0.3), 0.75, 0, ""),
}


@pytest.fixture(scope="module")
def folder(small_settings, go_on, tmp_path_factory):
    path = tmp_path_factory.mktemp("study")
    rows = []
    for seed, told in ROWS.items():
        name = f"{RECIPE}-fixed-seed{seed}"
        go_on(create_run(path / name, small_settings(f"seed={seed}")))
        rows.append((RECIPE, seed, "fixed", name, *told))
    with (path / "table.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([COLUMNS, *rows])
    return path


def rows_of(report):
    ((header, rows),) = report.values()
    return [dict(zip(header, row, strict=True)) for row in rows]


def test_sizes_are_those_of_the_trees_beside_the_table_of_the_source(folder):
    conditions = read_conditions(folder)
    (runs,) = conditions.values()
    assert list(conditions) == ["three-learners, fixed"]
    found = {(row["robot"], row["of trees"]): row for row in rows_of(sizes(conditions))}
    assert set(found) == {(robot, what) for robot in ("r0", "r1", "r2") for what in ("depth", "nodes")}
    for (robot, what), row in found.items():
        trees = []  # of each run: sizes of all trees of its last generation, best fitness first
        for one in runs:
            record = one.run.record(2, robot)
            ranks = range(len(record))
            trees.append([getattr(one.run.tree(robot, 2, rank), what) for rank in ranks])
        best, average, worst = (
            float(np.mean([of(one) for one in trees])) for of in (lambda x: x[0], np.mean, lambda x: x[-1])
        )
        assert row["best"].split()[0] == f"{best:.3f}"
        assert row["average"].split()[0] == f"{average:.3f}"
        assert row["worst"].split()[0] == f"{worst:.3f}"
        theirs = TABLES["three-learners", "fixed", robot][what == "nodes"]
        assert row["in the source"] == ", ".join(f"{number:g}" for number in theirs)


def test_trees_of_a_preset_are_beside_no_table_of_the_source(folder):
    ((name, runs),) = read_conditions(folder).items()
    preset = [replace(one, row={**one.row, "recipe": "three-learners"}) for one in runs]
    assert {row["in the source"] for row in rows_of(sizes({name: preset}))} == {""}


def test_what_the_best_did_is_told_per_game(folder):
    conditions = read_conditions(folder)
    (runs,) = conditions.values()
    for row in rows_of(play(conditions)):
        best = [one.run.record(2, row["robot"]).iloc[0] for one in runs]
        for name, column in {"contact": "kicks", "steps": "steps"}.items():
            assert row[name].split()[0] == f"{np.mean([one[column] / 2 for one in best]):.3f}"  # of two games


def test_champions_are_compared_with_the_first_and_with_single_skills_run_by_run(folder):
    first, second = rows_of(worth(read_conditions(folder)))
    assert (first["robots"], second["robots"]) == ("r0, r1", "r2")
    assert [first[name].split()[0] for name in ("last", "first", "single skills")] == ["0.400", "0.150", "0.400"]
    assert first["last - first"].startswith("0.250")
    assert (first["ahead of first"], first["of single skills"]) == ("2 of 2", "1 of 2")
    assert (second["ahead of first"], second["of single skills"]) == ("1 of 2", "2 of 2")


def test_arms_are_compared_with_the_first_of_their_setting_over_runs_of_the_same_seeds(small_settings, tmp_path):
    run = create_run(tmp_path / "run", small_settings(preset="two-learners"))

    def arm(name, won, setting="two-learners"):
        rows = [{"recipe": setting, "seed": str(seed), "team0_last": str(last)} for seed, last in won.items()]
        return [Evolved(setting, {"arm": name}, row, run) for row in rows]

    arms = [
        arm("genetic", {0: 0.7, 1: 0.8, 2: 0.9, 3: 0.0}),
        arm("random", {2: 0.6, 1: 0.7, 0: 0.5, 4: 1.0}),  # less by .2, .1 and .3; seed 4 has no other
        arm("late", {1: 0.9, 0: 0.8}),
        arm("genetic", {0: 0.1}, "stationary-opponent"),
        arm("random", {0: 0.2}, "stationary-opponent"),
        arm("alone", {0: 0.2}, "three-learners"),
    ]
    rows = rows_of(differences({runs[0].condition: runs for runs in arms}))
    assert [list(row.values()) for row in rows] == [
        # t = 4.303 of two degrees of freedom, times .1 / sqrt(3)
        ["two-learners, random", "3", "r0, r1", "two-learners, genetic", "-0.200 [-0.448, 0.048]", "0 of 3"],
        ["two-learners, late", "2", "r0, r1", "two-learners, genetic", "0.100 [0.100, 0.100]", "2 of 2"],
        ["stationary-opponent, random", "1", "r0, r1", "stationary-opponent, genetic", "0.100", "1 of 1"],
    ]


def test_where_two_teams_evolve_each_meets_another_so_nothing_is_compared(folder):
    ((name, runs),) = read_conditions(folder).items()
    other = [replace(one, varied={"fitness.kind": "varying"}) for one in runs]
    assert rows_of(differences({name: runs, "three-learners, varying": other})) == []


def test_games_end_as_the_rows_say(folder):
    (row,) = rows_of(endings(read_conditions(folder)))
    assert [row[name].split()[0] for name in ("alone", "interception", "time-out")] == ["0.200", "0.200", "0.250"]
    assert row["pass and shoot : interception"].startswith("0.500")
    assert row["most frequent"] == "pass and shoot 1, interception 1"
    assert row["others took over"] == "1 of 2 [0.09, 0.91]"  # Wilson's interval of one in two
    assert row["since generation"] == "2.000"


def test_where_nothing_is_decided_most_games_end_by_time_and_where_nothing_is_counted_nothing_is_told(folder):
    ((name, runs),) = read_conditions(folder).items()
    nobody = {f"settled_{end}": str(float(end == "time_out")) for end in ENDS}
    timed_out = [replace(one, row={**one.row, **nobody}) for one in runs]
    assert rows_of(endings({name: timed_out}))[0]["most frequent"] == "time-out 2"
    untold = [replace(one, row={**one.row, **dict.fromkeys(nobody, "")}) for one in runs]
    assert rows_of(endings({name: untold})) == []


def test_a_preset_and_the_recipe_of_the_dissertation_of_its_name_are_two_conditions(folder, tmp_path):
    """Alone, the dissertation's recipe is called by its setting."""
    with (folder / "table.csv").open(encoding="utf-8", newline="") as file:
        header, first, second = csv.reader(file)
    for row in (first, second):
        (tmp_path / row[3]).symlink_to(folder / row[3])
    with (tmp_path / "table.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([header, first, [RECIPE.removeprefix("dissertation-"), *second[1:]]])
    conditions = read_conditions(tmp_path)
    assert list(conditions) == [f"{RECIPE}, fixed", "three-learners, fixed"]
    told = {row["condition"]: row["in the source"] for row in rows_of(sizes(conditions))}
    assert told["three-learners, fixed"] == ""
    assert told[f"{RECIPE}, fixed"] != ""


def test_a_game_that_counts_nothing_of_soccer_is_told_without(ladder_run):
    row = {"recipe": "ladder", "seed": "0", "run": "x"}
    conditions = {"ladder": [Evolved("ladder", {}, row, ladder_run)]}
    for row in rows_of(play(conditions)):
        assert [row[count] for count in ("goals", "passes")] == ["", ""]
    assert list(figures(conditions)) == ["ladder.svg"]


def test_thirds_of_a_tournament_are_compared_where_one_was_played(folder):
    assert rows_of(late_and_early(read_conditions(folder))) == []
    run = open_run(folder / f"{RECIPE}-fixed-seed1")
    with Evaluator(run.config, workers=1, backend="threads", folders=run.folders) as evaluator:
        played = play_tournament(run, evaluator, generations=(0, 1, 2), games=5)
    found = rows_of(late_and_early(read_conditions(folder)))
    assert [(row["runs"], row["robots"]) for row in found] == [("1", "r0, r1"), ("1", "r2"), ("1", "all, the least")]
    wins = played.wins[0] / 5  # rows are generations of r0 and r1, columns of r2; the last axis who won
    sides = wins[..., 0].mean(axis=1), wins[..., 1].mean(axis=0)
    least = min(of[2] - of[0] for of in sides)
    assert found[2]["difference"] == f"{least:.3f}"
    assert found[2]["last ahead"] == f"{int(least > 0)} of 1"
    for row, by_generation in zip(found, sides, strict=False):
        assert row["first third"] == f"{by_generation[0]:.3f}"
        assert row["last third"] == f"{by_generation[2]:.3f}"
        assert row["last ahead"] == f"{int(by_generation[2] > by_generation[0])} of 1"


def test_levels_are_counted_over_runs(small_settings, go_on, tmp_path):
    """One run is raised after its first generation and stays on the highest level; the other is never raised."""

    def levelled(name, rate):
        of = ['levels.keys=[{"game.time_limit_steps" = [80, 90]}]', "levels.window=1"]
        settings = small_settings(*of, f"levels.raise_when={{{rate}={{at_least=0.5}}}}")
        return Evolved("levelled", {}, {}, go_on(create_run(tmp_path / name, settings)))

    runs = [levelled("raised", "undecided"), levelled("never", "decided")]  # in so few steps hardly anybody scores
    without = Evolved("without", {}, {}, create_run(tmp_path / "without", small_settings()))
    (row,) = rows_of(levels({"levelled": runs, "without": [without]}))
    assert {name: told.split()[0] for name, told in row.items()} == {
        "condition": "levelled",
        "runs": "2",
        "last level": "0.500",
        "highest": "1",
        "came to it": "1",
        "highest since": "1.000",
        "generations on it": "0.333",  # two of three in one run
        "raised": "0.500",
        "lowered": "0.000",
    }
    assert row["came to it"] == "1 of 2"


@pytest.mark.slow
def test_the_command_writes_tables_and_curves(folder, coevo, tmp_path):
    said = coevo("reproduce", "chapter6", folder, "--out", tmp_path / "report", "--json")
    told = json.loads(said.out)
    assert told["figures"] == ["three-learners.svg"]
    assert set(told["tables"]) == {"worth", "differences", "endings", "late-and-early", "levels", "play", "sizes"}
    assert (tmp_path / "report" / "three-learners.svg").read_text(encoding="utf-8").startswith("<svg")


def test_a_run_that_is_not_finished_is_named(small_settings, tmp_path):
    create_run(tmp_path / "begun-seed0", small_settings())
    (tmp_path / "table.csv").write_text("recipe,seed,run\nsmoke,0,begun-seed0\n", encoding="utf-8")
    with pytest.raises(InputError, match="begun-seed0 is in the table of the study, but not finished"):
        read_conditions(tmp_path)
