"""The command line as people and programs meet it: exit codes, messages, JSON, files, signals."""

from __future__ import annotations

import errno
import gc
import io
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import numpy as np
import pandas as pd
import pytest

from coevo.cli import main
from coevo.errors import InputError
from coevo.evolution.evaluation import group_seeds
from coevo.game import Arena, function_set
from coevo.portrait import portrait
from coevo.replay import trace_digest
from coevo.run import create_run, open_run
from coevo.skill import load_skill, skill_path
from coevo.tree import compile_program, parse, simplify, tree_codes
from coevo.tree.fold import fold_tree
from coevo.usage import play_seeds, used_tree

LONG = "a" * 300  # longer than names of files may be
# What `coevo` runs; with the signal as it is at a terminal, even if these tests run in the background.
PROGRAM = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from coevo.cli import main; main()"
# Long enough to be interrupted: some seconds.
LASTING = ("gp.generations=70", "gp.population=8", "evaluation.games=3")


@pytest.fixture
def small_recipe(small_settings, tmp_path):
    """Return the path of the small experiment as a recipe."""
    path = tmp_path / "small.toml"
    create_run(tmp_path / "made", small_settings())
    shutil.move(tmp_path / "made" / "config.toml", path)
    return path


def cut_short(run, generations):
    """Make a finished run look as if it had been killed after some generations."""
    for path in sorted((run / "individuals.parquet").iterdir())[generations:]:
        path.unlink()
    (run / "checkpoint.npz").unlink()


def refused(said, *parts):
    """Check that wrong input is told in one or two plain lines, and return them."""
    assert said.code == 2, said.err
    assert said.out == ""
    assert "Traceback" not in said.err
    _, mark, message = f"\n{said.err}".rpartition("\ncoevo: ")
    assert mark, said.err
    assert len(message.strip().split("\n")) <= 2, message
    for part in parts:
        assert part in message
    return message


