"""Commands as processes of their own: signals, pipes, and kills at any moment."""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from coevo.game import Arena
from coevo.replay import trace_digest
from coevo.run import create_run, open_run
from coevo.usage import play_seeds

# What `coevo` runs; with the signal as it is at a terminal, even if these tests run in the background.
PROGRAM = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from coevo.cli import main; main()"
# Long enough to be interrupted: some seconds.
LASTING = ("gp.generations=70", "gp.population=8", "evaluation.games=3")


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


def test_the_installed_script_is_the_same_program(tmp_path, refused):
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


@pytest.mark.slow
def test_two_processes_do_not_write_into_one_run(lasting, start, coevo, tmp_path, refused):
    process = start("evolve", lasting[0], "--out", tmp_path / "run")
    wait_for_generation(process, 2)
    refused(coevo("resume", tmp_path / "run"), "is being written by another coevo process")
    process.kill()
    process.communicate()
    open_run(tmp_path / "run").lock()()  # a lock dies with its process


def test_a_reader_that_goes_away_gets_no_traceback():
    command = [sys.executable, "-c", PROGRAM, "skills", "--json"]  # what starts soonest
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # noqa: S603
    process.stdout.close()
    err = process.stderr.read()
    process.stderr.close()
    assert process.wait(timeout=300) == 1
    assert "Traceback" not in err
    assert "Exception ignored" not in err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_output_that_cannot_be_written_is_told_without_a_traceback():
    command = [sys.executable, "-c", PROGRAM, "skills", "--json"]  # what starts soonest
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)  # noqa: S603
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert "No space left on device" in done.stderr


# Ctrl-C at the moment in which a module begins to be imported.
PRESSED = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)

class Pressed:
    def find_spec(self, name, *_):
        if name == os.environ["PRESSED_AT"]:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Pressed())
from coevo.cli import main
main()
"""


@pytest.mark.parametrize("module", ["click", "msgspec", "numpy", "coevo.skill.model"])
def test_ctrl_c_while_importing_is_told_without_a_traceback(module):
    done = subprocess.run(  # noqa: S603 - our own
        [sys.executable, "-c", PRESSED, "skills"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PRESSED_AT": module},
    )
    assert (done.returncode, done.stdout, done.stderr.strip()) == (130, "", "coevo: stopped")


def test_a_terminal_that_lacks_letters_shows_their_numbers(tmp_path):
    done = subprocess.run(  # noqa: S603 - our own
        [sys.executable, "-c", PROGRAM, "evolve", str(tmp_path / "\N{SNOWMAN}.toml")],
        capture_output=True,
        check=False,
        env={**os.environ, "PYTHONIOENCODING": "latin-1"},
    )
    said = done.stderr.decode("latin-1")
    assert (done.returncode, done.stdout) == (2, b"")
    assert "\\u2603.toml" in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("closed", "arguments", "code"),
    [
        ("2>&-", ["skills", "--json"], 0),
        ("2>&-", ["evolve", "smok"], 2),
        ("2>&- 0<&-", ["skills", "--json"], 0),
        ("1>&-", ["skills", "--json"], 0),
    ],
)
def test_streams_that_are_closed_are_in_nobodys_way(closed, arguments, code):
    command = ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-c", PROGRAM, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - our own
    assert (done.returncode, done.stderr) == (code, "")
    if not code and closed != "1>&-":
        assert [one["name"] for one in json.loads(done.stdout)][:2] == ["shoot", "pass"]


@pytest.mark.slow
def test_numbers_of_a_run_are_those_of_another_process(lasting, start, best_programs):
    """Machine code from the cache, or compiled here, gives the same games."""
    process = start("play", lasting[1].path, "--games", "4", "--json", "--quiet")
    out, _ = process.communicate(timeout=300)
    arena, programs = Arena(lasting[1].config), best_programs(lasting[1], 69)
    assert json.loads(out)["digest"] == trace_digest([arena.trace(programs, seed)[1] for seed in play_seeds(1, 4)])
    assert np.isfinite(lasting[1].generations["fitness_mean"]).all()
