"""Check every command of the documentation, and run those that do not take long: a page that lies fails here.

    python tools/documented_commands.py [--parse] [PAGE ...]

Commands stand in blocks marked ``console``, on lines that begin with ``$ `` (what follows is output, and not compared),
or ``sh``, a line each. Blocks marked ``python`` are run too. The blocks of a page share a temporary folder, so that a
later one may read what an earlier one made; they find the programs of the checkout's .venv first.

- Each command is parsed: there must be such a command with such options, and its recipe and settings must be right.
- Pages are run beside each other, one for each core, and what a page says comes when it is done.
- A block is not run if the line before it says, for readers, how long it takes and why that is too long:

      *Takes about an hour; not run by the tests, as ....*

  A comment between that line and the block gives something shorter to run in its place, and may be repeated:

      <!-- instead: coevo bench --games 20 -->

- A `make` target is not run here: .ci/run must. The pages of docs/how-to are followed by tests/how_to.
- A command within a sentence is parsed. Of each `coevo reproduce NAME` the pages say once how long it takes, in the
  same paragraph or in a block of commands.

Links, and names of files and of what Python imports, must be right too. With ``--parse`` nothing is run.
"""

import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import IO, Any

import click
from names import check_names
from pages import TIME, Block, LieError, Page, read_page

from behaviors.recipe import read_recipe
from behaviors.schedule.recipe import read_schedule
from coevo.cli.commands import cli
from coevo.cli.reproducing import reproduce
from coevo.errors import InputError
from coevo.recipes import is_path, read_experiment
from coevo.skill import load_skill
from coevo.study.plan import read_plan

ROOT = Path(__file__).resolve().parent.parent
PAGES = ("*.md", "docs/*.md", "docs/how-to/*.md", "docs/decisions/*.md", "runs/*.md")
_NOT_OURS = {"CHANGELOG.md"}  # it tells of commands that are gone
_HOW_TO, _HOW_TO_TESTS = "docs/how-to/", "tests/how_to/test_how_to.py"
_TOO_LONG_S = 240

_INLINE = re.compile(r"`((?:coevo|make) [^`]+)`")
_ENDS = {"|", "||", "&&", ";", ">", ">>", "<", "&"}  # of the words of a command


def main(words: list[str]) -> int:
    """Check, and run unless told only to parse; the exit code is 1 if a page lies."""
    only_parse = "--parse" in words
    names = [word for word in words if not word.startswith("-")] or sorted(
        path.relative_to(ROOT).as_posix() for pattern in PAGES for path in ROOT.glob(pattern)
    )
    began = time.monotonic()
    try:
        pages = [read_page(name, (ROOT / name).read_text("utf-8")) for name in names if name not in _NOT_OURS]
        parsed = sum(check_page(page) for page in pages)
        if not parsed:
            raise LieError("the pages should show commands in ```console blocks; there are none")
        if len(pages) > 1:
            check_studies(pages)
        named = sum(check_names(page, ROOT) for page in pages)
        print(f"{parsed} commands and {named} names on {len(pages)} pages are there", flush=True)
        if not only_parse:
            run_pages(pages)
    except LieError as lie:
        print(lie, file=sys.stderr)
        return 1
    print(f"({time.monotonic() - began:.1f} s in all)")
    return 0


# ------------------------------------------------------------------------------------------------------------- checking


def check_page(page: Page) -> int:
    """Parse all commands of a page; return how many there are.

    Raises:
        LieError: one cannot be as it stands.
    """
    count = 0
    for block in page.blocks:
        if block.is_shell:
            for number, command in [*block.commands(), *block.instead]:
                _check(page, number, command, whole=True)
                count += 1
            if not block.is_long:
                _check_is_run(page, block)
    for first, text in page.paragraphs:
        for found in _INLINE.finditer(text):
            number = first + text[: found.start()].count("\n")
            command = " ".join(found[1].split())
            _check(page, number, command, whole=False)
            count += 1
    return count


