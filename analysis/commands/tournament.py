"""coevo tournament."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import click

from coevo.console import Count, Progress, duration, note, output_options, show, table, worker_options

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import TracebackType

    import pandas as pd

    from analysis.tournament import Against, Left, Tournament

__all__ = ["tournament"]

_OUTSIDE = 2  # times as many games of a generation against an outsider as of a pair
_SHOWN = 10  # generations in the table


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--games", type=Count(), default=20, show_default=True, help="Of each pair.")
@click.option(
    "--every", type=click.IntRange(min=1), default=1, show_default=True, help="K-th generation, and the last."
)
@click.option(
    "--individuals",
    type=click.Choice(["best", "all"]),
    default="best",
    show_default=True,
    help="Who plays for a generation: its champions, or a sample of all, another member in each game.",
)
@click.option(
    "--against",
    "outsiders",
    multiple=True,
    metavar="WHO",
    help="Outsiders beside the single skills: a tree for all robots, trees joined by + (one each), or a run's folder.",
)
@click.option(
    "--again",
    "repeats",
    type=click.IntRange(min=0),
    default=5,
    show_default=True,
    help="How often each champion plays its generation again, to tell its advantage from luck.",
)
@click.option("--out", type=click.Path(path_type=Path), help="The matrices, as .svg, .png, .html or .csv.")
@worker_options
@output_options
def tournament(
    *,
    folder: Path,
    games: int,
    every: int,
    individuals: str,
    outsiders: tuple[str, ...],
    repeats: int,
    out: Path | None,
    workers: int,
    backend: str,
    as_json: bool,
    quiet: bool,
) -> None:
    """Let champions of all generations of a run play against each other, against outsiders, and once more.

    What was played is kept in the run folder: a tournament that was stopped goes on, and one that is finished is read.

    \b
    Example: coevo tournament runs/three-learners-seed0
             coevo tournament runs/three-learners-seed0 --every 5 --against "IF_ball_is_lost(search, shoot)"
    """
    from analysis.charts import altair, check_out
    from analysis.tournament import (
        chosen_generations,
        left_over,
        play_again,
        play_against,
        play_tournament,
        read_outsider,
        single_skill_outsiders,
    )
    from coevo.evolution.evaluation import Evaluator, check_backend
    from coevo.game import prepare
    from coevo.run import open_run

    check_backend(backend)
    if out is not None:
        check_out(out)
        if out.suffix.lower() != ".csv":
            altair()
    run = open_run(folder)
    generations = chosen_generations(run.finished, every)
    known = single_skill_outsiders(run)
    singles = {one.name for one in known}
    known += [read_outsider(run, text) for text in dict.fromkeys(outsiders) if text not in singles]
    prepare(run.config, lambda text: note(text, quiet=quiet))
    try:
        with (
            run.keeping_results(),
            Evaluator(run.config, workers=workers, backend=backend, folders=run.folders) as evaluator,
        ):
            with _Steps("pairs of generations", quiet=quiet) as steps:
                played = play_tournament(
                    run, evaluator, generations=generations, games=games, individuals=individuals, report=steps.report
                )
            with _Steps("outsiders", quiet=quiet) as steps:
                against = play_against(
                    run, evaluator, known, generations=generations, games=_OUTSIDE * games, report=steps.report
                )
            left: list[Left] = []
            if repeats:
                with _Steps("generations played again", quiet=quiet) as steps:
                    again = play_again(run, evaluator, generations=generations, repeats=repeats, report=steps.report)
                left = left_over(again)
    except KeyboardInterrupt:
        note("Stopped; what was played of the tournament is kept. Go on with the same command.")
        raise
    if out is not None:
        _write(out, played)
    data, text = _told(played, against, left)
    written = "" if out is None else f"\nWritten: {out}"
    show({"run": str(run.path), **data}, text + written, as_json=as_json)


class _Steps:
    """Progress whose number of steps is known when the first is done."""

    def __init__(self, what: str, *, quiet: bool) -> None:
        self._what, self._quiet = what, quiet
        self._progress: Progress | None = None
        self._began = time.monotonic()
        self._before = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._progress is not None:
            self._progress.__exit__(kind, value, trace)

    def report(self, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` are done."""
        if self._progress is None:
            self._progress = Progress(total, quiet=self._quiet)
            self._progress.__enter__()
        left = (time.monotonic() - self._began) / done * (total - done)
        self._progress.step(f"{done} of {total} {self._what}, {duration(left)} left", done=done)


