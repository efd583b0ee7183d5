"""Curves of runs against the run folder's own table, groups of runs, and charts of them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from scipy import stats

import analysis.charts
from analysis.commands import curves
from analysis.curve_chart import chart, words_for
from analysis.curves import COLUMNS, STATISTICS, choose, overview, summary, table
from analysis.groups import group_names, open_runs, run_names
from coevo.config import check_experiment, override, read_toml
from coevo.errors import InputError
from coevo.evolution import evolve
from coevo.evolution.evaluation import Evaluator
from coevo.measures import distinct_trees, evenness, top_of
from coevo.run import create_run, open_run
from coevo.tree import FunctionSet, parse, tree_codes

NUMBERS = Path(__file__).parents[2] / "docs" / "examples" / "numbers.toml"
SIZES = ("depth", "nodes")


@pytest.fixture(scope="module")
def soccer(small_settings, go_on, tmp_path_factory):
    """Return runs of two seeds and, with another fitness, of one: only to be read."""
    folder = tmp_path_factory.mktemp("soccer")
    settings = {"one": ["seed=1"], "two": ["seed=2"], "other": ["seed=1", "fitness.kind=varying"]}
    return [go_on(create_run(folder / name, small_settings(*changes))) for name, changes in settings.items()]


@pytest.fixture(scope="module")
def numbers(tmp_path_factory):
    """Return a run of a game of one's own."""
    data = override(read_toml(NUMBERS), ["gp.population=8", "gp.generations=3"])
    folder = tmp_path_factory.mktemp("numbers")
    run = create_run(folder / "numbers", check_experiment(data, "numbers.toml"), (NUMBERS.parent,))
    with Evaluator(run.config, workers=1, backend="threads", folders=run.folders) as evaluator:
        evolve(run, evaluator, lambda _: None)
    return open_run(run.path)


def call(*words):
    return CliRunner().invoke(curves, [str(word) for word in words], catch_exceptions=False)


def refusal(*words):
    with pytest.raises(InputError) as refused:
        call(*words)
    return str(refused.value)


@pytest.mark.parametrize("kind", ["soccer", "numbers"])
def test_numbers_are_exactly_those_of_generations_csv(kind, soccer, numbers):
    run = soccer[0] if kind == "soccer" else numbers
    found = table(run.path)
    assert tuple(found.columns) == COLUMNS
    wide = found.set_index(["generation", "robot", "measure", "statistic"])["value"].sort_index()
    expected = run.generations
    assert len(expected) == run.config.gp.generations * len(run.evolving)
    for row in expected.to_dict("records"):
        at = wide.loc[row["generation"], row["robot"]]
        for measure in ("fitness", *SIZES):
            assert [at[measure, name] for name in STATISTICS] == [row[f"{measure}_{name}"] for name in STATISTICS]
        for count in run.game.counts:
            assert at[count, "best"] == row[count]


def test_counts_of_the_worst_and_of_all_are_those_of_individuals(soccer):
    run = soccer[0]
    found = table(run).set_index(["generation", "robot", "measure", "statistic"])["value"]
    for (generation, robot), part in run.individuals.groupby(["generation", "robot"]):
        worst = part.sort_values(["fitness", "depth", "index"]).iloc[-1]
        for count in run.game.counts:
            assert found[generation, robot, count, "worst"] == worst[count]
            assert found[generation, robot, count, "mean"] == pytest.approx(part[count].mean(), rel=1e-12)


def test_use_is_the_share_of_decisions_that_chose_a_terminal(soccer):
    run = soccer[0]
    found = table(run).set_index(["generation", "robot", "measure", "statistic"])["value"]
    names = run.game.function_set(0).terminals
    for (generation, robot), part in run.individuals.groupby(["generation", "robot"]):
        chosen = part[[f"chose_{name}" for name in names]].to_numpy(float)
        shares = (chosen / chosen.sum(axis=1, keepdims=True)).mean(axis=0)
        told = [found[generation, robot, f"use_{name}", "mean"] for name in names]
        assert told == pytest.approx(shares.tolist())
        assert sum(found[generation, robot, f"use_{name}", "best"] for name in names) == pytest.approx(1.0)