def check_studies(pages: list[Page]) -> None:
    """See that the pages say of every study how long it takes.

    Raises:
        LieError: of one they do not.
    """
    told: set[str] = set()
    for page in pages:
        blocks = [command for block in page.blocks if block.is_shell for _, command in block.commands()]
        timed = [text for _, text in page.paragraphs if re.search(TIME, text)]
        told.update(re.findall(r"coevo reproduce\s+([a-z0-9-]+)", "\n".join([*blocks, *timed])))
    lacking = set(reproduce.list_commands(click.Context(reproduce))) - told
    if lacking:
        raise LieError(f"no page says how long 'coevo reproduce {min(lacking)}' takes")


def _check_is_run(page: Page, block: Block) -> None:
    covered = _targets((ROOT / ".ci" / "run").read_text("utf-8"))
    for number, command in block.commands():
        if command.startswith("make ") and (lacking := _targets(command) - covered):
            raise LieError(f"{page.name}:{number}: .ci/run does not run 'make {min(lacking)}'; let it, or say why not")
        if page.name.startswith(_HOW_TO):
            name = page.name.removeprefix(_HOW_TO)
            if f'"{name}"' not in (ROOT / _HOW_TO_TESTS).read_text("utf-8"):
                raise LieError(f"{page.name}:{number}: {_HOW_TO_TESTS} does not follow this page")


def _check(page: Page, number: int, command: str, *, whole: bool) -> None:
    """Refuse a command that cannot be; one that is not ``whole`` may leave arguments out."""
    try:
        for words in _parts(command):
            if words[0] == "make":
                known = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
                wrong = sorted(_targets(shlex.join(words)) - known - {"TARGET"})
                if wrong:
                    raise LieError(f"there is no target {wrong[0]!r}")
            elif words[0] == "coevo":
                parse(words[1:], whole=whole)
    except (LieError, InputError, click.ClickException, ValueError) as wrong:
        said = wrong.format_message() if isinstance(wrong, click.ClickException) else wrong
        raise LieError(f"{page.name}:{number}: '{command}': {said}") from None


def _parts(command: str) -> Iterator[list[str]]:
    """Yield the words of each command in a line of the shell, without what it reads and writes."""
    lexer = shlex.shlex(command, posix=True, punctuation_chars=True)
    lexer.whitespace_split = True
    words: list[str] = []
    for word in [*lexer, ";"]:
        if word in _ENDS:
            if words:
                yield words
            words = []
        else:
            words.append(word)


def parse(words: list[str], *, whole: bool) -> None:
    """Parse what follows ``coevo``, and read the recipe that it names.

    Raises:
        InputError, click.ClickException: it is wrong.
    """
    group: click.Command = cli
    context = click.Context(cli, info_name="coevo")
    path: list[str] = []
    while isinstance(group, click.Group) and words and not words[0].startswith("-"):
        _, command, words = group.resolve_command(context, words)
        assert command is not None
        path.append(str(command.name))
        context, group = click.Context(command, info_name=command.name, parent=context), command
    if "--help" in words or (isinstance(group, click.Group) and not words):
        return
    try:
        given = group.make_context(path[-1] if path else "coevo", list(words), parent=context.parent).params
    except click.MissingParameter:
        if whole:
            raise
        return
    _read_recipes(" ".join(path), given)


def _read_recipes(path: str, given: dict[str, Any]) -> None:
    """Read what a command names, unless it is a placeholder such as RECIPE.toml or a file that a page makes."""
    argument, read = _READERS.get(path, ("", lambda _name, _changes: None))
    named = given.get(argument) or ()
    changes = given.get("assignments") or given.get("changes") or ()
    for name in (named,) if isinstance(named, str) else named:
        is_ours = not name.isupper() if not is_path(name) else (ROOT / name).is_file()
        if is_ours:
            read(str(ROOT / name) if is_path(name) else name, changes)


def _read_study(name: str) -> None:
    """Read a study; the skills that it needs of studies before it, in a folder of runs, need not be there."""
    try:
        read_plan(name)
    except InputError as error:
        if "there is no skill file runs/" not in str(error):
            raise


