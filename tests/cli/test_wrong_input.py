"""What is wrong is told in one or two plain lines, with the remedy, and nothing is spoilt."""

from __future__ import annotations

import errno
import gc
import io
import shutil
import sys
from contextlib import redirect_stderr, redirect_stdout

import pytest

from coevo.cli import main
from coevo.errors import InputError
from coevo.run import open_run
from coevo.skill import load_skill, skill_path

LONG = "a" * 300  # longer than names of files may be


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
def test_wrong_input_is_told_with_the_remedy(arguments, parts, coevo, tmp_path, monkeypatch, refused):
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
def test_what_a_run_does_not_have_is_told(arguments, parts, coevo, small_run, tmp_path, monkeypatch, refused):
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
def test_a_wrong_recipe_is_named(content, parts, coevo, tmp_path, refused):
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
def test_a_damaged_skill_is_named(damage, coevo, tmp_path, refused):
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


def test_a_folder_with_a_run_is_refused(coevo, copied_run, results_of, refused):
    before = results_of(copied_run)
    refused(coevo("evolve", "smoke", "--out", copied_run), "holds a run already", f"coevo resume {copied_run}")
    assert results_of(copied_run) == before


def test_a_folder_that_cannot_be_written_is_named(coevo, tmp_path, refused):
    (tmp_path / "file").touch()
    said = coevo("evolve", "smoke", "--out", tmp_path / "file" / "run")
    refused(said, str(tmp_path / "file" / "run"), "Not a directory", "--out")


def test_starts_that_do_not_fit_leave_nothing_behind(coevo, small_recipe, tmp_path, refused):
    same = "start={ x_m = [5.0, 5.0], y_m = [1.0, 1.0] }"
    arguments = ["--set", f"players.0.{same}", "--set", f"players.1.{same}", "--quiet"]
    said = coevo("evolve", small_recipe, "--out", tmp_path / "run", *arguments)
    refused(said, "do not fit into their start regions", "widen game.ball_start or players.*.start")
    assert not (tmp_path / "run").exists()


def test_a_run_that_is_being_written_is_refused(coevo, copied_run, refused, cut_short):
    cut_short(copied_run, 1)
    release = open_run(copied_run).lock()
    refused(coevo("resume", copied_run), "is being written by another coevo process; wait for it or stop it")
    release()


@pytest.mark.usefixtures("collected")
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # numpy leaves what it refuses open
def test_a_damaged_checkpoint_is_named(coevo, copied_run, refused, cut_short):
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


@pytest.mark.parametrize(
    "command", [["settlements"], ["baselines"], ["tournament", "--every", "2"]], ids=lambda command: command[0]
)
def test_a_command_that_cannot_keep_what_it_found_does_not_send_to_another(command, coevo, copied_run, refused):
    shutil.rmtree(copied_run / "results", ignore_errors=True)
    (copied_run / "results").write_text("in the way")
    name, *options = command
    told = "mend this and give the same command again; after 'coevo evolve', 'coevo resume'"
    refused(coevo(name, copied_run, "--games", "2", *options), f"cannot write {copied_run / 'results'}", told)
