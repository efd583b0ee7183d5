"""The command line: the one place where everything is put together."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["main"]


def main() -> None:
    """Run the command line; the exit code is 0 done, 1 failed, 2 wrong input, 130 stopped.

    What takes a while to import is imported here, so that who stops it meanwhile sees no traceback.
    """
    try:
        with _stopped_by_kill():
            _mend_streams()
            from coevo.cli.commands import run

            run()
    except KeyboardInterrupt:
        print("coevo: stopped", file=sys.stderr)  # noqa: T201 - click may not be imported yet
        sys.exit(130)


@contextmanager
def _stopped_by_kill() -> Iterator[None]:
    """Let SIGTERM, by which ``kill`` and batch systems end a process, do what Ctrl-C does: workers end with it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _mend_streams() -> None:
    """Put something in the place of streams that are closed; what a terminal cannot show is shown by its number."""
    for name in ("stdin", "stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w", encoding="utf-8"))  # noqa: PTH123, SIM115
        elif name != "stdin" and hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
