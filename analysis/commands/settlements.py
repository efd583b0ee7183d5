"""coevo settlements."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from coevo.console import note, output_options, show, worker_options
from coevo.console import table as text_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd

    from coevo.settlement import Settled

__all__ = ["settlements"]


@click.command()
@click.argument("folders", metavar="RUN...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--games", type=click.IntRange(min=1), default=400, show_default=True, help="Fresh games of each run's champions."
)
@click.option("--out", type=click.Path(path_type=Path), help="A row a run, as .csv.")
@worker_options
@output_options
def settlements(
    *,
    folders: tuple[Path, ...],
    games: int,
    out: Path | None,
    workers: int,
    backend: str,
    as_json: bool,
    quiet: bool,
) -> None:
    """Say how games between the last champions of runs end: by a pass, alone, by interception, ..., and since when.

    Runs that differ in the seed alone are one group; intervals are over its runs.

    \b
    Example: coevo settlements runs/three-learners-seed0
             coevo settlements runs/three-learners-seed* --out settlements.csv
    """
    import pandas as pd

    from analysis.charts import check_out, save
    from analysis.groups import check_apart, group_names, open_runs, run_names, unfinished
    from analysis.settlements import over_runs
    from coevo.evolution.evaluation import Evaluator, check_backend
    from coevo.game import prepare
    from coevo.settlement import check_settled, settle, settlement_columns

    check_backend(backend)
    if out is not None:
        check_out(out, (".csv",))
    runs = open_runs(folders)
    check_apart(runs)
    for run in runs:
        check_settled(run)
    for text in unfinished(runs):
        note(text, quiet=quiet)
    prepare(runs[0].config, lambda text: note(text, quiet=quiet))
    found = []
    for run in runs:
        note(f"{run.path}: {games} games ...", quiet=quiet)
        with Evaluator(run.config, workers=workers, backend=backend, folders=run.folders) as evaluator:
            found.append(settle(run, evaluator, games=games))
    groups = group_names(runs)
    named = dict(zip(run_names(runs), found, strict=True))
    rows = [{"run": name, "group": groups[name], **settlement_columns(one)} for name, one in named.items()]
    if out is not None:
        save(None, pd.DataFrame(rows), out)
    parts, told = [], []
    for group in dict.fromkeys(groups.values()):
        mine = [one for name, one in named.items() if groups[name] == group]
        patterns = over_runs(mine)
        parts.append(_text(group, patterns, mine))
        told.append({"group": group, "patterns": [_plain(row) for row in patterns.to_dict("records")]})
    written = "" if out is None else f"\n\nWritten: {out}"
    data = {"games": games, "runs": [_plain(row) for row in rows], "groups": told}
    show(data, "\n\n".join(parts) + written, as_json=as_json)


def _plain(row: dict[Any, Any]) -> dict[str, Any]:
    """Return a row as JSON can hold it."""
    return {
        str(key): None if isinstance(value, float) and not math.isfinite(value) else value for key, value in row.items()
    }


def _text(group: str, patterns: pd.DataFrame, settled: Sequence[Settled]) -> str:
    several = len(settled) > 1
    header = ["pattern", f"share of games{', over runs [95 %]' if several else ''}"]
    header += ["most frequent in"] if several else []
    rows = []
    for row in patterns.to_dict("records"):
        if row["runs"] == 0:
            continue
        interval = f" [{row['low']:.3f}, {row['high']:.3f}]" if several else ""
        rows.append([row["pattern"], f"{row['share']:.3f}{interval}", *([f"{row['most']} runs"] if several else [])])
    lines = [f"{group}: how games between the last champions end", text_table(header, rows)]
    others = ", ".join(settled[0].others)
    if others:
        since = [one.take_over for one in settled if one.take_over is not None]
        verb = f"took over in {len(since)} of {len(settled)} runs" if several else "took over" if since else ""
        when = f", in generation {', '.join(map(str, sorted(since)))}" if since else ""
        lines.append(f"{others} {verb}{when}." if verb else f"{others} did not take over for good.")
    return "\n".join(lines)
