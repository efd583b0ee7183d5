"""Cases of an attack, tried in processes of their own: what ends otherwise than it should is told, and counted."""

from __future__ import annotations

import json
import os
import resource
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from typing import NamedTuple, NoReturn

from coevo.errors import InputError

__all__ = ["MOST_BYTES", "MOST_SECONDS", "Case", "Tally", "try_all"]

MOST_SECONDS = 10.0  # of a case that only reads
MOST_BYTES = 1 << 30  # of resident memory
_NONE = InputError("")


class Case(NamedTuple):
    """Something to try.

    family, name: for the table, and to find it again.
    attempt: returns what went wrong, "" if nothing did; an ``InputError`` is a refusal, and right.
    seconds: how long it may take.
    count: how many things it tries.
    """

    family: str
    name: str
    attempt: Callable[[], str | None]
    seconds: float = MOST_SECONDS
    count: int = 1


@dataclass
class Tally:
    """What came of a family.

    tried, refused: how many. failures: name of the case, and what went wrong.
    seconds, megabytes: the most that a case took, and that its process had.
    """

    tried: int = 0
    refused: int = 0
    failures: list[tuple[str, str]] = field(default_factory=list)
    seconds: float = 0.0
    megabytes: float = 0.0


class _HangError(BaseException):
    """The case took too long."""


def _hang(_number: int, _frame: object) -> NoReturn:
    raise _HangError


def _attempt(case: Case) -> tuple[bool, str]:
    """Return whether a case was refused, and what went wrong."""
    signal.signal(signal.SIGALRM, _hang)
    signal.setitimer(signal.ITIMER_REAL, case.seconds)
    try:
        return False, case.attempt() or ""
    except InputError as error:
        return True, "" if len(str(error)) < 4000 else "the message is longer than a page"
    except _HangError:
        return False, f"took more than {case.seconds:g} s"
    except BaseException as error:  # noqa: BLE001 - which it is, is what is looked for
        line = traceback.extract_tb(error.__traceback__)[-1]
        return False, f"{type(error).__name__}: {str(error)[:200]} ({line.filename}:{line.lineno})"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def _child(cases: list[Case], pipe: int) -> NoReturn:
    """Try cases, tell of each in a line, and end."""
    os.setsid()
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
    for case in cases:
        began = time.monotonic()
        refused, wrong = _attempt(case)
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        if most > MOST_BYTES and not wrong:
            wrong = f"took {most >> 20} MB of memory"
        told = (refused, wrong, time.monotonic() - began, most)
        os.write(pipe, (json.dumps(told) + "\n").encode())
    os._exit(0)


def _begin(cases: list[Case]) -> tuple[int, int]:
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(read)
        with suppress(BaseException):
            _child(cases, write)
        os._exit(70)
    os.close(write)
    return pid, read


def try_all(cases: Iterable[Case], *, jobs: int, batch: int, tell: Callable[[str], None]) -> dict[str, Tally]:
    """Try cases, some at a time; return what came of them by family."""
    tallies: dict[str, Tally] = {}
    waiting: Iterator[Case] = iter(cases)
    living: dict[int, tuple[int, list[Case], bytes]] = {}  # by pipe: process, cases, what it told
    shown = time.monotonic()
    while True:
        while len(living) < jobs and (lot := list(islice(waiting, batch))):
            pid, pipe = _begin(lot)
            living[pipe] = (pid, lot, b"")
        if not living:
            return tallies
        for pipe in select.select(list(living), [], [], 1.0)[0]:
            pid, lot, told = living[pipe]
            piece = os.read(pipe, 1 << 16)
            living[pipe] = (pid, lot, told + piece)
            if not piece:
                os.close(pipe)
                _, status = os.waitpid(pid, 0)
                with suppress(ProcessLookupError):
                    os.killpg(pid, signal.SIGKILL)  # what the case has left
                _enter(tallies, lot, told, status)
                del living[pipe]
        if time.monotonic() - shown > 20.0:
            shown = time.monotonic()
            tell(", ".join(f"{name} {of.tried} ({len(of.failures)} failed)" for name, of in tallies.items()))


def _enter(tallies: dict[str, Tally], lot: list[Case], told: bytes, status: int) -> None:
    lines = [json.loads(line) for line in told.splitlines()]
    for number, case in enumerate(lot):
        tally = tallies.setdefault(case.family, Tally())
        tally.tried += case.count
        if number >= len(lines):
            tally.failures.append((case.name, f"the process ended with status {status}"))
            continue  # those after it were not tried, and are told of as well
        refused, wrong, seconds, most = lines[number]
        tally.refused += refused
        tally.seconds = max(tally.seconds, seconds)
        tally.megabytes = max(tally.megabytes, most / 2**20)
        if wrong:
            tally.failures.append((case.name, wrong))
