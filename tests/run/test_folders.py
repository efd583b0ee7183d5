"""Run folders: making, locking and reading them, and damage to their other files."""

from __future__ import annotations

import errno
import hashlib
import itertools
import json
import re
import shutil
from contextlib import nullcontext

import numpy as np
import pandas as pd
import pytest

from coevo.errors import InputError
from coevo.game import function_set
from coevo.run import Run, create_run, open_run
from coevo.tree import Tree, from_codes


def test_a_damaged_part_is_named(copied_run):
    path = copied_run.path / "individuals.parquet" / "part-00001.parquet"
    path.write_bytes(path.read_bytes()[:-20])
    assert copied_run.tree("r0", 0)
    with pytest.raises(InputError, match=re.escape(str(path)) + ".* is damaged"):
        copied_run.tree("r0", 1)
    with pytest.raises(InputError, match=re.escape(str(path)) + ".* is damaged"):
        _ = copied_run.individuals


def test_a_damaged_configuration_is_named(copied_run):
    path = copied_run.path / "config.toml"
    path.write_text(path.read_text().replace("[gp]", "[gp"))
    with pytest.raises(InputError, match=re.escape(f"{path} is not valid TOML")):
        open_run(copied_run.path)


def test_a_run_does_not_go_on_with_other_settings_than_it_began_with(killed_run, go_on):
    killed = killed_run(9)
    path = killed.path / "config.toml"
    path.write_text(path.read_text().replace("tournament = 2", "tournament = 3"))
    with pytest.raises(InputError, match=r"its settings are not those of config\.toml"):
        go_on(open_run(killed.path))


@pytest.mark.parametrize("content", [b"generation,robot\nx,r0\n", b"\xff\xfe\x00"], ids=["text", "binary"])
def test_a_damaged_table_is_named_when_a_run_goes_on(content, killed_run, go_on):
    killed = killed_run(9)
    (killed.path / "generations.csv").write_bytes(content)
    try:
        go_on(killed)
    except InputError as error:
        assert str(killed.path / "generations.csv") in str(error)  # noqa: PT017 - mending it would be right, too


def test_a_lost_table_is_told_or_made_again(killed_run, go_on, small_run, results_of):
    killed = killed_run(9)
    (killed.path / "generations.csv").unlink()
    try:
        go_on(killed)
    except InputError:
        return
    assert results_of(killed.path) == results_of(small_run.path)


def test_a_folder_with_a_run_is_refused(copied_run, small_settings):
    with pytest.raises(InputError, match=f"{copied_run.path} holds a run already; go on with 'coevo resume"):
        create_run(copied_run.path, small_settings())


def test_a_folder_with_anything_else_is_refused_and_left_alone(small_settings, tmp_path):
    (tmp_path / "diary.txt").write_text("mine")
    with pytest.raises(InputError, match="is not an empty folder; choose another --out"):
        create_run(tmp_path, small_settings())
    assert [path.name for path in tmp_path.iterdir()] == ["diary.txt"]


def test_an_empty_folder_is_taken(small_settings, tmp_path):
    (tmp_path / "empty").mkdir()
    run = create_run(tmp_path / "empty", small_settings())
    assert open_run(run.path).config == run.config


def test_a_missing_skill_leaves_nothing_behind(small_settings, tmp_path):
    with pytest.raises(InputError, match="there is no skill file"):
        create_run(tmp_path / "run", small_settings(f"skills.shoot='{tmp_path}/none.npz'"))
    assert not (tmp_path / "run").exists()


def test_a_run_is_written_by_one_at_a_time(copied_run):
    release = copied_run.lock()
    with pytest.raises(InputError, match="is being written by another coevo process; wait for it or stop it"):
        Run(copied_run.path, copied_run.config).lock()
    release()
    Run(copied_run.path, copied_run.config).lock()()


AGAIN = "give the same command again; after 'coevo evolve', 'coevo resume'"


