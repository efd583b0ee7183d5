"""What trees are made of: functions that ask and have two branches, terminals that answer."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from deap import gp

from coevo.vocabulary import PREFIX

__all__ = ["FunctionSet", "Situations"]

# What can be true at a time of conditions that belong together: each set holds the names of those that then are.
Situations = tuple[frozenset[str], ...]

_MOST_NAMES = 255  # a node of a stored tree is one byte
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


@dataclass(frozen=True)
class FunctionSet:
    """What the trees of one role are made of.

    A node's code is the number of its function or, after all functions, of its terminal.

    Attributes:
        functions: names that begin with ``IF_``; each asks something and has two branches, "yes" first.
        terminals: names that do not begin so; what a tree decides for.
        situations: for each group of functions whose answers depend on each other, all that can be true at a time.
            A function in no group is a question of its own. Only ``coevo.tree.situations`` looks at them.
        descriptions: what a terminal does, in words that go on a sentence ("drives the ball into the goal"), for any
            of them: for people, who read it beside the name.

    Raises:
        ValueError: a name cannot be used, or there are too many.

    Example:
        >>> from coevo.tree import FunctionSet
        >>> FunctionSet(("IF_dark",), ("yes", "no")).codes
        {'IF_dark': 0, 'yes': 1, 'no': 2}
    """

    functions: tuple[str, ...]
    terminals: tuple[str, ...]
    situations: tuple[Situations, ...] = ()
    descriptions: Mapping[str, str] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        if not self.functions or not self.terminals:
            raise ValueError("a function set needs at least one function and one terminal")
        for name in self.names:
            if not _NAME.fullmatch(name) or name.startswith(PREFIX) != (name in self.functions):
                raise ValueError(
                    f"expected names of letters, digits and _, those of functions beginning with {PREFIX} and those of"
                    f" terminals not; got {name!r}"
                )
        if len(set(self.names)) < len(self.names):
            raise ValueError("expected every name of a function set once")
        unknown = sorted(set(self.descriptions) - set(self.terminals))
        if unknown:
            raise ValueError(f"descriptions: {unknown[0]!r} is no terminal; they are {', '.join(self.terminals)}")
        if len(self.names) > _MOST_NAMES:
            raise ValueError(f"expected at most {_MOST_NAMES} functions and terminals, got {len(self.names)}")

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of functions, then of terminals: a node's name by its code."""
        return self.functions + self.terminals

    @cached_property
    def codes(self) -> dict[str, int]:
        """A node's code by its name."""
        return {name: code for code, name in enumerate(self.names)}

    @cached_property
    def primitives(self) -> gp.PrimitiveSet:
        """The same as DEAP's primitive set, for its generators and operators."""
        primitives = gp.PrimitiveSet("tree", 0)
        for name in self.functions:
            primitives.addPrimitive(_if, 2, name=name)
        for name in self.terminals:
            primitives.addTerminal(name, name=name)
        return primitives

    @cached_property
    def nodes(self) -> tuple[gp.Primitive | gp.Terminal, ...]:
        """DEAP's nodes by code."""
        mapping = self.primitives.mapping
        return tuple(mapping[name] for name in self.names)


def _if(_first: object, _second: object) -> None:  # pragma: no cover - DEAP wants a callable; programs run compiled
    """Stand for a function in DEAP's primitive set; never called."""
