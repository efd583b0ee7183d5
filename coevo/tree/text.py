"""Trees as values, and as text: ``IF_ball_is_lost(search, shoot)``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from coevo.errors import InputError, nearest_name
from coevo.tree.draw import as_svg
from coevo.tree.functions import FunctionSet
from coevo.tree.nodes import Nodes
from coevo.vocabulary import CATEGORIES, PREFIX, SKILLS, THINGS, is_standard

__all__ = ["Tree", "parse"]

_TOKEN = re.compile(r"\s*([A-Za-z_]\w*|[(),])")


@dataclass(frozen=True)
class Tree(Nodes):
    """A tree as a value: it is equal to one of the same nodes, is text, and a picture where a notebook shows it."""

    def __str__(self) -> str:
        parts: list[str] = []
        open_branches: list[int] = []
        for name in self.names:
            parts.append(name)
            if name.startswith(PREFIX):
                parts.append("(")
                open_branches.append(2)
                continue
            while open_branches:
                open_branches[-1] -= 1
                if open_branches[-1]:
                    parts.append(", ")
                    break
                open_branches.pop()
                parts.append(")")
        return "".join(parts)

    def _repr_svg_(self) -> str:
        """Return the picture that a notebook shows."""
        return as_svg(self)

    def objects(self) -> set[str]:
        """Return the objects that the tree asks about."""
        return {name[len(PREFIX) :].rsplit("_is_", 1)[0] for name in self.names if name.startswith(PREFIX)}


def _tokens(text: str) -> Iterator[tuple[str, int]]:
    position = 0
    end = len(text.rstrip())
    while position < end:
        match = _TOKEN.match(text, position)
        if match is None:
            position += len(text[position:]) - len(text[position:].lstrip())
            raise InputError(f"tree: unexpected {text[position]!r} at character {position + 1}")
        yield match.group(1), match.start(1) + 1
        position = match.end()


def _check_name(name: str, at: int, functions: FunctionSet | None) -> None:
    if is_standard(name) if functions is None else name in functions.codes:
        return
    known: Iterable[str]
    if functions is None:
        things = (*THINGS, "r0", "r1", "r2")
        known = [*SKILLS, *(f"{PREFIX}{thing}_is_{category}" for thing in things for category in CATEGORIES)]
    else:
        known = functions.names
    raise InputError(f"tree: unknown name {name!r} at character {at}.{nearest_name(name, known)}")


def parse(text: str, functions: FunctionSet | None = None) -> Tree:
    """Read a tree such as ``IF_ball_is_left(shoot, IF_ball_is_lost(search, avoid))``.

    Args:
        text: functions with their two branches, and terminals.
        functions: whose names it may hold; without it those of Table 6.1.

    Raises:
        InputError: the text is no tree; says what was expected and where.

    Example:
        >>> from coevo.tree import parse
        >>> tree = parse("IF_ball_is_left(shoot, IF_ball_is_lost(search, avoid))")
        >>> tree.depth, tree.nodes, tree.second
        (2, 5, (2, 0, 4, 0, 0))
        >>> print(tree)
        IF_ball_is_left(shoot, IF_ball_is_lost(search, avoid))
        >>> parse("IF_ball_is_lefft(shoot, avoid)")
        Traceback (most recent call last):
        coevo.errors.InputError: tree: unknown name 'IF_ball_is_lefft' at character 1. Did you mean 'IF_ball_is_left'?
    """
    names: list[str] = []
    # What may come next: a node, or a fixed mark. The stack keeps what must follow.
    expected = ["node"]
    for word, at in _tokens(text):
        if not expected:
            raise InputError(f"tree: expected the end after character {at - 1}, got {word!r}")
        want = expected.pop()
        if want != "node":
            if word != want:
                raise InputError(f"tree: expected {want!r} at character {at}, got {word!r}")
            continue
        if word in ("(", ")", ","):
            terminals = ", ".join(SKILLS if functions is None else functions.terminals)
            raise InputError(f"tree: expected IF_... or a terminal ({terminals}) at character {at}, got {word!r}")
        _check_name(word, at, functions)
        names.append(word)
        if word.startswith(PREFIX):
            expected += [")", "node", ",", "node", "("]
    if expected:
        raise InputError(
            f"tree: the text ends where {'a node' if expected[-1] == 'node' else repr(expected[-1])} was expected"
        )
    return Tree(tuple(names))
