"""Studies on real processes, of joblib and of Dask: the table is the same wherever, and whoever dies on the way."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

pytestmark = pytest.mark.slow

# With the signal as it is at a terminal, even if these tests run in the background.
PROGRAM = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from coevo.cli import main; main()"
LONGER = """
[set]
"gp.population" = 12
"gp.generations" = 25
"gp.creation_depth_max" = 6
"""


@pytest.fixture
def study(study_file, tmp_path):
    """Return a function that begins the study of this module in a process: ``study("out", "--workers", 2)``."""
    path, begun = study_file(settings=LONGER, vary=""), []

    def begin(name, *options):
        words = [sys.executable, "-c", PROGRAM, "study", path, "--out", tmp_path / name, *options]
        with (tmp_path / f"{name}.log").open("w") as log:
            process = subprocess.Popen(  # noqa: S603 - our own program
                [*map(str, words)], stdout=log, stderr=log, start_new_session=True
            )
        begun.append(process)
        return begun[-1]

    yield begin
    for process in begun:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)


@pytest.fixture(scope="module")
def undisturbed(finished_study):
    """Return the bytes of the table of that study if nobody disturbs it."""
    return (finished_study(settings=LONGER, vary="") / "table.csv").read_bytes()


def wait_for_generation(folder, process, number=4):
    """Wait until some run of a study has a generation."""
    until = time.monotonic() + 600
    while not list(folder.glob(f"*/individuals.parquet/part-{number:05d}.parquet")):
        assert process.poll() is None, (folder.parent / f"{folder.name}.log").read_text()
        assert time.monotonic() < until
        time.sleep(0.05)


def kill_a_worker(process):
    """Kill a process that holds a run; return which run."""
    for child in psutil.Process(process.pid).children(recursive=True):
        held = [file.path for file in child.open_files() if "/.locks/" in file.path]
        if held:
            child.kill()
            return held
    return []


@pytest.mark.parametrize("options", [("--workers", 2), ("--workers", 2, "--scheduler", "local")])
def test_a_worker_killed_in_the_middle_changes_nothing(options, study, undisturbed, tmp_path):
    process = study("out", *options)
    wait_for_generation(tmp_path / "out", process)
    assert kill_a_worker(process)
    code = process.wait(timeout=900)
    assert code == 0, (tmp_path / "out.log").read_text()
    assert (tmp_path / "out" / "table.csv").read_bytes() == undisturbed
    assert not (tmp_path / "out" / "failed.csv").exists()


@pytest.mark.parametrize(
    ("stop", "options"),
    [
        # As a terminal does, to the workers, too; and as a batch system does whose time is up, to the one it knows.
        (lambda process: os.killpg(process.pid, signal.SIGINT), ("--workers", 2)),
        (lambda process: os.killpg(process.pid, signal.SIGINT), ("--workers", 2, "--scheduler", "local")),
        (lambda process: process.terminate(), ("--workers", 2)),
    ],
    ids=["Ctrl-C", "Ctrl-C on a cluster", "kill"],
)
def test_what_stops_it_leaves_all_that_is_done_and_the_same_command_goes_on(
    stop, options, study, undisturbed, tmp_path
):
    process = study("out", *options)
    wait_for_generation(tmp_path / "out", process)
    workers = psutil.Process(process.pid).children(recursive=True)
    stop(process)
    assert process.wait(timeout=300) == 130
    said = (tmp_path / "out.log").read_text()
    assert "Traceback" not in said
    assert "Go on with the same command." in said
    assert not psutil.wait_procs(workers, timeout=120)[1]
    process = study("again", "--out", tmp_path / "out")
    assert process.wait(timeout=900) == 0
    assert (tmp_path / "out" / "table.csv").read_bytes() == undisturbed


@pytest.fixture
def dask(tmp_path):
    """Return a function that begins a process of Dask's own; ``dask("worker", "--nthreads", 1)``."""
    file, begun = tmp_path / "scheduler.json", []

    def begin(what, *options):
        words = [sys.executable, "-m", "distributed.cli.dask_" + what, "--scheduler-file", file, *options]
        with (tmp_path / f"{what}-{len(begun)}.log").open("w") as log:
            process = subprocess.Popen(  # noqa: S603 - Dask's program
                [*map(str, words)], stdout=log, stderr=log, start_new_session=True, cwd=tmp_path
            )
        begun.append(process)
        return process

    yield begin
    for process in begun:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def test_a_cluster_that_is_running_does_a_study_though_a_worker_is_lost_and_another_joins(
    study, dask, undisturbed, tmp_path
):
    dask("scheduler", "--host", "127.0.0.1", "--port", 0, "--no-dashboard")
    until = time.monotonic() + 120
    while not (tmp_path / "scheduler.json").exists():
        assert time.monotonic() < until
        time.sleep(0.1)
    address = json.loads((tmp_path / "scheduler.json").read_text())["address"]
    process = study("out", "--scheduler", address)
    first = dask("worker", "--nthreads", 1, "--no-nanny", "--no-dashboard")
    wait_for_generation(tmp_path / "out", process)
    first.kill()
    first.wait()
    dask("worker", "--nthreads", 1, "--no-nanny", "--no-dashboard")
    code = process.wait(timeout=900)
    said = (tmp_path / "out.log").read_text()
    assert code == 0, said
    assert (tmp_path / "out" / "table.csv").read_bytes() == undisturbed
    assert not (tmp_path / "out" / "failed.csv").exists()