# The argument of a command that is the name of a recipe or a skill, and what reads it with settings replaced.
_READERS: dict[str, tuple[str, Callable[[str, tuple[str, ...]], Any]]] = {
    "evolve": ("recipe", read_experiment),
    "learn": ("source", lambda name, _: read_recipe(name)),
    "study": ("source", lambda name, _: _read_study(name)),
    "skills evaluate": ("skill", lambda name, _: load_skill(name)),
    "skills watch": ("skill", lambda name, _: None if name.endswith(".npz") else load_skill(name)),
    "reproduce categories": ("recipes", read_experiment),
    "reproduce chapter3": ("recipes", read_schedule),
    "reproduce coordination": ("source", lambda name, _: read_recipe(name)),
    "reproduce placement": ("recipe", read_experiment),
    "reproduce placement-search": ("recipe", read_experiment),
    "reproduce presets": ("recipes", read_experiment),
    "reproduce skills": ("names", lambda name, _: load_skill(name)),
}


def _targets(text: str) -> set[str]:
    """Name the targets of all `make` commands in a shell text."""
    targets: set[str] = set()
    for line in text.splitlines():
        if line.startswith("make "):
            words = shlex.split(line, comments=True)[1:]
            targets.update(word for word in words if "=" not in word and not word.startswith("-"))
    return targets


# -------------------------------------------------------------------------------------------------------------- running


def run_pages(pages: list[Page]) -> None:
    """Run the blocks of all pages, each page in a folder of its own, and print what they say in the order of the pages.

    Raises:
        LieError: a command failed, or takes too long and does not say so.
    """
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for said, lie in pool.map(_listen, pages):
            print(said, end="", flush=True)
            if lie is not None:
                raise lie


def _listen(page: Page) -> tuple[str, LieError | None]:
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as output:
        lie = None
        try:
            run_page(page, output)
        except LieError as error:
            lie = error
        output.seek(0)
        return output.read(), lie


def run_page(page: Page, output: IO[str]) -> None:
    """Run the blocks of a page in a folder of its own; what is run and what it says goes to a file.

    Raises:
        LieError: a command failed, or takes too long and does not say so.
    """
    if page.name.startswith(_HOW_TO):
        print(f"{page.name}: tests/how_to follows it", file=output)
        return
    with tempfile.TemporaryDirectory(prefix="coevo-docs-") as folder:
        for block in page.blocks:
            if block.language == "python":
                text = "\n".join(line for _, line in block.lines)
                _run(f"{page.name}:{block.lines[0][0]}", "the Python above", ["python", "-c", text], folder, output)
            elif block.is_shell:
                if block.is_long:
                    for number, command in block.commands():
                        print(f"{page.name}:{number}: $ {command}   (takes long: not run)", file=output)
                for number, command in block.instead if block.is_long else block.commands():
                    place = f"{page.name}:{number}"
                    if command.startswith("make "):
                        print(f"{place}: $ {command}   (.ci/run covers it)", file=output)
                    else:
                        print(f"{place}: $ {command}", file=output)
                        _run(place, command, ["bash", "-euo", "pipefail", "-c", command], folder, output)


def _run(place: str, what: str, words: list[str], folder: str, output: IO[str]) -> None:
    search_path = f"{ROOT / '.venv' / 'bin'}{os.pathsep}{os.environ['PATH']}"
    begin = time.monotonic()
    output.flush()  # the command writes to the same file
    try:
        code = subprocess.run(
            words,
            cwd=folder,
            env=os.environ | {"PATH": search_path},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            timeout=_TOO_LONG_S,
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        raise LieError(f"{place}: took more than {_TOO_LONG_S} s: say so, and it is not run") from None
    if code != 0:
        raise LieError(f"{place}: {what} exited with {code}")
    output.seek(0, os.SEEK_END)
    print(f"({time.monotonic() - begin:.1f} s)", file=output)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
