"""Blocks of code and paragraphs of a Markdown page."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

__all__ = ["TIME", "Block", "LieError", "Page", "read_page"]

# A length of time in words, such as "about 10 minutes on two cores".
TIME = r"\b(?:\d[\d.,]*|an?|one|two|three|few|half|quarter)(?:\s+\w+){0,3}?\s+(?:seconds?|minutes?|hours?)\b"

_LONG = re.compile(rf"\*Takes [^;]*{TIME}[^;]*; not run by the tests, .+\.\*")
_INSTEAD = re.compile(r"<!--\s*instead:\s*(.*?)\s*-->")
_FENCE = re.compile(r"(`{3,}|~{3,})\s*(\S*)")
_COMMAND = re.compile(r"(?:\$ )?(?:coevo|make) ")
_SHELL = {"console", "sh", "shell", "bash"}


class LieError(Exception):
    """A page says what does not hold."""


@dataclass
class Block:
    """A block of code.

    Attributes:
        language: as the fence says.
        is_long: the page says that it takes too long to be run.
        instead: commands that are run in its place, with their line numbers.
        lines: the text, with line numbers.
    """

    language: str
    is_long: bool = False
    instead: list[tuple[int, str]] = field(default_factory=list)
    lines: list[tuple[int, str]] = field(default_factory=list)

    @property
    def is_shell(self) -> bool:
        """Whether it holds commands."""
        return self.language in _SHELL

    def commands(self) -> Iterator[tuple[int, str]]:
        """Yield the commands with their line numbers; a line that ends in a backslash goes on in the next."""
        command, first = "", 0
        for number, line in self.lines:
            bare = line.strip()
            if not command:
                if not bare or bare.startswith("#") or (self.language == "console" and not bare.startswith("$ ")):
                    continue
                first = number
            command += (" " if command else "") + bare.removeprefix("$ ")
            if command.endswith("\\"):
                command = command[:-1].rstrip()
            else:
                yield first, command
                command = ""


@dataclass
class Page:
    """A page: its blocks, and its paragraphs without them, each with the number of its first line."""

    name: str
    blocks: list[Block] = field(default_factory=list)
    paragraphs: list[tuple[int, str]] = field(default_factory=list)


def read_page(name: str, text: str) -> Page:
    """Return the blocks and paragraphs of a page.

    Raises:
        LieError: commands stand in a block that is not marked as such, or what is run instead of them has no place.
    """
    reader = _Reader(Page(name))
    for number, line in enumerate(text.splitlines(), start=1):
        reader.take(number, line)
    if reader.instead:
        raise LieError(f"{name}:{reader.instead[0][0]}: no block of commands follows")
    return reader.page


@dataclass
class _Reader:
    """What has been read of a page. ``before``: the line before, empty after the end of a paragraph."""

    page: Page
    block: Block | None = None
    fence: str = ""
    before: str = ""
    instead: list[tuple[int, str]] = field(default_factory=list)

    def take(self, number: int, line: str) -> None:
        """Read a line."""
        bare = line.strip()
        if self.block is not None:
            self._take_code(self.block, number, line)
        elif opening := _FENCE.match(bare):
            self._open(number, *opening.groups())
        elif mark := _INSTEAD.fullmatch(bare):
            self.instead.append((number, mark[1]))
        elif bare:
            self._take_words(number, line)
        elif not _LONG.fullmatch(self.before):  # between this mark and its block there may be empty lines
            self.before = ""

    def _open(self, number: int, fence: str, language: str) -> None:
        self.fence, self.block = fence, Block(language, bool(_LONG.fullmatch(self.before)), self.instead)
        if self.instead and not self.block.is_long:
            raise LieError(
                f"{self.page.name}:{number}: say how long it takes: '*Takes ...; not run by the tests, as ....*'"
            )
        self.page.blocks.append(self.block)
        self.instead, self.before = [], ""

    def _take_code(self, block: Block, number: int, line: str) -> None:
        if line.strip() == self.fence:
            self.block = None
            return
        block.lines.append((number, line))
        if not block.is_shell and _COMMAND.match(line.strip()):
            raise LieError(f"{self.page.name}:{number}: mark a block of commands with ```console")

    def _take_words(self, number: int, line: str) -> None:
        bare, paragraphs = line.strip(), self.page.paragraphs
        if line.startswith("    ") and _COMMAND.match(bare):
            raise LieError(f"{self.page.name}:{number}: put commands into a ```console block")
        if self.before:
            first, said = paragraphs[-1]
            paragraphs[-1] = first, f"{said}\n{bare}"
        else:
            paragraphs.append((number, bare))
        self.before = bare
