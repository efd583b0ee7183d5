"""What commands show: results on stdout, progress on stderr; shared by every package that adds a command."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Self, TypeVar

import click

from coevo.errors import InputError
from coevo.files import make_folder, write_whole

__all__ = [
    "Count",
    "Progress",
    "cores",
    "duration",
    "emit",
    "most_workers",
    "note",
    "output_options",
    "put_off_interrupt",
    "show",
    "table",
    "worker_options",
]

_F = TypeVar("_F", bound=Callable[..., Any])


def output_options(command: _F) -> _F:
    """Add --json and --quiet to a command, which receives them as ``as_json`` and ``quiet``."""
    command = click.option("--quiet", "-q", is_flag=True, help="Show no progress.")(command)
    return click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")(command)


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Count(click.IntRange):
    """A number of things, 1 or more: not so many that nobody can mean it."""

    def __init__(self, most: int = 1_000_000, least: int = 1) -> None:
        super().__init__(min=least)
        self._most = most

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number.

        Raises:
            click.BadParameter: it is none, or out of range.
        """
        number = super().convert(value, param, ctx)
        if number > self._most:
            self.fail(f"{number} is too many: {self._most} is the most.", param, ctx)
        return number


def most_workers() -> int:
    """Return how many workers may be asked for: more would only wait for each other."""
    return max(64, 4 * cores())


def worker_options(command: _F) -> _F:
    """Add --workers and --backend to a command, which receives them as ``workers`` and ``backend``."""
    command = click.option(
        "--backend",
        type=click.Choice(["threads", "processes"]),
        default="threads",
        show_default=True,
        help="What workers are; results do not depend on it.",
    )(command)
    return click.option(
        "--workers",
        type=Count(most_workers()),
        default=cores(),
        show_default=True,
        help="How many games at a time.",
    )(command)


def emit(data: dict[str, Any] | list[Any]) -> None:
    """Print one JSON value on stdout."""
    click.echo(json.dumps(data, indent=2, allow_nan=False))


def show(data: dict[str, Any] | list[Any], text: str, *, as_json: bool, out: Path | None = None) -> None:
    """Print what was found, as JSON or as text for people, and write it as JSON to a file if one is named.

    Raises:
        InputError: the file cannot be written.
    """
    if out is not None:
        try:
            make_folder(out.parent)
            write_whole(out, (json.dumps(data, indent=2, allow_nan=False) + "\n").encode())
        except OSError as error:
            raise InputError(f"cannot write {out}: {error.strerror or error}; choose another --out") from None
    if as_json:
        emit(data)
    else:
        click.echo(text)


def note(text: str, *, quiet: bool = False) -> None:
    """Print a line of progress on stderr."""
    if not quiet:
        click.echo(text, err=True)


def duration(seconds: float) -> str:
    """Return a time as a person reads it: ``4.2 s``, ``3:07 min`` or ``2:05 h``."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    if seconds < 3600:
        return f"{int(seconds) // 60}:{int(seconds) % 60:02d} min"
    return f"{int(seconds) // 3600}:{int(seconds) // 60 % 60:02d} h"


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return rows of text under a header, the first column to the left, the others to the right."""
    widths = [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]

    def line(row: Sequence[str]) -> str:
        cells = [
            cell.ljust(width) if i == 0 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        return "  ".join(cells).rstrip()

    return "\n".join([line(header), *(line(row) for row in rows)])


@contextmanager
def put_off_interrupt() -> Iterator[None]:
    """Let what is within end before Ctrl-C or a kill is obeyed, so that it is done whole or not at all.

    Python gives signals to the main thread only; elsewhere there is nothing to put off.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came = False

    def remember(_number: int, _frame: FrameType | None) -> None:
        nonlocal came
        came = True

    before = {number: signal.signal(number, remember) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if came:
        raise KeyboardInterrupt


class Progress:
    """Progress of a long command on stderr: a live bar on a terminal, else a line a step, or nothing.

    Args:
        total: number of steps. done: how many were done before.
        quiet: show nothing.
    """

    def __init__(self, total: int, *, done: int = 0, quiet: bool = False) -> None:
        self._total, self._done, self._quiet = total, done, quiet
        self._live: Any = None
        self._task: Any = None

    def __enter__(self) -> Self:
        if not self._quiet and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn
            from rich.progress import Progress as RichProgress

            self._live = RichProgress(
                BarColumn(bar_width=24),
                TextColumn("{task.description}"),
                console=Console(stderr=True),
                transient=True,
            )
            self._task = self._live.add_task("", total=self._total, completed=self._done)
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def step(self, text: str, *, done: int) -> None:
        """Show that ``done`` steps are done; ``text`` says how it goes."""
        if self._quiet:
            return
        if self._live is not None:
            self._live.update(self._task, completed=done, description=text)
        else:
            note(text)