def _write(out: Path, played: Tournament) -> None:
    from analysis.charts import save
    from analysis.tournament.tables import matrix_table

    matrix = matrix_table(played)
    if out.suffix.lower() == ".csv":
        save(None, matrix, out)
        return
    from analysis.tournament.charts import matrix_chart

    save(matrix_chart(matrix, alone=len(played.teams) == 1), matrix, out)


def _told(played: Tournament, against: Against, left: Sequence[Left]) -> tuple[dict[str, Any], str]:
    """Return what is told as JSON, and as text."""
    from analysis.tournament import can_rate, diagnoses, in_words, rate
    from analysis.tournament.tables import against_table, master_table, side_name

    sides = {team: side_name(played, at) for at, team in enumerate(played.teams)}
    found = diagnoses(played)
    master, outside = master_table(played), against_table(against, sides)
    ratings = rate(played) if len(sides) > 1 and can_rate() else None
    data: dict[str, Any] = {
        "generations": list(played.generations),
        "games": played.games,
        "individuals": played.individuals,
        "sides": [
            {
                "team": team,
                "robots": list(played.robots[at]),
                "wins": played.share(at).tolist(),
                "lost": played.lost(at).tolist(),
                "diagnosis": sorted(of.labels) if (of := found[at]) else [],
            }
            for at, team in enumerate(played.teams)
        ],
        "diagnosis": sorted({label for one in found if one for label in one.labels}),
        "master": master.to_dict("records"),
        "against": outside.to_dict("records"),
        "ratings": [] if ratings is None else ratings.table.to_dict("records"),
        "misfit": None if ratings is None else ratings.misfit,
        "again": [asdict(one) for one in left],
    }
    lines = [f"{side}: {said}" for side, said in zip(sides.values(), in_words(played), strict=True)]
    lines += [
        f"{one.robot}: {one.text} of its champions' advantage over their generation is left when they play again"
        for one in left
    ]
    lines += [
        _side_text(played, master[master["side"] == side], outside[outside["side"] == side]) for side in sides.values()
    ]
    if ratings is not None and ratings.mislead:
        lines.append(f"\nRatings mislead here: who wins depends on who meets whom (misfit {ratings.misfit:.1f})")
    return data, "\n".join(lines)


def _side_text(played: Tournament, master: pd.DataFrame, outside: pd.DataFrame) -> str:
    """Return what a side won, generation by generation."""
    alone = len(played.teams) == 1
    side, outsiders = master["side"].iloc[0], list(dict.fromkeys(outside["outsider"]))
    shown = sorted({*played.generations[:: max(1, len(played.generations) // _SHOWN)], played.generations[-1]})
    share = outside.set_index(["generation", "outsider"])["share"]
    rows = []
    for generation, mean, low, high in master[["generation", "share", "low", "high"]].itertuples(index=False):
        if generation in shown:
            others = [] if alone else [f"{share[generation, name]:.3f}" for name in outsiders]
            rows.append([str(generation), f"{mean:.3f} [{low:.3f}, {high:.3f}]", *others])
    met = ["all starts"] if alone else [f"all {len(played.generations)} of them", *outsiders]
    lines = [f"\n{side}: share of games won{'' if alone else ', against'}", table(["generation", *met], rows)]
    if alone:
        others = [f"{name} {share[played.generations[0], name]:.3f}" for name in outsiders]
        lines.append(f"Others in its place: {', '.join(others)}")
    return "\n".join(lines)