@pytest.mark.parametrize("keeping", [False, True])
@pytest.mark.parametrize("where", ["folder", "lock", "file"])
def test_a_result_that_cannot_be_kept_is_found_by_the_same_command_again(where, keeping, copied_run, monkeypatch):
    """The run is finished, and who asks is settlements, baselines or a tournament."""
    run, results = open_run(copied_run.path), copied_run.path / "results"
    monkeypatch.setattr("coevo.folder._PATIENCE_S", 0.1)  # nobody else lets go of what is in the way
    shutil.rmtree(results, ignore_errors=True)
    if where == "folder":
        results.write_text("in the way")
    elif where == "lock":
        (results / ".lock").mkdir(parents=True)
    else:

        def full(_):
            raise OSError(errno.ENOSPC, "No space left on device")

        results.mkdir()
        monkeypatch.setattr("coevo.files.os.fsync", full)
    with pytest.raises(InputError) as caught, run.keeping_results() if keeping else nullcontext():
        run.save_result("found", {"values": np.arange(3)})
    assert str(caught.value).startswith(f"cannot write {results}")
    assert str(caught.value).endswith(f"What was saved before is intact; mend this and {AGAIN}")


def test_the_environment_names_versions_and_skills(small_run):
    about = json.loads((small_run.path / "environment.json").read_text())
    assert set(about) >= {"python", "platform", "versions", "commit", "skills"}
    assert about["versions"]["numpy"] == np.__version__
    assert set(about["skills"]) == {"shoot", "pass", "avoid", "search"}
    for digest in about["skills"].values():
        assert len(bytes.fromhex(digest)) == hashlib.sha256().digest_size


def test_open_run_gives_what_was_written(small_run, small_settings):
    run = open_run(str(small_run.path))
    assert run.config == small_settings()
    assert run.finished == 3
    pd.testing.assert_frame_equal(run.generations, pd.read_csv(run.path / "generations.csv"))
    pd.testing.assert_frame_equal(run.individuals, pd.read_parquet(run.path / "individuals.parquet"))


def test_trees_are_ranked_by_fitness_then_depth_then_place(small_run):
    table = small_run.individuals
    for generation, robot in itertools.product(range(3), ("r0", "r1", "r2")):
        rows = table[(table.generation == generation) & (table.robot == robot)]
        ranked = sorted(rows.itertuples(), key=lambda row: (row.fitness, row.depth, row.index))
        functions = function_set(int(robot[1:]), 3)
        for rank, row in enumerate(ranked):
            tree = small_run.tree(robot, generation, rank)
            assert isinstance(tree, Tree)
            assert tree == from_codes(row.tree, functions)
        assert small_run.tree(robot, generation) == small_run.tree(robot, generation, rank=0)


@pytest.mark.parametrize(
    ("robot", "generation", "rank", "message"),
    [
        ("r3", 0, 0, "'r3' does not evolve in this run; choose one of r0, r1, r2"),
        ("ball", 0, 0, "'ball' does not evolve in this run; choose one of r0, r1, r2"),
        ("r0", 3, 0, "has no generation 3; finished generations: 0 to 2"),
        ("r0", -1, 0, "has no generation -1; finished generations: 0 to 2"),
        ("r0", 0, 6, "rank must be from 0 to 5, got 6"),
        ("r0", 0, -1, "rank must be from 0 to 5, got -1"),
    ],
)
def test_a_tree_that_is_not_there_is_told_with_what_is(robot, generation, rank, message, small_run):
    with pytest.raises(InputError, match=re.escape(message)):
        small_run.tree(robot, generation, rank)


def test_a_robot_that_stands_has_no_trees(small_settings, go_on, tmp_path):
    run = go_on(create_run(tmp_path / "run", small_settings("gp.generations=1", preset="stationary-opponent")))
    with pytest.raises(InputError, match="'r2' does not evolve in this run; choose one of r0, r1"):
        run.tree("r2", 0)


def test_a_run_without_a_generation_is_empty(small_settings, tmp_path):
    run = create_run(tmp_path / "run", small_settings())
    assert (run.finished, run.is_finished, len(run.individuals), len(run.generations)) == (0, False, 0, 0)
    assert list(run.generations)[:2] == ["generation", "robot"]
    with pytest.raises(InputError, match="has no generation 0; finished generations: none yet"):
        run.tree("r0", 0)


@pytest.mark.parametrize("name", ["nowhere", "."])
def test_what_is_no_run_is_told_how_to_start_one(name, tmp_path):
    with pytest.raises(InputError, match="start a run with 'coevo evolve'") as caught:
        open_run(tmp_path / name)
    assert str(tmp_path) in str(caught.value)
