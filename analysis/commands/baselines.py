"""coevo baselines."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from coevo.console import note, output_options, show, worker_options
from coevo.console import table as text_table
from coevo.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import pandas as pd

    from coevo.run import Run

__all__ = ["baselines"]

_BESIDE = {"random search": "random search", "other run": "the other run"}  # kinds of a run beside, and in a sentence


@click.command()
@click.argument("folders", metavar="RUN...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--games", type=click.IntRange(min=1), default=400, show_default=True, help="Fresh games of each team, the same."
)
@click.option(
    "--search-games",
    type=click.IntRange(min=1),
    default=40_000,
    show_default=True,
    help="Games of the search among small trees.",
)
@click.option(
    "--depth", type=click.IntRange(min=1, max=4), default=1, show_default=True, help="Of the deepest small tree."
)
@click.option("--team", type=click.IntRange(min=0), help="Number of the team; by default each that evolves.")
@click.option(
    "--hand",
    type=click.Path(path_type=Path),
    metavar="FILE.toml",
    help="Hand-typed teams of your own, instead of those that are shipped and those of the recipe.",
)
@click.option(
    "--beside",
    "--random",
    "beside",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="RUN",
    help="Another run of the same game, by random search or by other settings of evolution; one for each run, in"
    " their order.",
)
@click.option(
    "--cross-play",
    is_flag=True,
    help="Opponents are the last champions of the other RUNs, who did not evolve against those that are asked about.",
)
@click.option("--out", type=click.Path(path_type=Path), help="All rows, as .csv.")
@worker_options
@output_options
def baselines(
    *,
    folders: tuple[Path, ...],
    games: int,
    search_games: int,
    depth: int,
    team: int | None,
    hand: Path | None,
    beside: tuple[Path, ...],
    cross_play: bool,
    out: Path | None,
    workers: int,
    backend: str,
    as_json: bool,
    quiet: bool,
) -> None:
    """Compare the last champions of runs with what is simpler, by games that neither was chosen by.

    \b
    Baselines are the best team in which each robot uses one skill throughout, the best team of small trees, the best
    hand-typed team, and random search with equally many games; other settings of evolution can be put beside, too. Of
    several runs the runs are what is counted.
    Example: coevo baselines runs/three-learners-seed0
             coevo baselines runs/mine-seed* --hand teams.toml --beside runs/random-seed0 --beside runs/random-seed1
             coevo baselines runs/three-learners-seed* --cross-play
    """
    import pandas as pd

    from analysis.baselines.compare import check_comparable, over_runs, table
    from analysis.baselines.hand_typed import hand_typed_of, read_hand_typed
    from analysis.charts import check_out, save
    from analysis.groups import check_apart, group_names, open_runs, run_names
    from coevo.contest import evolving_teams
    from coevo.evolution.evaluation import Evaluator, check_backend
    from coevo.game import prepare

    check_backend(backend)
    if out is not None:
        check_out(out, (".csv",))
    runs = open_runs(folders)
    check_apart(runs)
    if cross_play and len(runs) < 2:
        raise InputError(
            "expected two runs or more with --cross-play, as the champions of each meet those of the others"
        )
    met = [[one for one in runs if one is not run] if cross_play else [] for run in runs]
    others = _paired(runs, beside)
    typed = [hand_typed_of(run) if hand is None else read_hand_typed(run.game, hand) for run in runs]
    for run, other, opponents in zip(runs, others, met, strict=True):
        check_comparable(run, team, other, opponents)
    _note_unequal(runs, others, quiet=quiet)
    frames = []

    def tell(text: str) -> None:
        note(text, quiet=quiet)

    one = partial(table, games=games, search_games=search_games, depth=depth, team=team, tell=tell)
    prepare(runs[0].config, tell)
    try:
        for run, other, teams, opponents in zip(runs, others, typed, met, strict=True):
            with Evaluator(run.config, workers=workers, backend=backend, folders=run.folders) as evaluator:
                note(f"{run.path}:", quiet=quiet or len(runs) == 1)
                frames.append(one(run, evaluator, hand=teams, beside=other, met=opponents))
    except KeyboardInterrupt:
        note("Stopped; what was found is kept. Go on with the same command.")
        raise
    found = pd.concat(frames, ignore_index=True)
    if out is not None:
        save(None, found, out)
    names = group_names(runs)
    groups = {str(run.path): names[name] for run, name in zip(runs, run_names(runs), strict=True)}
    data = {
        "games": int(found["games"].max()),  # a few more than were asked for where opponents share them
        "search_games": search_games,
        "depth": depth,
        "cross_play": cross_play,
        "teams": _plain(found),
    }
    if len(runs) > 1:
        summary = over_runs(found, groups)
        data["over_runs"] = _plain(summary)
        text = _several(summary, cross_play=cross_play)
    else:
        text = _one(found, contest=len(evolving_teams(runs[0].game)) > 1)
    show(data, text + ("" if out is None else f"\nWritten: {out}"), as_json=as_json)


def _note_unequal(runs: Sequence[Run], others: Sequence[Run | None], *, quiet: bool) -> None:
    """Say which runs are not finished, and which play fewer or more games than the run that they are put beside."""
    from analysis.baselines.compare import equal_games
    from analysis.groups import unfinished

    for text in unfinished({one.path: one for one in (*runs, *others) if one is not None}.values()):
        note(text, quiet=quiet)
    for run, other in zip(runs, others, strict=True):
        if other is not None and not equal_games(run, other):
            note(f"{other.path} did not play as many games as {run.path}", quiet=quiet)


def _paired(runs: Sequence[Run], beside: Sequence[Path]) -> list[Run | None]:
    from analysis.groups import open_runs

    if not beside:
        return [None] * len(runs)
    if len(beside) != len(runs):
        raise InputError(f"expected --beside once for each of {len(runs)} runs, in their order; got {len(beside)}")
    return list(open_runs(beside))


def _plain(found: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows as JSON can hold them."""
    return [
        {
            str(key): None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in row.items()
        }
        for row in found.to_dict("records")
    ]


