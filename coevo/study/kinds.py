"""What a study can run: kinds of recipes, each with what reads, checks and runs one of its recipes.

Evolution is one. Packages beside coevo add theirs as entry points of the group ``coevo.studies``, whose name is the
kind that a recipe says it is; so coevo knows nothing of learning.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Protocol

from coevo.config import FileSettings
from coevo.errors import InputError

__all__ = ["Cell", "StudyKind", "kind_named", "kind_names"]

Cell = int | float | str
"""What a table holds."""


class StudyKind(Protocol):
    """How recipes of one kind are run in a study; all of it can be used by several processes at a time."""

    @property
    def measured(self) -> tuple[str, ...]:
        """What is measured of a finished run; where this has changed, finished runs are measured again."""

    @property
    def headlines(self) -> tuple[str, ...]:
        """How the names of those columns end that people look at first; they are shares."""

    def recipes(self) -> Mapping[str, Path]:
        """Return the recipes that can be given by name."""

    def settings(self, data: Mapping[str, Any], source: str) -> FileSettings:
        """Make the settings of a run from plain data.

        Raises:
            InputError: they are wrong; the message begins with ``source``.
        """

    def check(self, settings: FileSettings, folders: Sequence[Path]) -> list[Path]:
        """Try what can be tried before anything is made; return the files of one's own that the run needs.

        Args:
            settings: of a run.
            folders: where code of one's own is looked for.

        Raises:
            InputError: the run could not be made.
        """

    def warm_up(self, settings: FileSettings, tell: Callable[[str], None]) -> None:
        """Load the machine code of such runs, or compile it; ``tell`` receives a line if that takes long."""

    def is_whole(self, folder: Path, settings: FileSettings) -> bool:
        """Tell whether a folder holds all of a run; quickly."""

    def run(
        self, settings: FileSettings, folder: Path, folders: Sequence[Path], tick: Callable[[], None]
    ) -> dict[str, Cell]:
        """Bring a run to its end, from wherever it is, and return what it came to, by column.

        Args:
            settings: of the run.
            folder: where it is, or will be: there may be nothing, or what a process left that was killed.
            folders: where code of one's own is looked for.
            tick: called now and then, when everything is safe on disk; it raises when the run is to be left.

        Raises:
            InputError: it cannot be done.
        """


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