# ---------------------------------------------------------------------------------------------------- wrong input


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        pytest.param(["evlove", "smoke"], ["no command 'evlove'. Did you mean 'evolve'?", "resume"], id="command"),
        pytest.param(["fly"], ["no command 'fly'", "Commands: ", "inspect"], id="nothing near"),
        pytest.param(["evolve"], ["Missing argument 'RECIPE'", "coevo evolve --help"], id="no recipe"),
        pytest.param(["evolve", "smoke", "three-learners"], ["unexpected extra argument (three-learners)"], id="two"),
        pytest.param(["evolve", "smok"], ["there is no recipe 'smok'. Did you mean 'smoke'?", ".toml"], id="preset"),
        pytest.param(["evolve", "three_learners"], ["Did you mean 'three-learners'?"], id="preset with _"),
        pytest.param(["evolve", "smoke", "--sed", "3"], ["'--sed'", "--seed"], id="option"),
        pytest.param(["evolve", "smoke", "--seed", "-1"], ["'--seed'", "-1 is not in the range"], id="seed below 0"),
        pytest.param(["evolve", "smoke", "--seed", "x"], ["'--seed'", "'x' is not a valid integer"], id="seed x"),
        pytest.param(["evolve", "smoke", "--generations", "0"], ["'--generations'", "range x>=1"], id="generations"),
        pytest.param(["evolve", "smoke", "--workers", "0"], ["'--workers'", "range x>=1"], id="workers"),
        pytest.param(["evolve", "smoke", "--backend", "mpi"], ["'--backend'", "'threads', 'processes'"], id="backend"),
        pytest.param(
            ["evolve", "smoke", "--set", "gp.populatoin=4"],
            ["the recipe smoke: unknown setting 'gp.populatoin'. Did you mean 'population'?"],
            id="unknown setting",
        ),
        pytest.param(
            ["evolve", "smoke", "--set", "gp.population=1"],
            ["the recipe smoke: gp.population: expected int >= 2, got 1"],
            id="setting out of range",
        ),
        pytest.param(
            ["evolve", "smoke", "--set", "fitness.kind=vary"],
            ["fitness: kind must be 'fixed', 'varying' or module:function of your own, got 'vary'"],
            id="wrong choice",
        ),
        pytest.param(
            ["evolve", "smoke", "--set", "fitness.kind=absent:f"],
            ["fitness.kind: there is no module 'absent' in "],
            id="no fitness",
        ),
        pytest.param(
            ["evolve", "smoke", "--set", "game.kind=absent:f", "--set", "fitness.kind=absent:f"],
            ["the recipe smoke: unknown setting 'players'"],
            id="another game with players",
        ),
        pytest.param(
            ["evolve", "smoke", "--set", "conditions.near={objects=['ball'], expression='area > 9'}"],
            ["conditions.near: cannot read 'area > 9'", "write '>='"],
            id="unreadable condition",
        ),
        pytest.param(
            ["evolve", "smoke", "--set", "world.robot.max_speed_mps=2.5"],
            ["'shoot' was learned for a world with robot.max_speed_mps 1.0, here it is 2.5", "skills_elsewhere"],
            id="skills of another world",
        ),
        pytest.param(["evolve", "smoke", "--set", "gp.population"], ["--set expects KEY=VALUE"], id="no value"),
        pytest.param(
            ["evolve", "none.toml"], ["cannot read none.toml: No such file or directory"], id="no recipe file"
        ),
        pytest.param(["evolve", f"{LONG}.toml"], ["cannot read aaaaaaaa", "File name too long"], id="long recipe"),
        pytest.param(
            ["evolve", "smoke", "--set", "skills.shoot=shot"],
            ["no installed skill 'shot'. Did you mean 'shoot'?", "Installed: shoot, pass, avoid, search"],
            id="unknown skill",
        ),
        pytest.param(
            ["evolve", "smoke", "--set", "skills.shoot=none.npz"],
            ["there is no skill file none.npz"],
            id="no skill file",
        ),
        pytest.param(
            ["evolve", "smoke", "--set", "world.robot.drive=4ws"],
            ["learned for the drive pws with 9 actions, this drive is 4ws with 7", "'coevo learn shoot --drive 4ws'"],
            id="skills of another drive",
        ),
        pytest.param(["resume", "nowhere"], ["nowhere does not exist; start a run with 'coevo evolve'"], id="resume"),
        pytest.param(["inspect", "nowhere"], ["nowhere does not exist; start a run with 'coevo evolve'"], id="inspect"),
        pytest.param(["play", "nowhere"], ["nowhere does not exist; start a run with 'coevo evolve'"], id="play"),
        pytest.param(["inspect", "."], [". is not a run folder (it has no config.toml)"], id="no run folder"),
        *(
            pytest.param(
                arguments,
                ["aaaaaaaa", "File name too long"],
                id=f"long name, {arguments[0]}",
            )
            for arguments in (["evolve", "smoke", "--out", LONG], ["resume", LONG], ["inspect", LONG], ["play", LONG])
        ),
        pytest.param(
            ["evolve", "smoke", "--set", 'name="a\\u0000b"'],
            ["name"],
            id="a name that no folder can have",
        ),
        pytest.param(
            ["evolve", "smoke", "--set", f"seed={'9' * 5000}"],
            ["seed"],
            id="a number of 5000 digits",
        ),
    ],
)
def test_wrong_input_is_told_with_the_remedy(arguments, parts, coevo, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused(coevo(*arguments), *parts)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        pytest.param(["inspect", "--robot", "r9"], ["'r9' does not evolve in this run; choose one of r0, r1"], id="r9"),
        pytest.param(["inspect", "--robot", "ball"], ["'ball' does not evolve in this run"], id="ball"),
        pytest.param(["inspect", "--generation", "3"], ["no generation 3; finished generations: 0 to 2"], id="late"),
        pytest.param(["inspect", "--generation", "-1"], ["'--generation'", "range x>=0"], id="before the first"),
        pytest.param(["inspect", "--rank", "6"], ["rank must be from 0 to 5, got 6"], id="rank"),
        pytest.param(["inspect", "--format", "pdf"], ["'text', 'json', 'dot', 'svg'"], id="format"),
        pytest.param(["play", "--generation", "3"], ["no generation 3; finished generations: 0 to 2"], id="play late"),
        pytest.param(["play", "--games", "0"], ["'--games'", "range x>=1"], id="no games"),
        pytest.param(
            ["play", "--games", "1", "--trace", "no/t.csv"], ["cannot write no/t.csv", "no folder no"], id="no/"
        ),
        pytest.param(
            ["play", "--games", "1", "--trace", "."],
            ["cannot write ."],
            id="trace to a folder",
        ),
        pytest.param(
            ["play", "--games", "1", "--video", "game.avi"], ["ending in .mp4, .gif, .html, got game.avi"], id="video"
        ),
        pytest.param(
            ["play", "--games", "1", "--trace", f"{LONG}.csv"],
            ["cannot write aaaa", "File name too long"],
            id="long trace",
        ),
    ],
)
def test_what_a_run_does_not_have_is_told(arguments, parts, coevo, small_run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command, *options = arguments
    refused(coevo(command, small_run.path, *options), *parts)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        pytest.param("[gp\npopulation = 3", ["mine.toml is not valid TOML", "line 1"], id="broken"),
        pytest.param("name = 'x'", ["mine.toml: ", "game"], id="nothing in it"),
        pytest.param("[gp]\npopulatoin = 3", ["mine.toml: unknown setting 'gp.populatoin'"], id="unknown"),
    ],
)
def test_a_wrong_recipe_is_named(content, parts, coevo, tmp_path):
    (tmp_path / "mine.toml").write_text(content)
    refused(coevo("evolve", tmp_path / "mine.toml", "--out", tmp_path / "run"), *parts)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(lambda _: b"", id="empty"),
        pytest.param(lambda _: b"my skill\n" * 20, id="text"),
        pytest.param(lambda data: data[: len(data) // 2], id="cut in half"),
    ],
)
@pytest.mark.usefixtures("collected")
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # numpy leaves what it refuses open
def test_a_damaged_skill_is_named(damage, coevo, tmp_path):
    path = tmp_path / "mine.npz"
    path.write_bytes(damage(skill_path("shoot").read_bytes()))
    said = coevo("evolve", "smoke", "--out", tmp_path / "run", "--set", f"skills.shoot={path}")
    refused(said, f"{path} is not a skill file or is damaged", "learn it again with 'coevo learn'")
    assert not (tmp_path / "run").exists()


