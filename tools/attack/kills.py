"""Commands that are killed at random instants, may not write, or meet each other: the end is as if nothing had been."""

from __future__ import annotations

import ctypes
import os
import random
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

from folders import SMALL, results_of
from runner import Case

from behaviors import learned
from behaviors.learning import warm_up
from behaviors.recipe import read_recipe as behaviors_recipe
from coevo.cli import main
from coevo.files import read_arrays

__all__ = ["Command", "commands", "kills", "races", "read_only"]

_PATIENCE_S = 90.0
_KILLS = 3  # of one folder, before its command is let end


class Ended(NamedTuple):
    """How a command ended: its exit code, and what it said on standard error."""

    code: int
    said: str


class Command(NamedTuple):
    """A command that writes a folder.

    name: for the table. begin: its arguments, of the folder. again: those that go on after a kill.
    results: what may not differ, of the folder. at_work: a file in it that is only there when the folder is held.
    """

    name: str
    begin: Callable[[Path], list[str]]
    again: Callable[[Path], list[str]]
    results: Callable[[Path], object]
    at_work: str


def _obey_permissions() -> None:
    """Let the superuser be refused what others are refused, and all processes that this one makes."""
    library = ctypes.CDLL(None)
    header, held = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()  # version 3, this process
    if not hasattr(library, "capset") or library.capget(header, held):
        return
    for capability in (1, 2):  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
        library.prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP
    for words in range(3):  # effective, permitted, inheritable
        held[words] &= ~0b110
    library.capset(header, held)


def start(arguments: Sequence[str], said: Path, *, bound: bool = False) -> int:
    """Begin a command in a process of its own, which has all imports behind it; return its number.

    Args:
        arguments: of the command.
        said: what it says on standard error.
        bound: whether permissions hold for it, if it is the superuser's, too.
    """
    pid = os.fork()
    if pid:
        return pid
    code = 70
    with suppress(BaseException):
        os.setsid()
        if bound:
            _obey_permissions()
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


def do(arguments: Sequence[str], said: Path, *, bound: bool = False) -> Ended:
    """Do a command to its end."""
    return wait(start(arguments, said, bound=bound), said)


def _stop(pid: int) -> int:
    """Kill a command and all its processes; return how it ended, which may have been before."""
    done, status = os.waitpid(pid, os.WNOHANG)
    if not done:
        for end, number in ((os.killpg, pid), (os.kill, pid)):
            with suppress(ProcessLookupError):
                end(number, signal.SIGKILL)
        _, status = os.waitpid(pid, 0)
    return os.waitstatus_to_exitcode(status)


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
    learned._SAVE_EVERY_S, learned._SAVE_SHARE = 0.0, 1.0  # noqa: SLF001 - a learning of a second is saved, too

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

    def skill(path: Path) -> object:
        return [(path / name).read_bytes() for name in ("skill.npz", "card.json", "recipe.toml")]

    def played(path: Path) -> object:
        return {one.name: _npz(one) for one in (path / "results").glob("*.npz")}, results_of(path)

    return [
        Command("evolve, resume", evolve, resume, results_of, "individuals.parquet/*.parquet"),
        Command("learn", learn, lambda path: [*learn(path), "--resume"], skill, "learning.npz"),
        Command("tournament", tournament, tournament, played, "results/*.npz"),
        Command("study", studied, studied, lambda path: (path / "table.csv").read_bytes(), "*/config.toml"),
    ]


@cache
def _alone(command: Command, folder: Path) -> tuple[object, float]:
    """Return what a command comes to that nobody disturbs, and how many seconds it takes."""
    path, said = folder / "alone", folder / "alone.said"
    began = time.monotonic()
    ended = do(command.begin(path), said)
    if ended.code:
        raise SystemExit(f"{command.name} does not work: {ended.said}")
    seconds = time.monotonic() - began
    found = command.results(path)
    shutil.rmtree(path)
    return found, seconds


def _wrong(command: Command, ended: Ended, path: Path, whole: object) -> str:
    if ended.code or "Traceback" in ended.said:
        return f"it ends with {ended.code}: {ended.said[-300:]}"
    return "" if command.results(path) == whole else "other bytes"


