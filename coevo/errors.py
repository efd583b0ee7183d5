"""Errors that are the user's to mend: shown as one or two plain lines, never as a traceback."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = ["InputError", "MissingFileError", "nearest_name"]


_MOST_LETTERS = 3000  # of a message: what came may be of any length
_LAST_LETTERS = 400  # of it that are kept: what to do


class InputError(ValueError):
    """Something the user gave cannot be used; the message says what was expected, what came and what to do."""

    def __str__(self) -> str:
        text = super().__str__()
        if len(text) <= _MOST_LETTERS:
            return text
        return f"{text[: _MOST_LETTERS - _LAST_LETTERS]} ... {text[-_LAST_LETTERS:]}"


class MissingFileError(InputError):
    """A file that settings name is not there; something else may make it."""


def nearest_name(word: str, names: Iterable[str]) -> str:
    """Return ``" Did you mean 'name'?"`` for the nearest of ``names``, or an empty string if none is near."""
    near = difflib.get_close_matches(word, list(names), n=1, cutoff=0.5)
    return f" Did you mean {near[0]!r}?" if near else ""