@pytest.mark.usefixtures("collected")
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # numpy leaves what it refuses open
def test_a_flipped_byte_of_a_skill_is_noticed_wherever_it_is(tmp_path):
    path = tmp_path / "mine.npz"
    data = skill_path("search").read_bytes()
    path.write_bytes(data)
    right, wrong = load_skill(path).digest, []
    for position in [*range(0, len(data), max(1, len(data) // 400)), *range(60)]:
        path.write_bytes(data[:position] + bytes([data[position] ^ 0x01]) + data[position + 1 :])
        try:
            found = load_skill(path).digest
        except InputError as error:
            if str(path) not in str(error):
                wrong.append(f"{position}: {error}")
        except Exception as error:  # noqa: BLE001 - which it is, is what is tested
            wrong.append(f"{position}: {type(error).__name__}: {error}")
        else:
            if found != right:
                wrong.append(f"{position}: another skill")
    gc.collect()
    assert wrong == []


def test_a_folder_with_a_run_is_refused(coevo, copied_run, results_of):
    before = results_of(copied_run)
    refused(coevo("evolve", "smoke", "--out", copied_run), "holds a run already", f"coevo resume {copied_run}")
    assert results_of(copied_run) == before


def test_a_folder_that_cannot_be_written_is_named(coevo, tmp_path):
    (tmp_path / "file").touch()
    said = coevo("evolve", "smoke", "--out", tmp_path / "file" / "run")
    refused(said, str(tmp_path / "file" / "run"), "Not a directory", "--out")


def test_starts_that_do_not_fit_leave_nothing_behind(coevo, small_recipe, tmp_path):
    same = "start={ x_m = [5.0, 5.0], y_m = [1.0, 1.0] }"
    arguments = ["--set", f"players.0.{same}", "--set", f"players.1.{same}", "--quiet"]
    said = coevo("evolve", small_recipe, "--out", tmp_path / "run", *arguments)
    refused(said, "do not fit into their start regions", "widen game.ball_start or players.*.start")
    assert not (tmp_path / "run").exists()


def test_a_run_that_is_being_written_is_refused(coevo, copied_run):
    cut_short(copied_run, 1)
    release = open_run(copied_run).lock()
    refused(coevo("resume", copied_run), "is being written by another coevo process; wait for it or stop it")
    release()


@pytest.mark.usefixtures("collected")
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # numpy leaves what it refuses open
def test_a_damaged_checkpoint_is_named(coevo, copied_run):
    cut_short(copied_run, 1)
    path = copied_run / "checkpoint.npz"
    path.write_bytes(b"PK\x03\x04")
    refused(coevo("resume", copied_run, "--quiet"), f"{path} is damaged", "delete it and resume again")


def test_a_full_disk_is_told_without_a_traceback(coevo, small_recipe, small_run, results_of, tmp_path, monkeypatch):
    def full(_):
        if (tmp_path / "run" / "individuals.parquet" / "part-00000.parquet").exists():
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("coevo.files.os.fsync", full)
    said = coevo("evolve", small_recipe, "--out", tmp_path / "run")
    assert said.code in {1, 2}
    assert "Traceback" not in said.err
    assert "No space left on device" in said.err
    assert "go on with 'coevo resume'" in said.err
    monkeypatch.undo()
    monkeypatch.setattr(sys, "argv", ["coevo", "resume", str(tmp_path / "run")])
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        main()
    assert results_of(tmp_path / "run") == results_of(small_run.path)


# ----------------------------------------------------------------------------------------------------------- help


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


# ----------------------------------------------------------------------------------------------------------- JSON


def one_object(said):
    """Return the one JSON object on standard output."""
    assert said.code == 0, said.err
    data = json.loads(said.out)
    assert isinstance(data, dict)
    return data


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


def test_evolve_prints_one_object_and_progress_elsewhere(coevo, small_recipe, small_run, results_of, tmp_path):
    said = coevo("evolve", small_recipe, "--out", tmp_path / "run", "--json")
    check_summary(one_object(said), open_run(tmp_path / "run"))
    lines = [line for line in said.err.splitlines() if line.startswith("generation ")]
    assert [line.split()[1] for line in lines] == ["1/3", "2/3", "3/3"]  # one plain line a step
    assert "\x1b" not in said.err
    assert results_of(tmp_path / "run") == results_of(small_run.path)


def test_quiet_commands_say_nothing_on_the_way(coevo, small_recipe, tmp_path):
    said = coevo("evolve", small_recipe, "--out", tmp_path / "run", "--json", "--quiet")
    assert one_object(said)["run"]
    assert said.err == ""
    for arguments in (["inspect"], ["play", "--games", "2"], ["resume"]):
        said = coevo(arguments[0], tmp_path / "run", *arguments[1:], "--quiet")
        assert (said.code, said.err) == (0, "")


def test_options_replace_what_the_recipe_says(coevo, small_recipe, tmp_path):
    arguments = ["--seed", "9", "--generations", "2", "--set", "gp.elite=2", "--set", "seed=4", "--workers", "2"]
    data = one_object(coevo("evolve", small_recipe, "--out", tmp_path / "run", "--json", *arguments))
    assert (data["seed"], data["generations"]) == (9, 2)
    config = open_run(tmp_path / "run").config
    assert (config.seed, config.gp.generations, config.gp.elite) == (9, 2, 2)


def test_runs_go_to_the_first_free_folder_by_default(coevo, small_recipe, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folders = [
        one_object(coevo("evolve", small_recipe, "--generations", "1", "--json", "--quiet"))["run"] for _ in range(3)
    ]
    assert folders == ["runs/smoke-seed0", "runs/smoke-seed0-2", "runs/smoke-seed0-3"]
    assert all(open_run(folder).is_finished for folder in folders)


def test_resume_goes_on_and_prints_what_evolve_does(coevo, copied_run, small_run, results_of):
    cut_short(copied_run, 1)
    said = coevo("resume", copied_run, "--json")
    check_summary(one_object(said), open_run(copied_run))
    assert "Going on at generation 1 of 3" in said.err
    assert results_of(copied_run) == results_of(small_run.path)


def test_a_finished_run_says_so(coevo, copied_run, results_of):
    before = results_of(copied_run)
    said = coevo("resume", copied_run, "--json")
    check_summary(one_object(said), open_run(copied_run))
    assert "is finished: all 3 generations are there" in said.err
    assert results_of(copied_run) == before


@pytest.mark.parametrize(("robot", "generation", "rank"), [("r0", 2, 0), ("r1", 0, 3), ("r2", 1, 5)])
def test_inspect_tells_what_the_run_holds(robot, generation, rank, coevo, small_run):
    arguments = ["--robot", robot, "--generation", generation, "--rank", rank]
    data = one_object(coevo("inspect", small_run.path, *arguments, "--json"))
    tree, row = small_run.tree(robot, generation, rank), small_run.record(generation, robot).iloc[rank]
    smaller = simplify(tree)
    expected = {
        "robot": robot,
        "generation": generation,
        "rank": rank,
        "tree": str(tree),
        "depth": tree.depth,
        "nodes": tree.nodes,
        "fitness": row["fitness"],
        "simplified": {"tree": str(smaller), "depth": smaller.depth, "nodes": smaller.nodes},
    }
    assert {name: data[name] for name in expected} == expected
    assert parse(data["tree"]) == tree
    assert set(data["skill_use"]) == {"shoot", "pass", "avoid", "search"}
    assert sum(data["skill_use"].values()) == pytest.approx(1.0)
    assert data["steps"] == row["steps"]  # its games are played again


def test_skills_are_used_as_often_as_the_leaves_are_passed(coevo, small_run):
    data = one_object(coevo("inspect", small_run.path, "--json"))
    tree = parse(data["tree"])
    for skill, share in data["skill_use"].items():
        passed = sum(steps for name, steps in zip(tree.names, data["node_steps"], strict=True) if name == skill)
        assert share == pytest.approx(passed / data["steps"])
    for node, second in enumerate(tree.second):
        if second:
            assert data["node_steps"][node] == data["node_steps"][node + 1] + data["node_steps"][second]


def test_inspect_shows_the_best_of_the_last_generation_by_default(coevo, small_run):
    data = one_object(coevo("inspect", small_run.path, "--format", "json"))
    assert (data["robot"], data["generation"], data["rank"]) == ("r0", 2, 0)


@pytest.mark.parametrize("simplified", [False, True])
def test_inspect_draws_every_node_if_told_to(simplified, coevo, small_run):
    tree = small_run.tree("r1", 2)
    shown = simplify(tree) if simplified else tree
    arguments = ["--robot", "r1", "--all", *(["--simplified"] if simplified else [])]
    text = coevo("inspect", small_run.path, *arguments).out
    assert f"the tree: depth {tree.depth}, nodes {tree.nodes}" in text
    lines = text.partition("simplified: depth")[2]
    assert len(re.findall(r"^ *[<>]?[\d.]+%  ", lines, re.MULTILINE)) == shown.nodes
    dot = coevo("inspect", small_run.path, *arguments, "--format", "dot").out
    assert dot.startswith("digraph")
    assert len(re.findall(r"^  n\d+ \[", dot, re.MULTILINE)) == shown.nodes
    assert len(boxes_of(coevo("inspect", small_run.path, *arguments, "--format", "svg").out)) == shown.nodes


def boxes_of(svg):
    """Return the kinds of the boxes in a picture."""
    rects = ET.fromstring(svg).iter("{http://www.w3.org/2000/svg}rect")  # noqa: S314 - our own
    return [rect.get("class") for rect in rects if rect.get("class") != "paper"]


def test_inspect_folds_what_was_hardly_used(coevo, small_run):
    arguments = ["inspect", small_run.path, "--robot", "r1", "--generation", 0, "--rank", 1, "--format", "svg"]
    whole, usual, most = (boxes_of(coevo(*arguments, *more).out) for more in (["--all"], [], ["--fold", "0.9"]))
    used = used_tree(small_run, "r1", 0, 1)
    for share, boxes in ((None, whole), (0.005, usual), (0.9, most)):
        assert boxes.count("question") == sum(
            part.kind == "question" for part in fold_tree(used.tree, used.usage.node_steps, share)
        )
    assert len(whole) > len(usual) >= len(most)
    refused(coevo("inspect", small_run.path, "--all", "--fold", "0.1"), "--all folds nothing")


def test_inspect_begins_with_what_the_robot_does(coevo, small_run):
    used = used_tree(small_run, "r2")
    text = coevo("inspect", small_run.path, "--robot", "r2").out
    head, said = text.split("\n\n", 1)
    assert head == f"r2, generation 2, rank 0: fitness {used.fitness:.4f}"
    assert said.startswith("r2 plays ")
    assert portrait(used, f"coevo play {small_run.path} --generation 2 --games 1000") in said
    (best,) = [name for name, share in used.usage.skill_use.items() if share == max(used.usage.skill_use.values())]
    assert f"\n{best} {used.usage.skill_use[best]:.1%}: " in said  # what the skill does, from its card


def test_rules_of_inspect_say_how_each_terminal_was_used(coevo, small_run):
    data = one_object(coevo("inspect", small_run.path, "--robot", "r1", "--generation", 0, "--json"))
    for rules in (data["rules"], data["rules_in_use"]):
        assert {frozenset(rule) for rule in rules} == {frozenset({"when", "terminal", "share"})}
        for name, share in data["skill_use"].items():
            assert sum(rule["share"] for rule in rules if rule["terminal"] == name) == pytest.approx(share)
    assert len(data["rules"]) == (data["simplified"]["nodes"] + 1) // 2
    assert all(rule["share"] > 0.0 for rule in data["rules_in_use"])
    assert data["never_used"] == data["node_steps"].count(0)
    rows = small_run.record(0, "r1")["fitness"]
    assert data["generation_fitness"] == pytest.approx(
        {"individuals": 6, "best": rows.min(), "mean": rows.mean(), "worst": rows.max()}
    )
    assert set(data["descriptions"]) == {"shoot", "pass", "avoid", "search"}


# --------------------------------------------------------------------------------------------------------- games


def best_programs(run, generation):
    robots = len(run.config.players)
    functions = [function_set(robot, robots) for robot in range(robots)]
    trees = [run.tree(f"r{robot}", generation) for robot in range(robots)]
    return [compile_program(tree_codes(tree, of), of) for tree, of in zip(trees, functions, strict=True)]


def test_play_tells_what_happened_in_games_of_the_best(coevo, small_run):
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


def test_the_digest_is_that_of_the_games_and_of_nothing_else(coevo, small_run):
    def digest(*arguments):
        return one_object(coevo("play", small_run.path, "--json", "--games", "3", *arguments))["digest"]

    assert digest() == digest("--generation", "2") == digest("--seed", "1")
    assert len({digest(), digest("--seed", "2"), digest("--games", "4")}) == 3


def test_games_of_play_are_never_those_of_evolution():
    evolution = {int(seed) for g in range(5) for group in range(20) for seed in group_seeds(1, g, group, 20)}
    assert evolution.isdisjoint(int(seed) for seed in play_seeds(1, 5000))


def test_a_trace_has_a_row_for_each_game_step_and_body(coevo, small_run, tmp_path):
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


# ------------------------------------------------------------------------------------------------- real processes


@pytest.fixture(scope="module")
def lasting(small_settings, go_on, tmp_path_factory):
    """Return a recipe of some seconds, and its finished run."""
    folder = tmp_path_factory.mktemp("lasting")
    run = go_on(create_run(folder / "whole", small_settings(*LASTING)))
    return Path(shutil.copy(run.path / "config.toml", folder / "lasting.toml")), run


@pytest.fixture
def start():
    """Return a function that starts a command in a process of its own; what still lives in the end is killed."""
    started = []

    def begin(*arguments):
        command = [sys.executable, "-c", PROGRAM, *map(str, arguments)]
        process = subprocess.Popen(  # noqa: S603 - our own
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        started.append(process)
        return process

    yield begin
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


def wait_for_generation(process, number):
    for line in process.stderr:
        if re.match(rf"generation +{number}/", line):
            return
    pytest.fail(f"generation {number} never came")


def test_the_installed_script_is_the_same_program(tmp_path):
    script = Path(sys.executable).with_name("coevo")
    done = subprocess.run(  # noqa: S603 - our own
        [script, "evolve", "smok"], capture_output=True, text=True, cwd=tmp_path, check=False
    )
    refused(SimpleNamespace(code=done.returncode, out=done.stdout, err=done.stderr), "Did you mean 'smoke'?")


@pytest.mark.parametrize(
    "backend",
    [
        pytest.param(
            "threads",
        ),
        "processes",
    ],
)
@pytest.mark.slow
def test_ctrl_c_saves_and_says_how_to_go_on(backend, lasting, start, results_of, tmp_path):
    recipe, whole = lasting
    folder = tmp_path / "run"
    process = start("evolve", recipe, "--out", folder, "--workers", "2", "--backend", backend)
    wait_for_generation(process, 4)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers, too
    out, err = process.communicate(timeout=300)
    assert process.returncode == 130
    assert out == ""
    assert "Traceback" not in err
    saved = open_run(folder).finished
    assert 4 <= saved < 70
    assert f"Stopped; {saved} of 70 generations are saved. Go on with: coevo resume {folder}" in err
    assert err.rstrip().endswith("coevo: stopped")
    resumed = start("resume", folder, "--quiet", "--json")
    out, err = resumed.communicate(timeout=300)
    assert (resumed.returncode, err) == (0, "")
    assert json.loads(out)["generations"] == 70
    assert results_of(folder) == results_of(whole.path)


def kill_and_resume(lasting, start, folder, kills, seed):
    """Kill a run at random moments of its life, over and over, and bring it to its end; return how far it was."""
    recipe, whole = lasting
    random_moment = random.Random(seed)
    process, saved = start("evolve", recipe, "--out", folder, "--quiet"), []
    while not (folder / "config.toml").exists():
        time.sleep(0.01)
    for _ in range(kills):
        time.sleep(random_moment.uniform(0.5, 1.6))
        process.kill()
        process.communicate()
        saved.append(open_run(folder).finished)
        process = start("resume", folder, "--quiet", "--json")
    out, err = process.communicate(timeout=300)
    assert (process.returncode, err) == (0, "")
    assert json.loads(out)["generations"] == whole.config.gp.generations
    return saved


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 99])
def test_a_run_killed_at_random_moments_goes_on_to_the_same_bytes(seed, lasting, start, results_of, tmp_path):
    saved = kill_and_resume(lasting, start, tmp_path / "run", kills=8, seed=seed)
    assert all(before <= after for before, after in pairwise(saved))
    assert results_of(tmp_path / "run") == results_of(lasting[1].path)


def test_two_processes_do_not_write_into_one_run(lasting, start, coevo, tmp_path):
    process = start("evolve", lasting[0], "--out", tmp_path / "run")
    wait_for_generation(process, 2)
    refused(coevo("resume", tmp_path / "run"), "is being written by another coevo process")
    process.kill()
    process.communicate()
    open_run(tmp_path / "run").lock()()  # a lock dies with its process


def test_a_reader_that_goes_away_gets_no_traceback(small_run):
    command = [sys.executable, "-c", PROGRAM, "inspect", str(small_run.path), "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # noqa: S603
    process.stdout.close()
    err = process.stderr.read()
    process.stderr.close()
    assert process.wait(timeout=300) == 1
    assert "Traceback" not in err
    assert "Exception ignored" not in err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_output_that_cannot_be_written_is_told_without_a_traceback(small_run):
    command = [sys.executable, "-c", PROGRAM, "inspect", str(small_run.path), "--json"]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)  # noqa: S603
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert "No space left on device" in done.stderr


def test_numbers_of_a_run_are_those_of_another_process(lasting, start):
    """Machine code from the cache, or compiled here, gives the same games."""
    process = start("play", lasting[1].path, "--games", "4", "--json", "--quiet")
    out, _ = process.communicate(timeout=300)
    arena, programs = Arena(lasting[1].config), best_programs(lasting[1], 69)
    assert json.loads(out)["digest"] == trace_digest([arena.trace(programs, seed)[1] for seed in play_seeds(1, 4)])
    assert np.isfinite(lasting[1].generations["fitness_mean"]).all()
