"""Kinds of recipes that a study can run.

Evolution is one. Packages beside coevo add theirs as entry points of the group ``coevo.studies``, whose name is the
kind that a recipe says it is; so coevo knows nothing of learning.
"""

from __future__ import annotations

import importlib.metadata
from functools import cache

from coevo.errors import InputError
from coevo.study.kinds import StudyKind

__all__ = ["kind_named", "kind_names"]


@cache
def _added() -> dict[str, importlib.metadata.EntryPoint]:
    return {point.name: point for point in importlib.metadata.entry_points(group="coevo.studies")}


def kind_names() -> list[str]:
    """Return the kinds of recipes that a study can run, evolution first."""
    return ["evolution", *sorted(set(_added()) - {"evolution"})]


@cache
def kind_named(name: str) -> StudyKind:
    """Return a kind by its name.

    Raises:
        InputError: there is none.
    """
    if name == "evolution":
        from coevo.study.evolving import EvolutionRuns  # noqa: PLC0415 - only who runs studies needs all of it

        return EvolutionRuns()
    if name not in _added():
        raise InputError(f"a study runs recipes of the kind {' or '.join(map(repr, kind_names()))}, got {name!r}")
    kind: StudyKind = _added()[name].load()()
    return kind
