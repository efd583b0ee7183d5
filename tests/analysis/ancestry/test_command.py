"""coevo ancestry: what it prints and writes."""

from __future__ import annotations

import json

import pandas as pd
import pytest
from click.testing import CliRunner

from analysis.ancestry import ancestors, summary
from analysis.commands import ancestry
from coevo.errors import InputError
from coevo.run import create_run
from coevo.usage import tree_usage


@pytest.fixture
def run_command():
    def run(*words):
        done = CliRunner().invoke(ancestry, [str(word) for word in words], catch_exceptions=False)
        assert done.exit_code == 0
        return done

    return run


def test_json_is_the_summary_of_the_ancestry(busy_run, run_command):
    told = json.loads(run_command(busy_run.path, "--robot", "r2", "--generation", 4, "--rank", 3, "--json").stdout)
    row = busy_run.record(4, "r2").iloc[3]
    steps = tree_usage(busy_run, 4, "r2", int(row["index"])).node_steps
    expected = summary(ancestors(busy_run, "r2", 4, int(row["index"]), node_steps=steps))
    assert told == {"run": str(busy_run.path), "rank": 3, "fitness_again": None, **expected}
    assert told["fitness"] == row["fitness"]
    assert told["nodes"] == row["nodes"] == sum(origin["nodes"] for origin in told["origins"])
    assert sum(origin["use"] for origin in told["origins"]) == pytest.approx(1.0)


def test_without_options_it_is_about_the_last_best_of_the_first(busy_run, run_command):
    done = run_command(busy_run.path, "--quiet")
    best = busy_run.record(6, "r0").iloc[0]
    assert done.stdout.startswith(f"r0's best of generation 6 has {best['nodes']} nodes: ")
    assert "\nits nodes came from " in done.stdout
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("suffix", "begins"), [(".svg", b"<svg"), (".png", b"\x89PNG"), (".html", b"<!DOCTYPE html>"), (".csv", b"gene")]
)
def test_pictures_and_tables_are_written(suffix, begins, busy_run, run_command, tmp_path):
    out = tmp_path / f"family{suffix}"
    done = run_command(busy_run.path, "--out", out)
    assert done.stdout.endswith(f"\nWritten: {out}\n")
    assert out.read_bytes().startswith(begins)
    if suffix == ".csv":
        told = json.loads(run_command(busy_run.path, "--json").stdout)
        table = pd.read_csv(out)
        assert len(table) == told["ancestors"] + 1
        assert table["root_line"].sum() == len(told["root_line"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--rank", "10"], "rank must be from 0 to 9, got 10"),
        (["--robot", "r7"], "'r7' does not evolve in this run; choose one of r0, r1, r2"),
        (["--generation", "8"], "has no generation 8; finished generations: 0 to 6"),
        (["--out", "family.pdf"], "expected a file ending in .svg, .png, .html, .csv, got 'family.pdf'"),
    ],
)
def test_what_is_wrong_is_told(words, message, busy_run):
    done = CliRunner().invoke(ancestry, [str(busy_run.path), *words])
    assert isinstance(done.exception, InputError)
    assert message in str(done.exception)
    assert done.stdout == ""


def test_where_champions_were_chosen_once_more_it_is_about_the_chosen_one(run_command, small_settings, go_on, tmp_path):
    run = go_on(create_run(tmp_path / "run", small_settings("evaluation.champion_games=8")))
    rows = run.champions().to_dict("records")
    ranks = [run.record(2, row["robot"])["index"].tolist().index(row["index"]) for row in rows]
    assert sorted(rank > 0 for rank in ranks) == [False, True, True]  # of both kinds
    for row, rank in zip(rows, ranks, strict=True):
        words = (run.path, "--robot", row["robot"], "--quiet")
        told = json.loads(run_command(*words, "--json").stdout)
        assert (told["generation"], told["rank"], told["index"]) == (row["generation"], rank, row["index"])
        assert (told["fitness"], told["fitness_again"]) == (row["fitness"], row["fitness_again"])
        place = "best" if rank == 0 else f"rank {rank}"
        whose = f"{row['robot']}'s champion ({place} of generation 2, chosen once more by 8 games) has "
        assert run_command(*words).stdout.startswith(whose)
        best = run_command(*words, "--rank", 0).stdout
        assert best.startswith(whose if rank == 0 else f"{row['robot']}'s best of generation 2 has ")


def test_in_random_search_a_tree_comes_from_the_generation_that_made_it(run_command, small_settings, go_on, tmp_path):
    run = go_on(create_run(tmp_path / "run", small_settings("gp.variation=random")))
    for row in run.record(2, "r1").query("operator == 'creation'").head(2).itertuples():
        told = run_command(run.path, "--robot", "r1", "--rank", row.Index).stdout
        assert f"has {row.nodes} node" in told
        assert "all from generation 2" in told
        assert "It was created in generation 2." in told
        assert "Its root line" not in told
