"""Help with examples, and runs that are told as one JSON object."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from coevo.run import open_run


@pytest.mark.parametrize("command", ["evolve", "resume", "inspect", "play", "learn", "skills", "bench"])
def test_every_command_has_help_with_an_example(command, coevo):
    said = coevo(command, "--help")
    assert said.code == 0
    assert said.out.startswith(f"Usage: coevo {command}")
    assert f"coevo {command}" in said.out.partition("\n")[2]
    assert "--help" in said.out


def test_help_lists_every_command(coevo):
    said = coevo("--help")
    assert said.code == 0
    for command in ("evolve", "resume", "inspect", "play", "bench", "learn", "skills"):
        assert re.search(rf"^  {command} ", said.out, re.MULTILINE)


def test_the_version_is_told(coevo):
    said = coevo("--version")
    assert said.code == 0
    assert re.search(r"\d+\.\d+", said.out)


def test_no_command_at_all_shows_the_help(coevo):
    said = coevo()
    assert (said.out + said.err).startswith("Usage: coevo")


def check_summary(data, run):
    assert set(data) >= {"run", "seed", "generations", "games", "seconds", "robots"}
    assert Path(data["run"]) == run.path
    gp = run.config.gp
    assert (data["seed"], data["generations"]) == (run.config.seed, gp.generations)
    assert data["games"] == gp.generations * gp.population * run.config.evaluation.games
    assert data["seconds"] >= 0.0
    assert set(data["robots"]) == {"r0", "r1", "r2"}
    table = run.generations
    for robot, best in data["robots"].items():
        (row,) = table[(table.robot == robot) & (table.generation == gp.generations - 1)].itertuples()
        assert set(best) >= {"best_fitness", "depth", "nodes"}
        assert best["best_fitness"] == pytest.approx(row.fitness_best, rel=1e-12)
        assert (best["depth"], best["nodes"]) == (row.depth_best, row.nodes_best)


def test_evolve_prints_one_object_and_progress_elsewhere(
    coevo, small_recipe, small_run, results_of, tmp_path, one_object
):
    said = coevo("evolve", small_recipe, "--out", tmp_path / "run", "--json")
    check_summary(one_object(said), open_run(tmp_path / "run"))
    lines = [line for line in said.err.splitlines() if line.startswith("generation ")]
    assert [line.split()[1] for line in lines] == ["1/3", "2/3", "3/3"]  # one plain line a step
    assert "\x1b" not in said.err
    assert results_of(tmp_path / "run") == results_of(small_run.path)


def test_quiet_commands_say_nothing_on_the_way(coevo, small_recipe, tmp_path, one_object):
    said = coevo("evolve", small_recipe, "--out", tmp_path / "run", "--json", "--quiet")
    assert one_object(said)["run"]
    assert said.err == ""
    for arguments in (["inspect"], ["play", "--games", "2"], ["resume"]):
        said = coevo(arguments[0], tmp_path / "run", *arguments[1:], "--quiet")
        assert (said.code, said.err) == (0, "")


def test_options_replace_what_the_recipe_says(coevo, small_recipe, tmp_path, one_object):
    arguments = ["--seed", "9", "--generations", "2", "--set", "gp.elite=2", "--set", "seed=4", "--workers", "2"]
    data = one_object(coevo("evolve", small_recipe, "--out", tmp_path / "run", "--json", *arguments))
    assert (data["seed"], data["generations"]) == (9, 2)
    config = open_run(tmp_path / "run").config
    assert (config.seed, config.gp.generations, config.gp.elite) == (9, 2, 2)


def test_runs_go_to_the_first_free_folder_by_default(coevo, small_recipe, tmp_path, monkeypatch, one_object):
    monkeypatch.chdir(tmp_path)
    folders = [
        one_object(coevo("evolve", small_recipe, "--generations", "1", "--json", "--quiet"))["run"] for _ in range(3)
    ]
    assert folders == ["runs/smoke-seed0", "runs/smoke-seed0-2", "runs/smoke-seed0-3"]
    assert all(open_run(folder).is_finished for folder in folders)


def test_resume_goes_on_and_prints_what_evolve_does(coevo, copied_run, small_run, results_of, cut_short, one_object):
    cut_short(copied_run, 1)
    said = coevo("resume", copied_run, "--json")
    check_summary(one_object(said), open_run(copied_run))
    assert "Going on at generation 1 of 3" in said.err
    assert results_of(copied_run) == results_of(small_run.path)


def test_a_finished_run_says_so(coevo, copied_run, results_of, one_object):
    before = results_of(copied_run)
    said = coevo("resume", copied_run, "--json")
    check_summary(one_object(said), open_run(copied_run))
    assert "is finished: all 3 generations are there" in said.err
    assert results_of(copied_run) == before
