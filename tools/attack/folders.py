"""Run folders: links laid in them, the machine stopped at every write, full disks."""

from __future__ import annotations

import errno
import os
import random
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from unittest import mock

from runner import Case

from coevo.config import EvolutionSettings, check_experiment, override
from coevo.errors import InputError
from coevo.evolution import evolve
from coevo.evolution.evaluation import Evaluator
from coevo.recipes import read_recipe
from coevo.run import create_run, open_run

__all__ = ["SLOW", "SMALL", "crashes", "ended", "finish", "full_disks", "links", "results_of", "small"]

SMALL = (
    "gp.population=6",
    "gp.generations=3",
    "gp.tournament=2",
    "gp.creation_depth_max=4",
    "evaluation.games=2",
    "evaluation.champion_games=2",
    'levels.keys=[{ "players.2.strength" = [0.6, 0.8, 1.0] }]',
    'levels.keep="both sides winning"',
    "levels.against=0",
    "levels.window=1",
    "game.time_limit_steps=60",
)
SLOW = 60.0  # seconds for a case that plays games


def small(*changes: str) -> EvolutionSettings:
    """Return the settings of an experiment of a second."""
    return check_experiment(override(read_recipe("smoke", "evolution"), [*SMALL, *changes]), "smoke")


def finish(path: Path) -> None:
    """Bring a run to its end, in this process."""
    run = open_run(path)
    with Evaluator(run.config, workers=1, backend="threads", folders=run.folders) as evaluator:
        evolve(run, evaluator, lambda _: None)


def results_of(path: Path) -> dict[str, bytes]:
    """Return what may not differ between two runs of one recipe, by file."""
    names = [*path.glob("*.csv"), *path.glob("individuals.parquet/*.parquet"), path / "config.toml"]
    return {str(name.relative_to(path)): name.read_bytes() for name in names if name.exists()}


def ended(path: Path, whole: Mapping[str, bytes]) -> str:
    """Return in words in what a run differs from a whole one; "" if in nothing."""
    found = results_of(path)
    wrong = sorted(name for name in {*found, *whole} if found.get(name) != whole.get(name))
    return f"{', '.join(wrong)}: other bytes" if wrong else ""


# ------------------------------------------------------------------------------------------------ links


def links(runs: Mapping[str, Path], folder: Path) -> Iterator[Case]:
    """Yield links in a run's folder at each name that is written: what they point to stays as it is."""
    names = ("digests.txt", "generations.csv", "measures.csv", "checkpoint.npz", "config.toml", "environment.json")
    laid = [
        *names,
        *(f".{name}.partial" for name in names),
        ".lock",
        ".begun",
        "individuals.parquet",
        "results",
        "skills",
    ]
    laid += [f"individuals.parquet/{dot}part-00002.parquet{end}" for dot, end in (("", ""), (".", ".partial"))]
    for kind, source in runs.items():
        for name in laid:
            for hard in (False, True):
                yield Case(
                    "links",
                    f"{kind}, {name}, {'hard' if hard else 'symbolic'}",
                    lambda s=source, n=name, h=hard, k=kind: _link(
                        s, n, folder / f"{k}-{n.replace('/', '-')}-{h}", hard=h
                    ),
                    SLOW,
                )


def _link(source: Path, name: str, place: Path, *, hard: bool) -> str:
    copy, victim = place / "run", place / "victim"
    shutil.copytree(source, copy)
    try:
        path = copy / name
        is_folder = path.is_dir()
        victim.mkdir() if is_folder else victim.write_bytes(b"mine")
        if is_folder and hard:
            return ""
        if is_folder:
            for one in path.iterdir():
                if one.name != "part-00002.parquet":
                    shutil.copy(one, victim) if one.is_file() else shutil.copytree(one, victim / one.name)
            shutil.rmtree(path)
        path.unlink(missing_ok=True)
        path.hardlink_to(victim) if hard else path.symlink_to(victim)
        before = sorted((str(one), one.read_bytes()) for one in [victim, *victim.rglob("*")] if one.is_file())
        with suppress(InputError):
            release = open_run(copy).lock()
            try:
                finish(copy)
            finally:
                release()
            open_run(copy).save_result("mine", {})
        after = sorted((str(one), one.read_bytes()) for one in [victim, *victim.rglob("*")] if one.is_file())
        return "" if before == after else "what a link points to was written"
    finally:
        shutil.rmtree(place)


