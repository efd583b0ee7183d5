"""What a kind of recipes must be able to do for a study: read, check and run one of its recipes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from coevo.config import FileSettings

__all__ = ["Cell", "Headlines", "StudyKind"]

Cell = int | float | str
"""What a table holds."""


class Headlines(NamedTuple):
    """Columns that people look at first, a table of its own.

    ends: how their names end. least, most: what they can be, where their intervals end; shares as a rule.
    """

    ends: tuple[str, ...]
    least: float = 0.0
    most: float = 1.0


class StudyKind(Protocol):
    """How recipes of one kind are run in a study; all of it can be used by several processes at a time."""

    @property
    def measured(self) -> tuple[str, ...]:
        """What is measured of a finished run; where this has changed, finished runs are measured again."""

    @property
    def headlines(self) -> tuple[Headlines, ...]:
        """What people look at first."""

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
