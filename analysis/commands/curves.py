"""coevo curves."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from coevo.console import emit, note, output_options
from coevo.console import table as text_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd

    from coevo.run import Run

__all__ = ["curves"]

_LEVELS = "▁▂▃▄▅▆▇█"
_SPARK_WIDTH = 24
_ESTIMATES = {"mean": "mean", "iqm": "IQM"}


@click.command()
@click.argument("folders", metavar="RUN...", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--measure",
    "measures",
    multiple=True,
    metavar="NAME",
    help="Such as goals; may be repeated. 'use' and 'diversity' are several. By default fitness, counts and sizes.",
)
@click.option(
    "--statistic",
    "statistics",
    multiple=True,
    type=click.Choice(["best", "mean", "worst"]),
    help="May be repeated; by default all three in pictures, best and mean as text.",
)
@click.option(
    "--estimator",
    type=click.Choice(["mean", "iqm"]),
    default="mean",
    show_default=True,
    help="Over runs: their mean, or that of their middle half.",
)
@click.option("--out", type=click.Path(path_type=Path), help="A picture .svg, .png or .html, or the table as .csv.")
@output_options
def curves(
    *,
    folders: tuple[Path, ...],
    measures: tuple[str, ...],
    statistics: tuple[str, ...],
    estimator: str,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Show how fitness and every measure went over the generations of one or several runs.

    Runs that differ in the seed alone are one group: what is shown is an estimate over them, with its 95 % interval.
    Several groups stand side by side.

    \b
    Example: coevo curves runs/smoke-seed0
             coevo curves runs/three-learners-seed* --measure goals --out goals.svg
             coevo curves runs/smoke-seed0 --out curves.csv
    """
    from analysis.charts import altair, check_out, save
    from analysis.curve_chart import chart, words_for
    from analysis.curves import STATISTICS, choose, overview, summary, table
    from analysis.groups import group_names, open_runs, run_names

    if out is not None:
        check_out(out)
    is_table = out is not None and out.suffix.lower() == ".csv"
    if out is not None and not is_table:
        altair()
    runs = open_runs(folders)
    everything = table(runs)
    groups = group_names(runs)
    _tell_unfinished(runs, quiet=quiet or as_json)
    chosen = choose(everything, measures or overview(everything), statistics or STATISTICS)
    found = summary(chosen, groups, estimator)
    if out is not None:
        rows = chosen if measures else everything[everything["statistic"].isin(statistics or STATISTICS)]
        save(None if is_table else chart(found, words_for(runs, estimator)), rows, out)
    if as_json:
        told = [
            {"run": name, "folder": str(run.path), "group": groups[name], "generations": run.finished}
            for name, run in zip(run_names(runs), runs, strict=True)
        ]
        emit(
            {
                "runs": told,
                "estimator": estimator,
                "measures": list(dict.fromkeys(found["measure"])),
                "curves": _plain(found),
                "written": None if out is None else str(out),
            }
        )
    elif out is not None:
        click.echo(f"Written: {out}")
    else:
        shown = found[found["statistic"].isin(statistics or ("best", "mean"))]
        click.echo(_as_text(shown if len(shown) else found, estimator))
        note("For a picture add --out curves.svg (or .png, .html), for all numbers --out curves.csv", quiet=quiet)


def _tell_unfinished(runs: Sequence[Run], *, quiet: bool) -> None:
    for run in runs:
        if not run.is_finished:
            note(f"{run.path} has finished {run.finished} of {run.config.gp.generations} generations", quiet=quiet)


def _plain(found: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows as JSON can hold them."""
    return [
        {
            str(key): None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in row.items()
        }
        for row in found.to_dict("records")
    ]


def _as_text(found: pd.DataFrame, estimator: str) -> str:
    """Return a table of the first, the middle and the last generation of each group."""
    parts = []
    for group, of_group in found.groupby("group", sort=False):
        last = int(of_group["generation"].max())
        shown = sorted({0, last // 2, last})
        runs = int(of_group["runs"].max())
        over = f", {_ESTIMATES[estimator]} of {runs} runs with 95 % interval" if runs > 1 else ""
        direction = " (fitness: smaller is better)" if "fitness" in set(of_group["measure"]) else ""
        header = ["robot", "measure", "statistic", *(f"gen. {generation}" for generation in shown)]
        header += ["course"] if sys.stdout.isatty() else []
        rows = []
        robots = {name: number for number, name in enumerate(dict.fromkeys(of_group["robot"]))}
        ordered = of_group.sort_values("robot", key=lambda names: names.map(robots), kind="stable")
        for (robot, measure, statistic), line in ordered.groupby(["robot", "measure", "statistic"], sort=False):
            numbers = zip(line["generation"], line["value"], line["low"], line["high"], strict=True)
            cells_at = {generation: _cell(*found) for generation, *found in numbers}
            cells = [cells_at.get(one, "") for one in shown]
            course = [_spark(line["value"].tolist())] if sys.stdout.isatty() else []
            rows.append([str(robot), str(measure), str(statistic), *cells, *course])
        parts.append(f"{group}{over}{direction}\n{text_table(header, rows)}")
    return "\n\n".join(parts)


def _cell(value: float, low: float, high: float) -> str:
    if not math.isfinite(value):
        return "-"
    return f"{value:.4g}" + (f" [{low:.4g}, {high:.4g}]" if math.isfinite(low) else "")


def _spark(values: Sequence[float]) -> str:
    """Return a line of blocks as high as the values, from the least to the greatest."""
    width = min(_SPARK_WIDTH, len(values))
    picked = [values[round(k * (len(values) - 1) / max(1, width - 1))] for k in range(width)]
    known = [value for value in picked if math.isfinite(value)]
    low, high = (min(known), max(known)) if known else (0.0, 0.0)
    step = (high - low) / (len(_LEVELS) - 1) or 1.0
    return "".join(_LEVELS[round((value - low) / step)] if math.isfinite(value) else " " for value in picked)