def _one(found: pd.DataFrame, *, contest: bool) -> str:
    """Return the rows of one run, a table a side, and a sentence for each baseline."""
    from analysis.report.words import compared

    parts = []
    against = " against the same opponents" if contest else ""
    for robots, of in found.groupby("robots", sort=False):
        header = [str(robots), "won [95 %]", "lost", "time out", "champions ahead by"]
        parts.append(f"Shares of {of['games'].iloc[0]} fresh games, the same of all{against}:")
        parts.append(text_table(header, [_cells(row) for row in of.to_dict("records")]))
        for row in of[of["chosen"] & (of["kind"] != "champions")].to_dict("records"):
            over = (row["over"], row["over_low"], row["over_high"])
            parts.append(f"The champions win {compared(over)} {_called(row)}.")
        parts.append("")
    return "\n".join(parts).rstrip()


def _cells(row: Mapping[Any, Any]) -> list[str]:
    over = (
        ""
        if row["kind"] == "champions"
        else "{:+.3f} [{:+.3f}, {:+.3f}]".format(row["over"], row["over_low"], row["over_high"])
    )
    name = f"{row['kind']} ({row['name']})" if row["kind"] in _BESIDE else row["name"]
    return [
        name + (" *" if row["kind"] == "hand-typed" and row["chosen"] else ""),
        f"{row['share']:.3f} [{row['low']:.3f}, {row['high']:.3f}]",
        f"{row['lost']:.3f}",
        f"{row['time_out']:.3f}",
        over,
    ]


def _called(row: Mapping[Any, Any]) -> str:
    trees = f" ({row['trees']})" if row["trees"] else ""
    called = {
        "single skills": f"the best team of single skills{trees}",
        "small trees": f"the best team of small trees{trees}",
        "hand-typed": f"the best hand-typed team (*, {row['name']})",
        **{kind: f"the champions of {words} ({row['name']})" for kind, words in _BESIDE.items()},
    }
    return called[row["kind"]]


def _several(summary: pd.DataFrame, *, cross_play: bool) -> str:
    """Return what runs came to: the interval is over runs."""
    from analysis.report.words import compared

    several = len(set(summary["group"])) > 1

    def who(row: Mapping[Any, Any]) -> str:
        return f"{row['group']}: {row['robots']}" if several else row["robots"]

    rows = [
        [
            f"{who(row)}: {row['kind']}",
            str(row["runs"]),
            f"{row['champions']:.3f}",
            f"{row['share']:.3f}",
            _interval(row["over"], row["low"], row["high"]),
            f"{row['better']} of {row['runs']}",
            _interval(row["less"], row["less_low"], row["less_high"]),
            f"{row['safer']} of {row['runs']}",
        ]
        for row in summary.to_dict("records")
    ]
    header = ["baseline", "runs", "champions", "baseline", "ahead by, over runs", "ahead in", "lose less by", "less in"]
    against = ", against the champions of the other runs" if cross_play else ""
    lines = [f"Mean shares of fresh games won{against}", text_table(header, rows)]
    lines += [
        f"{who(row)}: champions win {compared((row['over'], row['low'], row['high']))} {row['kind']};"
        f" they are ahead in {row['better']} of {row['runs']} runs."
        for row in summary[summary["runs"] > 1].to_dict("records")
    ]
    if (summary["runs"] == 1).any():
        lines.append(
            "A run that differs from the others in more than the seed says nothing about other seeds of its kind."
        )
    return "\n".join(lines)


def _interval(value: float, low: float, high: float) -> str:
    return f"{value:+.3f}" + ("" if math.isnan(low) else f" [{low:+.3f}, {high:+.3f}]")