def _cases(
    family: str,
    count: int,
    rng: random.Random,
    all_of: Sequence[Command],
    folder: Path,
    attempt: Callable[[Command, object, float, random.Random, Path], str],
) -> Iterator[Case]:
    """Yield cases of all commands in turn: what each tries is handed its command, and what that comes to alone."""
    for number in range(count):
        command, seed = all_of[number % len(all_of)], rng.getrandbits(64)
        whole, seconds = _alone(command, folder.parent)

        def tried(command: Command = command, whole: object = whole, seconds: float = seconds, seed: int = seed) -> str:
            path = folder / str(seed)
            try:
                return attempt(command, whole, seconds, random.Random(seed), path)
            finally:
                shutil.rmtree(path, ignore_errors=True)
                for said in folder.glob(f"{seed}.*"):
                    said.unlink()

        yield Case(f"{family} ({command.name})", f"seed {seed}", tried, 4 * _PATIENCE_S)


# ------------------------------------------------------------------------------------------------ kills


def kills(count: int, rng: random.Random, all_of: Sequence[Command], folder: Path) -> Iterator[Case]:
    """Yield commands that are killed three times while they live, at random instants, and then end."""
    for case in _cases("kills", -(-count // _KILLS), rng, all_of, folder, _kill):
        yield case._replace(count=_KILLS)


def _kill(command: Command, whole: object, seconds: float, rng: random.Random, path: Path) -> str:
    said, killed = path.with_suffix(".said"), 0
    arguments = command.begin(path)
    while killed < _KILLS:
        pid = start(arguments, said)
        time.sleep(rng.uniform(0.0, 1.1 * seconds))
        code = _stop(pid)
        if code == -signal.SIGKILL:
            killed, arguments = killed + 1, command.again(path)
            continue
        wrong = _wrong(command, Ended(code, said.read_text("utf-8", "replace")), path, whole)
        if wrong:
            return wrong
        shutil.rmtree(path)  # it was ready before: from the beginning
        arguments = command.begin(path)
    return _wrong(command, do(arguments, said), path, whole)


# ------------------------------------------------------------------------------------------------ read-only folders


def read_only(count: int, rng: random.Random, all_of: Sequence[Command], folder: Path) -> Iterator[Case]:
    """Yield commands whose folders cannot be written any more, from a random instant on, and then can be again."""
    return _cases("read-only", count, rng, all_of, folder, _locked_out)


def _locked_out(command: Command, whole: object, seconds: float, rng: random.Random, path: Path) -> str:
    said = path.with_suffix(".said")
    pid = start(command.begin(path), said)
    time.sleep(rng.uniform(0.0, seconds))
    _stop(pid)
    path.mkdir(exist_ok=True)
    arguments = command.again(path)
    inside = [path, *(one for one in path.rglob("*") if one.is_dir())]
    chosen = inside if rng.random() < 0.5 else [rng.choice(inside)]
    for one in chosen:
        one.chmod(0o555)
    try:
        ended = do(arguments, said, bound=True)
    finally:
        for one in chosen:
            one.chmod(0o755)
    if ended.code not in (0, 1, 2) or "Traceback" in ended.said or (ended.code and not ended.said):
        return f"in a read-only folder it ends with {ended.code}: {ended.said[-300:]}"
    return _wrong(command, do(command.again(path), said), path, whole)


# ------------------------------------------------------------------------------------------------ races


def races(count: int, rng: random.Random, all_of: Sequence[Command], folder: Path) -> Iterator[Case]:
    """Yield two processes of one command at once in one folder: one is refused, or both find the same.

    In every other case the first stands still while it holds the folder, so that the second surely meets it.
    """
    yield from _cases("held", (count + 1) // 2, rng, all_of, folder, _meet)
    yield from _cases("races", count // 2, rng, all_of, folder, _race)


def _meet(command: Command, whole: object, _seconds: float, _rng: random.Random, path: Path) -> str:
    said, other = path.with_suffix(".said"), path.with_suffix(".other")
    for _ in range(20):
        pid = start(command.begin(path), said)
        until = time.monotonic() + _PATIENCE_S
        while not any(path.glob(command.at_work)) and time.monotonic() < until:
            time.sleep(0.001)
        os.kill(pid, signal.SIGSTOP)
        if not os.waitpid(pid, os.WNOHANG)[0]:
            break
        shutil.rmtree(path)  # it was ready before
    else:
        return "it is never met at work"
    second = do(command.again(path), other)
    with suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGCONT)
    ended = wait(pid, said)
    if second.code != 2 or "Traceback" in second.said:
        return f"a second process ends with {second.code} while the first holds the folder: {second.said[-200:]}"
    return _wrong(command, ended, path, whole)


def _race(command: Command, whole: object, _seconds: float, rng: random.Random, path: Path) -> str:
    saids = [path.with_suffix(f".{number}") for number in range(2)]
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