# ------------------------------------------------------------------------------------------------ crashes


class _Disk:
    """What a disk holds, and what of it lasts if the machine stops: only what was synced.

    Two worst cases are told after each step: names that were not synced are as before, or are there with what of their
    contents was synced.
    """

    def __init__(self, root: Path) -> None:
        self.root, self.states = root, dict[tuple[str, int], dict[str, bytes]]()
        self._synced: dict[int, bytes] = {}  # contents by inode
        self._early: dict[str, bytes] = {}
        self._late: dict[str, bytes] = {}
        self._steps = 0

    def _note(self) -> None:
        self._steps += 1
        self.states["early names", self._steps] = dict(self._early)
        self.states["late names", self._steps] = dict(self._late)

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Watch what is synced and renamed in this process."""
        fsync, rename, root = os.fsync, Path.replace, str(self.root)

        def watch_sync(handle: int) -> None:
            fsync(handle)
            path = Path(f"/proc/self/fd/{handle}").readlink()
            if not str(path).startswith(root):
                return
            if path.is_dir():
                self._late = {n: d for n, d in self._late.items() if Path(n).parent != path} | {
                    n: d for n, d in self._early.items() if Path(n).parent == path
                }
            else:
                data = path.read_bytes()
                self._synced[path.stat().st_ino] = data
                if not path.name.endswith(".partial"):  # written where it stands
                    self._early[str(path)] = data[: len(data) // 2]
                    self._note()
                    self._early[str(path)] = self._late[str(path)] = data
            self._note()

        def watch_rename(partial: Path, target: Path) -> Path:
            number = partial.stat().st_ino
            done = rename(partial, target)
            if str(target).startswith(root):
                self._early[str(target)] = self._synced.get(number, b"")
                self._note()
            return done

        with mock.patch("os.fsync", watch_sync), mock.patch.object(Path, "replace", watch_rename):
            yield


def crashes(scale: float, rng: random.Random, whole: Path, folder: Path) -> Iterator[Case]:
    """Yield what the disk holds if the machine stops after any step of a run: it goes on to the same bytes."""
    source = folder / "watched"
    disk = _Disk(source)
    with disk.watched():
        create_run(source, small())
        finish(source)
    states = list(disk.states.items())
    rng.shuffle(states)
    for (how, step), files in states[: max(12, int(len(states) * min(1.0, scale * 4)))]:
        place = folder / f"{how}-{step}".replace(" ", "-")
        yield Case("crash points", f"{how}, step {step}", lambda f=files, p=place: _crash(f, source, p, whole), SLOW)


def _crash(files: Mapping[str, bytes], source: Path, place: Path, whole: Path) -> str:
    try:
        for name, data in files.items():
            path = place / Path(name).relative_to(source)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        place.mkdir(exist_ok=True)
        if not (place / "config.toml").exists():
            (place / ".begun").touch()
            create_run(place, small())
        try:
            finish(place)
        except InputError as error:
            return f"a run that lost nothing cannot go on: {error}"
        return ended(place, results_of(whole))
    finally:
        shutil.rmtree(place, ignore_errors=True)


def full_disks(scale: float, whole: Path, folder: Path) -> Iterator[Case]:
    """Yield disks that are full, or cannot be written, from the n-th write on: it is told, and nothing is lost."""
    for number in range(int(30 * min(1.0, 4 * scale)) or 2):
        for code in (errno.ENOSPC, errno.EROFS, errno.EIO):
            place = folder / f"{errno.errorcode[code]}-{number}"
            yield Case("full disks", place.name, lambda n=number, c=code, p=place: _full(n, c, p, whole), SLOW)


def _full(number: int, code: int, place: Path, whole: Path) -> str:
    left = [number]
    fsync = os.fsync

    def fails(handle: int) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise OSError(code, os.strerror(code))
        fsync(handle)

    try:
        create_run(place, small())
        try:
            with mock.patch("os.fsync", fails):
                finish(place)
        except InputError:
            pass
        finish(place)
        return ended(place, results_of(whole))
    finally:
        shutil.rmtree(place, ignore_errors=True)
