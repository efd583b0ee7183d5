"""What reports of studies share: numbers with intervals in words, and tables and figures in a folder."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
import pandas as pd

from analysis.charts import chart_bytes
from coevo.console import output_options, show, table
from coevo.errors import InputError
from coevo.statistics import mean_interval

if TYPE_CHECKING:
    import altair as alt

__all__ = ["Report", "Rows", "frame_table", "mean_words", "report_options", "write_report"]

Rows = list[list[str]]
Report = dict[str, tuple[list[str], Rows]]
"""By the name of a table its header and rows."""


def report_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the folder of a study, where its report goes, and how it is shown."""
    path = click.Path(path_type=Path)
    where = click.option("--out", type=path, help="Where tables and figures go; by default FOLDER/report.")
    return click.argument("folder", type=path)(where(output_options(command)))


def mean_words(values: Sequence[float], *, least: float = 0.0, most: float = np.inf) -> str:
    """Return the mean over sets with its interval, cut at what it can be; nothing of no set.

    Example:
        >>> from analysis.written import mean_words
        >>> mean_words([0.1, 0.2, 0.3])
        '0.200 [0.000, 0.448]'
    """
    if not len(values):
        return ""
    mean, low, high = mean_interval(values)
    told = [f"{round(value, 3) + 0.0:.3f}" for value in (mean, max(least, low), min(most, high))]  # no "-0.000"
    return told[0] + (f" [{told[1]}, {told[2]}]" if len(values) > 1 else "")


def frame_table(frame: pd.DataFrame) -> tuple[list[str], Rows]:
    """Return a table of pandas as header and rows, numbers with four digits after the point."""
    return [str(column) for column in frame], [[_text(cell) for cell in row] for row in frame.to_numpy(object)]


def _text(cell: Any) -> str:
    return str(cell) if not isinstance(cell, float) else "" if np.isnan(cell) else f"{cell:.4f}"


def write_report(
    out: Path, shown: Report, others: Report, figures: Mapping[str, alt.TopLevelMixin], *, as_json: bool
) -> None:
    """Write tables as CSV and figures as SVG, and print the tables.

    Args:
        out: the folder.
        shown, others: tables, the first of which are printed.
        figures: by the names of their files.
        as_json: print all of them as JSON instead.

    Raises:
        InputError: the folder cannot be written.
    """
    everything = shown | others
    texts = [f"{name}\n{table(header, rows)}\n" for name, (header, rows) in shown.items() if rows]
    pictures = {name: chart_bytes(chart, ".svg") for name, chart in figures.items()}
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, (header, rows) in everything.items():
            with (out / f"{name}.csv").open("w", encoding="utf-8", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows([header, *rows])
        for name, picture in pictures.items():
            (out / name).write_bytes(picture)
    except OSError as error:
        raise InputError(f"cannot write into {out}: {error.strerror or error}; choose another --out") from None
    tables = {
        name: [dict(zip(header, row, strict=True)) for row in rows] for name, (header, rows) in everything.items()
    }
    written = {"folder": str(out), "figures": sorted(pictures), "tables": tables}
    show(written, "\n".join([*texts, f"Written: {out}"]), as_json=as_json)
