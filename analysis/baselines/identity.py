"""Names of what is kept in a run folder, by what it depends on."""

from __future__ import annotations

import hashlib

from coevo.contest import LineUp

__all__ = ["digest", "identity"]


def identity(line_up: LineUp) -> list[tuple[int, bytes]]:
    """Return what a line-up is: equal for equal programs of the same roles."""
    return [(role, program.codes.tobytes()) for role, program in sorted(line_up.items())]


def digest(*parts: object) -> str:
    """Return twelve digits that differ where the parts do, for parts whose ``repr`` says all of them."""
    return hashlib.sha256("\n".join(map(repr, parts)).encode()).hexdigest()[:12]
