"""Commands that are killed at random instants, or meet each other in one folder: the end is as if nothing had been."""

from __future__ import annotations

import os
import random
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from folders import SMALL, results_of
from runner import Case

from behaviors.learning import warm_up
from behaviors.recipe import read_recipe as behaviors_recipe
from coevo.cli import main
from coevo.files import read_arrays

__all__ = ["Command", "commands", "kills", "races"]

_PATIENCE_S = 90.0


class Ended(NamedTuple):
    """How a command ended: its exit code, and what it said on standard error."""

    code: int
    said: str


class Command(NamedTuple):
    """A command that writes a folder.

    name: for the table. begin: its arguments, of the folder. again: those that go on after a kill.
    results: what may not differ, of the folder.
    """

    name: str
    begin: Callable[[Path], list[str]]
    again: Callable[[Path], list[str]]
    results: Callable[[Path], object]


def start(arguments: Sequence[str], said: Path) -> int:
    """Begin a command in a process of its own, which has all imports behind it; return its number."""
    pid = os.fork()
    if pid:
        return pid
    code = 70
    with suppress(BaseException):
        os.setsid()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        handle = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(handle, 2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
        sys.argv = ["coevo", *arguments]
        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 0
        sys.stderr.flush()
    os._exit(code)


def wait(pid: int, said: Path, seconds: float = _PATIENCE_S) -> Ended:
    """Wait for a command; one that takes too long is killed."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return Ended(os.waitstatus_to_exitcode(status), said.read_text("utf-8", "replace"))
        time.sleep(0.01)
    with suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    return Ended(-99, "it hangs")


def do(arguments: Sequence[str], said: Path) -> Ended:
    """Do a command to its end."""
    return wait(start(arguments, said), said)


def _npz(path: Path) -> dict[str, bytes]:
    return {name: array.tobytes() for name, array in read_arrays(path).items()}


def commands(folder: Path, finished: Path) -> list[Command]:
    """Return the commands that write folders; ``finished`` is a run that tournaments are played in."""
    sets = [part for one in SMALL for part in ("--set", one)]
    (folder / "mine.toml").write_text(
        'kind = "study"\nrecipes = ["smoke"]\nseeds = 2\n[set]\n'
        + "".join(f'"{key}" = {value}\n' for key, _, value in (one.partition("=") for one in SMALL))
    )
    study = str(folder / "mine.toml")
    warm_up(behaviors_recipe("search"))  # once, before processes are made of this one

    def evolve(path: Path) -> list[str]:
        return ["evolve", "smoke", "--quiet", "--unseen", "0", "--workers", "1", "--out", str(path), *sets]

    def resume(path: Path) -> list[str]:
        if not (path / "config.toml").exists():
            return evolve(path)
        return ["resume", str(path), "--quiet", "--unseen", "0", "--workers", "1"]

    def learn(path: Path) -> list[str]:
        return ["learn", "search", "--trials", "2000", "--games", "50", "--quiet", "--out", str(path)]

    def tournament(path: Path) -> list[str]:
        if not path.exists():
            shutil.copytree(finished, path)
        return ["tournament", str(path), "--games", "4", "--again", "2", "--workers", "1", "--quiet"]

    def studied(path: Path) -> list[str]:
        return ["study", study, "--out", str(path), "--workers", "1", "--quiet"]

    def learned(path: Path) -> object:
        return [(path / name).read_bytes() for name in ("skill.npz", "card.json", "recipe.toml")]

    def played(path: Path) -> object:
        return {one.name: _npz(one) for one in (path / "results").glob("*.npz")}, results_of(path)

    return [
        Command("evolve, resume", evolve, resume, results_of),
        Command("learn", learn, lambda path: [*learn(path), "--resume"], learned),
        Command("tournament", tournament, tournament, played),
        Command("study", studied, studied, lambda path: (path / "table.csv").read_bytes()),
    ]


def kills(count: int, rng: random.Random, all_of: Sequence[Command], folder: Path) -> Iterator[Case]:
    """Yield commands that are killed three times at random instants, and then end."""
    wholes = []
    for command in all_of:
        path, said = folder / f"whole-{len(wholes)}", folder / f"whole-{len(wholes)}.said"
        began = time.monotonic()
        ended = do(command.begin(path), said)
        if ended.code:
            raise SystemExit(f"{command.name} does not work: {ended.said}")
        wholes.append((command.results(path), time.monotonic() - began))
    for number in range(-(-count // 3)):
        at = number % len(all_of)
        seed = rng.getrandbits(64)
        yield Case(
            f"kills ({all_of[at].name})",
            f"seed {seed}",
            lambda a=at, s=seed: _kill(all_of[a], *wholes[a], random.Random(s), folder / str(s)),
            4 * _PATIENCE_S,
        )


def _kill(command: Command, whole: object, seconds: float, rng: random.Random, path: Path) -> str:
    said = path.with_suffix(".said")
    try:
        arguments = command.begin(path)
        for _ in range(3):
            pid = start(arguments, said)
            time.sleep(rng.uniform(0.0, 1.1 * seconds))
            with suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            arguments = command.again(path)
        ended = do(arguments, said)
        if ended.code or "Traceback" in ended.said:
            return f"it ends with {ended.code}: {ended.said[-300:]}"
        return "" if command.results(path) == whole else "other bytes"
    finally:
        shutil.rmtree(path, ignore_errors=True)
        said.unlink(missing_ok=True)


def races(count: int, rng: random.Random, all_of: Sequence[Command], folder: Path) -> Iterator[Case]:
    """Yield two processes of one command at once in one folder: one is refused, or both find the same."""
    wholes = []
    for at, command in enumerate(all_of):
        path = folder / f"alone-{at}"
        do(command.begin(path), folder / "alone.said")
        wholes.append(command.results(path))
    for number in range(count):
        at, seed = number % len(all_of), rng.getrandbits(64)
        yield Case(
            f"races ({all_of[at].name})",
            f"seed {seed}",
            lambda a=at, s=seed: _race(all_of[a], wholes[a], random.Random(s), folder / str(s)),
            4 * _PATIENCE_S,
        )


def _race(command: Command, whole: object, rng: random.Random, path: Path) -> str:
    saids = [path.with_suffix(f".{number}") for number in range(2)]
    try:
        command.begin(path)  # what is to be there before
        pids = []
        for number, said in enumerate(saids):
            arguments = command.begin(path)
            if command.name.startswith("evolve"):
                arguments += ["--seed", str(number)]  # of other settings
            pids.append(start(arguments, said))
            time.sleep(rng.choice((0.0, 0.0, rng.uniform(0.0, 0.3))))
        ended = [wait(pid, said) for pid, said in zip(pids, saids, strict=True)]
        if any(one.code not in (0, 2) or "Traceback" in one.said for one in ended):
            return f"they end with {[one.code for one in ended]}: {[one.said[-200:] for one in ended]}"
        if all(one.code == 2 for one in ended):
            return f"both are refused: {ended[0].said[-200:]}"
        if command.name.startswith("evolve"):
            if [one.code for one in ended].count(0) != 1:
                return "both went on in one folder"
            return "" if ended[0].code or command.results(path) == whole else "other bytes"
        return "" if command.results(path) == whole else "other bytes"
    finally:
        shutil.rmtree(path, ignore_errors=True)
        for said in saids:
            said.unlink(missing_ok=True)