def test_runs_of_older_versions_have_no_use(soccer, monkeypatch):
    run = open_run(soccer[0].path)
    individuals = run.individuals
    older = individuals[[name for name in individuals if not name.startswith(("chose_", "operator", "parent"))]]
    monkeypatch.setattr(type(run), "individuals", older)
    assert not [name for name in set(table(run)["measure"]) if name.startswith("use_")]
    with pytest.raises(InputError, match="there is no measure 'use'"):
        choose(table(run), ["use"])


def test_an_individual_that_decided_nothing_is_left_out_of_the_mean(soccer, monkeypatch):
    run = open_run(soccer[0].path)
    individuals = run.individuals.query("generation == 0 and robot == 'r0'").copy()
    chose = [name for name in individuals if name.startswith("chose_")]
    individuals[chose] = 0
    individuals.loc[individuals["index"] == 0, "chose_shoot"] = 3
    individuals.loc[individuals["index"] == 1, "chose_avoid"] = 5
    monkeypatch.setattr(type(run), "individuals", individuals)
    mean = table(run).query("statistic == 'mean'").set_index("measure")["value"]
    assert (mean["use_shoot"], mean["use_avoid"], mean["use_search"]) == (0.5, 0.5, 0.0)
    individuals[chose] = 0
    assert table(run).query("measure == 'use_shoot'")["value"].isna().all()


def test_a_run_that_is_under_way_is_read_as_far_as_it_is(soccer, tmp_path):
    shutil.copytree(soccer[0].path, tmp_path / "part")
    (tmp_path / "part" / "individuals.parquet" / "part-00002.parquet").unlink()
    (tmp_path / "part" / "checkpoint.npz").unlink()  # which would tell of the third generation: then it was lost
    assert set(table(tmp_path / "part")["generation"]) == {0, 1}
    assert "has finished 2 of 3 generations" in call(tmp_path / "part").stderr
    both = summary(table([tmp_path / "part", soccer[1].path]))
    assert both.groupby("generation")["runs"].unique().map(list).to_dict() == {0: [2], 1: [2], 2: [1]}


def test_a_run_without_a_generation_is_refused(small_settings, tmp_path):
    run = create_run(tmp_path / "new", small_settings())
    with pytest.raises(InputError, match="has no finished generation yet; go on with 'coevo resume"):
        table(run)


# ---------------------------------------------------------------------------------------------------------- diversity


def test_trees_that_are_equal_near_the_root_are_one_top():
    functions = FunctionSet(("IF_a", "IF_b"), ("x", "y"))
    texts = ("IF_a(IF_b(IF_a(x, y), y), x)", "IF_a(IF_b(IF_a(y, x), y), x)", "IF_a(IF_b(x, y), x)", "x")
    codes = [tree_codes(parse(text, functions), functions) for text in texts]
    tops = [top_of(tree, functions) for tree in codes]
    name = functions.codes
    assert tops[0] == (name["IF_a"], name["IF_b"], name["IF_a"], name["y"], name["x"])
    assert tops[0] == tops[1] != tops[2]
    assert tops[3] == (name["x"],)
    assert distinct_trees(codes) == 1.0
    # Two of one kind and one each of two others: 1.5 bits of at most 2.
    assert evenness(tops) == pytest.approx(0.75)


def test_diversity_is_told_of_whole_populations_only(soccer):
    part = table(soccer[0]).query("measure.str.startswith('diversity')")
    assert set(part["statistic"]) == {"mean"}
    assert part["value"].between(0.0, 1.0).all()


# ------------------------------------------------------------------------------------------------------------- groups


