"""What a page is made of: sections, and in them texts, tables, charts with the table behind each, trees, replays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import pandas as pd

__all__ = [
    "Code",
    "Figure",
    "Heading",
    "Part",
    "Picture",
    "Player",
    "Points",
    "Section",
    "Short",
    "Table",
    "Text",
    "cells",
]


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str
    kind: ClassVar[str] = "text"


@dataclass(frozen=True)
class Short:
    """What the page says in short: a few paragraphs that stand out."""

    texts: Sequence[str]
    kind: ClassVar[str] = "short"


@dataclass(frozen=True)
class Points:
    """A list."""

    texts: Sequence[str]
    kind: ClassVar[str] = "list"


@dataclass(frozen=True)
class Heading:
    """A heading within a section."""

    text: str
    kind: ClassVar[str] = "heading"


@dataclass(frozen=True)
class Code:
    """What is typed, or a file; folded under ``summary`` if there is one."""

    text: str
    summary: str = ""
    kind: ClassVar[str] = "code"


@dataclass(frozen=True)
class Table:
    """A table of texts; the first cell of a row is its heading."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    kind: ClassVar[str] = "table"


@dataclass(frozen=True)
class Figure:
    """A chart, and the table behind it.

    Attributes:
        title: what it shows.
        about: how to read it.
        spec: Vega-Lite without a look.
        header, rows: the table.
        number: of the chart on the page; given by the page.
    """

    title: str
    about: str
    spec: dict[str, Any]
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    number: int = field(default=-1)
    kind: ClassVar[str] = "figure"


@dataclass(frozen=True)
class Picture:
    """A picture of our own making, as SVG."""

    title: str
    about: str
    svg: str
    kind: ClassVar[str] = "picture"


@dataclass(frozen=True)
class Player:
    """A page that plays games, shown within this one."""

    title: str
    about: str
    page: str
    kind: ClassVar[str] = "player"


Part = Text | Short | Points | Heading | Code | Table | Figure | Picture | Player


@dataclass(frozen=True)
class Section:
    """A section of the page: ``name`` in the list of contents, ``title`` above it."""

    id: str
    name: str
    title: str
    parts: Sequence[Part]


_LARGE = 1000.0


def _cell(value: object) -> str:
    if isinstance(value, float):
        if not math.isfinite(value):
            return ""
        return f"{value:.0f}" if value.is_integer() or abs(value) >= _LARGE else f"{value:.4g}"
    return str(value)


def cells(frame: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of a table as texts, numbers with four digits."""
    rows = [[_cell(value) for value in row] for row in frame.itertuples(index=False)]
    return [str(name) for name in frame.columns], rows
