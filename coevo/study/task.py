"""One run of a study as a task of a worker: plain data in, plain data out; the worker writes the run's folder."""

from __future__ import annotations

import platform
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from coevo.errors import InputError
from coevo.files import lock, make_folder, write_whole
from coevo.plugins import search_folders
from coevo.study.folder import ROW, STUDY, StudyFolder, row_bytes
from coevo.study.kinds import Cell
from coevo.study.plan import RECIPES, PlannedRun
from coevo.study.registry import kind_named

__all__ = ["RETRIES", "Done", "LeftError", "Task", "describe_failure", "do", "task_of"]

RETRIES = 2  # of a run that failed, but not by what its user gave
_PATIENCE_S = 600.0  # that a run which a lost worker still holds is waited for

_one_at_a_time = threading.Lock()  # a worker may have several threads, but they would only wait for each other
_warm: set[str] = set()


class Task(NamedTuple):
    """A run to be done.

    name: of its folder. study: the study's folder. flag: a file that is there as long as the run is wanted.
    kind: of its recipe. settings: plain data. key: the first columns of its row: which run it is.
    """

    name: str
    study: str
    flag: str
    kind: str
    settings: dict[str, Any]
    key: dict[str, Cell]


class Done(NamedTuple):
    """What became of a run.

    name: of its folder. row: what it came to, by column, None if it failed. failure: why. seconds: how long it took.
    """

    name: str
    row: dict[str, Cell] | None
    failure: str
    seconds: float


def task_of(study: StudyFolder, run: PlannedRun) -> Task:
    """Return what a worker needs to know of a run."""
    settings = {**run.condition.data, "seed": run.seed}
    folder, flag = str(study.path.absolute()), str(study.flag.absolute())
    return Task(run.name, folder, flag, run.condition.kind, settings, run.key)


class LeftError(Exception):
    """The run is not wanted any more; all that was done is saved."""


def describe_failure(error: BaseException) -> str:
    """Return in one line why a run failed."""
    text = " ".join(str(error).split())
    return text if isinstance(error, InputError) else f"{type(error).__name__}{': ' if text else ''}{text}"


def do(task: Task) -> Done:
    """Bring a run to its end, from wherever it is, and keep its row in its folder.

    What the user can mend is told as a failure; what else goes wrong is raised, and may be tried again.
    """
    began = time.monotonic()
    try:
        with _one_at_a_time:
            row = _do(task)
    except InputError as error:
        return Done(task.name, None, describe_failure(error), time.monotonic() - began)
    return Done(task.name, row, "", time.monotonic() - began)


def _do(task: Task) -> dict[str, Cell]:
    study = Path(task.study)
    if not (study / STUDY).is_file():
        raise InputError(
            f"the worker on {platform.node()} does not see {study}: --out must be a folder that all workers see"
        )
    kind, folders = kind_named(task.kind), search_folders(study / RECIPES)
    settings = kind.settings(task.settings, task.name)
    if task.kind not in _warm:
        kind.warm_up(settings, lambda _: None)
        _warm.add(task.kind)

    def tick() -> None:
        if not Path(task.flag).exists():
            raise LeftError

    with _held(study, task.name, tick):
        row = kind.run(settings, study / task.name, folders, tick)
        write_whole(study / task.name / ROW, row_bytes(kind.measured, row, task.key))
    return row


@contextmanager
def _held(study: Path, name: str, tick: Callable[[], None]) -> Iterator[None]:
    """Keep a run for this worker; one that was given up for lost may still be at it, and is waited for."""
    make_folder(study / ".locks", within=study)
    until = time.monotonic() + _PATIENCE_S
    while True:
        tick()
        try:
            release = lock(study / ".locks" / name)
            break
        except BlockingIOError:
            if time.monotonic() > until:
                raise InputError(f"{study / name} is being written by another process; stop it") from None
            time.sleep(0.2)
    try:
        yield
    finally:
        release()