def test_runs_that_differ_in_the_seed_alone_are_one_group_named_by_what_others_differ_in(soccer, numbers):
    assert group_names(soccer[:2]) == {"one": "smoke", "two": "smoke"}
    assert group_names([*soccer, numbers]) == {
        "one": "smoke fitness.kind=fixed",
        "two": "smoke fitness.kind=fixed",
        "other": "smoke fitness.kind=varying",
        "numbers": "numbers",
    }


def test_groups_that_differ_in_much_are_named_by_what_tells_most_of_them_apart(small_settings, tmp_path):
    many = ["gp.population=7", "gp.elite=2", "gp.tournament=3", "fitness.kind=varying"]
    changes = [[], [*many, "evaluation.games=5"], [*many, "evaluation.games=6"]]
    runs = [create_run(tmp_path / str(n), small_settings(*one)) for n, one in enumerate(changes)]
    names = list(group_names(runs).values())
    assert [name.split(",")[0] for name in names] == [f"smoke evaluation.games={games}" for games in (2, 5, 6)]
    assert all(name.endswith(" and 2 more") for name in names)


def test_names_of_equal_folders_are_told_apart_and_a_run_counts_once(small_settings, tmp_path):
    runs = [create_run(tmp_path / place / "run", small_settings()) for place in ("a", "b")]
    assert run_names(runs) == ["a/run", "b/run"]
    with pytest.raises(InputError, match="is named twice"):
        open_runs([runs[0], tmp_path / "a" / "run"])


def test_a_summary_is_an_estimate_over_runs_with_its_interval(soccer):
    found = table(soccer)
    told = summary(found, group_names(soccer))
    two = told.query("group == 'smoke fitness.kind=fixed'")
    key = ["generation", "robot", "measure", "statistic"]
    each = [part.set_index(key)["value"] for _, part in found[found["run"].isin(["one", "two"])].groupby("run")]
    for row in two.query("measure == 'kicks'").to_dict("records"):
        values = [one[tuple(row[name] for name in key)] for one in each]
        low, high = stats.t.interval(0.95, 1, np.mean(values), stats.sem(values)) if values[0] != values[1] else values
        assert (row["value"], row["low"], row["high"]) == pytest.approx((np.mean(values), low, high))
        assert row["runs"] == 2
    one = told.query("group == 'smoke fitness.kind=varying'")
    assert one["low"].isna().all()
    assert (one["value"].to_numpy() == found.query("run == 'other'")["value"].to_numpy()).all()


def test_the_interquartile_mean_of_ten_runs_passes_over_the_outliers():
    frame = pd.DataFrame(
        [(f"s{n}", 0, "r0", "goals", "best", value) for n, value in enumerate([*range(1, 10), 1000])], columns=COLUMNS
    )
    told = {name: summary(frame, estimator=name).iloc[0] for name in ("mean", "iqm")}
    assert (told["iqm"]["value"], told["mean"]["value"]) == (5.5, 104.5)
    assert told["iqm"]["high"] < 1000.0


# ------------------------------------------------------------------------------------------------------------- charts


def values_drawn(spec):
    """Return all rows that a chart holds."""
    found = [row for rows in spec["datasets"].values() for row in rows]
    return pd.DataFrame(found)


def test_a_chart_holds_the_numbers_of_the_summary_and_computes_none(soccer):
    found = summary(choose(table(soccer), ["fitness", "goals"]), group_names(soccer))
    spec = chart(found, words_for(soccer)).to_dict()
    text = json.dumps(spec)
    assert '"aggregate"' not in text
    assert '"transform"' not in text
    drawn = values_drawn(spec).drop_duplicates()
    key = ["group", "generation", "statistic", "value"]
    assert set(map(tuple, drawn[key].to_numpy())) == set(map(tuple, found[key].to_numpy()))
    assert "fitness" in text
    assert "(smaller is better)" in text
    assert "in 2 games" in text


