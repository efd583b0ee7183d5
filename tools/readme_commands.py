"""Run every command of the README, in its order: a README that lies fails here.

A command is a line that begins with `$ ` in a block marked `console`; what follows it there is its output and
is not compared. All commands share one temporary folder, so that a later one may read what an earlier one
made. They find the programs of the checkout's .venv first. A `make` target is not run here: .ci/run must.

A block that takes too long, or cannot be run here, follows a comment line of its own:

    <!-- long -->                          the next block is skipped
    <!-- long: coevo evolve smoke -->      this is run in its place (more than one such line may stand there)
"""

import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
_MARK = re.compile(r"<!--\s*long\s*(?::\s*(?P<instead>.*?)\s*)?-->")
_TOO_LONG_S = 600


class Command(NamedTuple):
    """A command and the line of the README it stands on; `skipped` if it is only shown."""

    line: int
    text: str
    skipped: bool


def main() -> int:
    """Run the commands; the exit code is 1 if one fails, if there is none, or if CI leaves a target out."""
    commands = list(_commands((ROOT / "README.md").read_text().splitlines()))
    if not any(not command.skipped for command in commands):
        print("README.md should show commands, '$ ...' in ```console blocks; it has none", file=sys.stderr)
        return 1
    search_path = f"{ROOT / '.venv' / 'bin'}{os.pathsep}{os.environ['PATH']}"
    covered = _targets((ROOT / ".ci" / "run").read_text())
    with tempfile.TemporaryDirectory(prefix="coevo-readme-") as folder:
        for line, text, skipped in commands:
            if skipped:
                print(f"README.md:{line}: $ {text}   (long: skipped)", flush=True)
                continue
            if text.startswith("make "):
                if lacking := _targets(text) - covered:
                    print(f"README.md:{line}: .ci/run does not run 'make {min(lacking)}'", file=sys.stderr)
                    return 1
                print(f"README.md:{line}: $ {text}   (.ci/run covers it)", flush=True)
                continue
            print(f"README.md:{line}: $ {text}", flush=True)
            begin = time.monotonic()
            try:
                code = subprocess.run(
                    ["bash", "-euo", "pipefail", "-c", text],  # noqa: S607 - whatever bash the reader has
                    cwd=folder,
                    env=os.environ | {"PATH": search_path},
                    stdin=subprocess.DEVNULL,
                    timeout=_TOO_LONG_S,
                    check=False,
                ).returncode
            except subprocess.TimeoutExpired:
                print(f"README.md:{line}: took more than {_TOO_LONG_S} s: mark it long", file=sys.stderr)
                return 1
            if code != 0:
                print(f"README.md:{line}: '{text}' exited with {code}", file=sys.stderr)
                return 1
            print(f"({time.monotonic() - begin:.1f} s)", flush=True)
    return 0


def _commands(lines: list[str]) -> Iterator[Command]:
    """Yield the commands of a Markdown text; a line that ends in a backslash goes on in the next."""
    fence = ""  # the mark that ends the block we are in
    console = long = False
    command = ""
    for number, line in enumerate(lines, start=1):
        bare = line.strip()
        if fence:
            if bare == fence:
                fence, command = "", ""
                if console:
                    long = False
            elif console and (command or bare.startswith("$ ")):
                command += bare.removeprefix("$ ") if not command else f" {bare}"
                if command.endswith("\\"):
                    command = command[:-1].rstrip()
                else:
                    yield Command(number, command, skipped=long)
                    command = ""
        elif opening := re.match(r"(`{3,}|~{3,})\s*(\S*)", bare):
            fence, console = opening[1], opening[2] == "console"
        elif mark := _MARK.fullmatch(bare):
            long = True
            if mark["instead"]:
                yield Command(number, mark["instead"], skipped=False)


def _targets(text: str) -> set[str]:
    """Name the targets of all `make` commands in a shell text."""
    targets: set[str] = set()
    for line in text.splitlines():
        if line.startswith("make "):
            words = shlex.split(line, comments=True)[1:]
            targets.update(word for word in words if "=" not in word and not word.startswith("-"))
    return targets


if __name__ == "__main__":
    sys.exit(main())
