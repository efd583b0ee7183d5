"""A chain of digests: what was written, in its order, each line fixed when it is written.

``digests.txt`` has a line for each thing: its name, its SHA-256, and the SHA-256 of the line before with both. So a
line cannot be changed, left out or put elsewhere without all lines after it: who keeps the last one can tell whether
anything before it is as it was.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Self

__all__ = ["Chain", "rows_digest", "sha256"]

_HEADER = "what,sha256,chain"


def sha256(data: bytes) -> str:
    """Return a digest as hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def rows_digest(lines: Sequence[str]) -> str:
    """Return the SHA-256 of lines of a table."""
    return sha256(("\n".join(lines) + "\n").encode())


class Chain:
    """Digests by name, in the order in which they were fixed."""

    def __init__(self, links: Iterable[tuple[str, str, str]] = ()) -> None:
        self._links = tuple(links)
        self.digests: Mapping[str, str] = {name: digest for name, digest, _ in self._links}

    @property
    def head(self) -> str:
        """The last of the chain, which follows from everything before."""
        return self._links[-1][2] if self._links else sha256(_HEADER.encode())

    @property
    def heads(self) -> frozenset[str]:
        """What was its head at any time."""
        return frozenset(head for _, _, head in self._links)

    def extended(self, digests: Mapping[str, str]) -> Self:
        """Return the chain with more digests at its end."""
        links, head = list(self._links), self.head
        for name, digest in digests.items():
            head = sha256(f"{head},{name},{digest}".encode())
            links.append((name, digest, head))
        return type(self)(links)

    def text(self) -> str:
        """Return it as the file holds it."""
        return "\n".join([_HEADER, *(",".join(link) for link in self._links)]) + "\n"

    @classmethod
    def read(cls, text: str) -> Self:
        """Return the chain of a file.

        Raises:
            ValueError: a line is missing or was changed.
        """
        lines = text.splitlines()
        if not text.endswith("\n") or not lines or lines[0] != _HEADER:
            raise ValueError("it is no chain of digests")
        cells = [line.split(",") for line in lines[1:]]
        if any(len(row) != 3 for row in cells):
            raise ValueError("a line has other columns")
        made = cls().extended({name: digest for name, digest, _ in cells})
        if made.text() != text:
            raise ValueError("its lines do not follow from each other")
        return made