@pytest.mark.parametrize("suffix", [".svg", *(pytest.param(one, marks=pytest.mark.slow) for one in (".png", ".html"))])
def test_pictures_are_the_same_each_time(soccer, suffix):
    found = summary(choose(table(soccer), ["goals"]), group_names(soccer))
    made = [analysis.charts.chart_bytes(chart(found, words_for(soccer)), suffix) for _ in range(2)]
    assert made[0] == made[1]


# ------------------------------------------------------------------------------------------------------------ command


def test_the_command_writes_the_table(soccer, tmp_path):
    said = call(*(run.path for run in soccer), "--out", tmp_path / "x.csv")
    assert said.output == f"Written: {tmp_path / 'x.csv'}\n"
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "x.csv"), table(soccer), check_dtype=False)


@pytest.mark.parametrize("measure", ["fitness", "goals", "lost", "kicks", "collisions", "steps"])
def test_each_figure_of_the_dissertation_is_one_command(soccer, tmp_path, measure):
    call(
        soccer[0].path, "--measure", measure, "--statistic", "best", "--statistic", "mean", "--out", tmp_path / "x.svg"
    )
    assert "<svg" in (tmp_path / "x.svg").read_text()


def test_text_tells_first_middle_and_last_generation(soccer):
    lines = call(soccer[0].path, "--measure", "goals", "--statistic", "best").stdout.splitlines()
    assert lines[0] == "smoke"
    assert lines[1].split() == ["robot", "measure", "statistic", "gen.", "0", "gen.", "1", "gen.", "2"]
    best = soccer[0].generations.query("robot == 'r1'")["goals"].tolist()
    (r1,) = [line.split() for line in lines if line.startswith("r1")]
    assert r1 == ["r1", "goals", "best", *map(str, best)]


def test_json_holds_what_is_drawn(soccer):
    told = json.loads(call(*(run.path for run in soccer), "--measure", "goals", "--json").stdout)
    assert [run["group"] for run in told["runs"]] == list(group_names(soccer).values())
    assert told["measures"] == ["goals"]
    alone = [row for row in told["curves"] if row["runs"] == 1]
    assert alone
    assert all(row["low"] is None for row in alone)


def test_without_a_measure_it_is_what_to_look_at_first(numbers):
    assert overview(table(numbers)) == ["fitness", "won", "lost", "right", "depth", "nodes"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--measure", "goal"], "there is no measure 'goal'. Did you mean 'goals'?"),
        (["--measure", "diversity", "--statistic", "best"], "have the statistic mean only"),
        (["--out", "x.gif"], "expected a file ending in .svg, .png, .html, .csv, got 'x.gif'"),
        (["--out", "no/x.svg"], "there is no folder no"),
    ],
)
def test_what_cannot_be_is_refused(soccer, words, said):
    assert said in refusal(soccer[0].path, *words)


def test_runs_are_compared_in_what_all_of_them_have(soccer, numbers):
    said = refusal(soccer[0].path, numbers.path, "--measure", "goals")
    assert said.startswith("one has the measure 'goals', numbers has not; all of them have: fitness, lost, depth")
    assert set(overview(table([soccer[0], numbers]))) == {"fitness", "lost", "depth", "nodes"}


def test_no_run_and_what_is_none_are_refused(tmp_path):
    assert "expected at least one run folder" in refusal()
    assert "is not a run folder" in refusal(tmp_path)
    assert "does not exist" in refusal(tmp_path / "nothing")


def test_without_altair_there_are_numbers_but_no_pictures(soccer, tmp_path, monkeypatch):
    there = analysis.charts.importlib.util.find_spec
    monkeypatch.setattr(
        analysis.charts.importlib.util, "find_spec", lambda name: None if name == "altair" else there(name)
    )
    assert "charts need altair; install" in refusal(soccer[0].path, "--out", tmp_path / "x.svg")
    assert call(soccer[0].path, "--out", tmp_path / "x.csv").exit_code == 0
    assert call(soccer[0].path).exit_code == 0
