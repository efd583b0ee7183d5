"""Which conditions depend on each other, and what can be true of them at a time."""

from __future__ import annotations

from collections.abc import Iterable

from coevo.tree.functions import FunctionSet, Situations
from coevo.vocabulary import CATEGORIES, PREFIX, is_standard

__all__ = ["condition_groups", "object_situations"]


def object_situations(thing: str) -> Situations:
    """Return what can be seen of an object, in words of Table 6.1: it is lost, or in one place with one size."""
    sights = [("lost",), *((place, size) for place in CATEGORIES[:3] for size in CATEGORIES[3:6])]
    return tuple(frozenset(f"{PREFIX}{thing}_is_{category}" for category in sight) for sight in sights)


def condition_groups(
    names: Iterable[str], functions: FunctionSet | None = None
) -> tuple[tuple[Situations, ...], dict[str, int]]:
    """Return what can be true at a time of conditions that depend on each other, and the group of each condition.

    Args:
        names: of nodes of a tree; a condition that depends on no other is a group of its own.
        functions: says which depend on each other; without it they are those of Table 6.1.
    """
    asked = {name for name in names if name.startswith(PREFIX)}
    if functions is not None:
        groups = functions.situations
    else:
        things = {name[len(PREFIX) :].rsplit("_is_", 1)[0] for name in asked if "_is_" in name and is_standard(name)}
        groups = tuple(object_situations(thing) for thing in sorted(things))
    number = {name: n for n, group in enumerate(groups) for situation in group for name in situation}
    alone = sorted(asked - number.keys())
    number |= {name: len(groups) + n for n, name in enumerate(alone)}
    return groups + tuple((frozenset({name}), frozenset[str]()) for name in alone), number
