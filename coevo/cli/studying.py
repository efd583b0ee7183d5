"""coevo study."""

from __future__ import annotations

import fnmatch
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from coevo.console import Count, Progress, cores, duration, emit, most_workers, note, output_options, table
from coevo.errors import InputError, MissingFileError

if TYPE_CHECKING:
    from coevo.study.folder import StudyFolder
    from coevo.study.kinds import Cell, Headlines
    from coevo.study.plan import Plan, PlannedRun
    from coevo.study.task import Done

__all__ = ["study"]

_WRITE_EVERY_S = 5.0  # the table of a study under way


@click.command()
@click.argument("sources", metavar="FILE.toml...", nargs=-1, required=True)
@click.option("--out", type=click.Path(path_type=Path), help="Folder of the study; by default runs/NAME of the file.")
@click.option("--seeds", type=click.IntRange(min=1), help="Replaces the study's seeds: how many, from 0 on.")
@click.option(
    "--only",
    multiple=True,
    metavar="PATTERN",
    help="Do only runs whose names match, such as '*-seed0', and leave the others for later; may be repeated.",
)
@click.option(
    "--workers",
    type=Count(most_workers()),
    default=cores(),
    show_default=True,
    help="How many runs at a time; a cluster that is running has its own.",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="A running Dask scheduler (tcp://HOST:PORT), or 'local': a cluster of separate processes.",
)
@output_options
def study(
    *,
    sources: tuple[str, ...],
    out: Path | None,
    seeds: int | None,
    only: tuple[str, ...],
    workers: int,
    scheduler: str | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Do many runs: recipes x settings x seeds, of evolution or of learning, and make one table of them.

    What is done is skipped, and what was stopped goes on: give the same command again. The table does not depend on
    how often it was stopped, nor on the number of workers. Several studies are done one after the other, and a later
    one may need what an earlier one learns.

    \b
    Example: coevo study chapter6/tiny --out runs/tiny
             coevo study mine.toml --seeds 20 --scheduler tcp://10.0.0.1:8786
             coevo study chapter4/shoot-study chapter4/avoid-study chapter4/defender-study
             coevo study chapter6/presets --only '*-genetic-*'
    """
    from coevo.study.folder import check_folder
    from coevo.study.plan import read_plan, study_name

    if out is not None and len(sources) > 1:
        raise InputError(f"--out is the folder of one study, and {len(sources)} are given; leave it out")
    plans = [_plan(source, seeds, is_first=number == 0, quiet=quiet) for number, source in enumerate(sources)]
    paths = [out if out is not None else Path("runs") / study_name(source) for source in sources]
    _check_apart(sources, paths)
    _check_patterns(plans, only)
    for path, plan in zip(paths, plans, strict=True):
        if plan is not None:
            check_folder(path, plan)
    told = []
    for number, (source, path) in enumerate(zip(sources, paths, strict=True)):
        if len(sources) > 1:
            note(f"\n{source}", quiet=quiet)
        read = plans[number] or read_plan(source, seeds)
        plans[number] = read
        _check_patterns(plans, only)
        chosen = _chosen(read, only)
        if not chosen:
            note(f"None of its runs matches --only; it stays as it is: {path}", quiet=quiet)
            continue
        for text in read.without_effect:
            note(f"Beware: {text}")
        told.append(_do(read, path, chosen, workers, scheduler, as_json=as_json, quiet=quiet))
    if as_json:
        emit(told[0] if len(sources) == 1 else {"studies": told})
    if any(one["failed"] for one in told):
        raise click.exceptions.Exit(1)


def _plan(source: str, seeds: int | None, *, is_first: bool, quiet: bool) -> Plan | None:
    """Read a study; None for a later one that cannot be read yet, as skills that it names may be learned before."""
    from coevo.study.plan import read_plan

    try:
        return read_plan(source, seeds)
    except MissingFileError as error:
        if is_first:
            raise
        note(f"{source} is read again when the studies before it are done: {error}", quiet=quiet)
        return None


def _check_apart(sources: Sequence[str], paths: Sequence[Path]) -> None:
    """Refuse studies that would go into one folder."""
    found: dict[Path, str] = {}
    for source, path in zip(sources, paths, strict=True):
        first = found.get(path.resolve())
        if first == source:
            raise InputError(f"{source} is given twice; give it once")
        if first is not None:
            raise InputError(
                f"{first} and {source} would both go into {path}; do them one at a time, with an --out for one of them"
            )
        found[path.resolve()] = source


def _check_patterns(plans: Sequence[Plan | None], patterns: Sequence[str]) -> None:
    """Refuse a pattern that matches no run of any study, as soon as all of them are read."""
    names = [run.name for plan in plans if plan is not None for run in plan.runs]
    for pattern in patterns:
        if None not in plans and not fnmatch.filter(names, pattern):
            raise InputError(f"--only {pattern}: no run is called so; the first are {', '.join(names[:3])}")


def _chosen(plan: Plan, patterns: Sequence[str]) -> frozenset[str]:
    """Return the names of the runs that match a pattern; of all, if there is none."""
    names = [run.name for run in plan.runs]
    return frozenset(name for pattern in patterns or ["*"] for name in fnmatch.filter(names, pattern))


def _do(
    plan: Plan,
    path: Path,
    chosen: frozenset[str],
    workers: int,
    scheduler: str | None,
    *,
    as_json: bool,
    quiet: bool,
) -> dict[str, Any]:
    """Do the chosen runs of a study, show what it came to, and return that as plain data."""
    from coevo.study import cluster
    from coevo.study.cores import on_cores
    from coevo.study.folder import check_folder, open_study
    from coevo.study.task import task_of

    if scheduler is not None:
        cluster.check_installed()
    check_folder(path, plan)
    with ExitStack() as stack:
        client = None
        if scheduler not in (None, cluster.LOCAL):
            client = stack.enter_context(cluster.connected(scheduler, workers, quiet=quiet))
        folder = open_study(path, plan)
        stack.callback(folder.close)
        found = {run.name: folder.row(run) for run in plan.runs}
        rows: dict[str, Mapping[str, Cell]] = {name: row for name, row in found.items() if row is not None}
        waiting = [run for run in plan.runs if run.name not in rows and run.name in chosen]
        skipped = len(rows)
        note(f"{len(waiting)} runs to do, {skipped} are done: {path}", quiet=quiet)
        _tell_left(folder, chosen, rows, quiet=quiet)
        # Failures of runs that are not tried now still stand.
        standing = {name: why for name, why in folder.failures.items() if name not in chosen | rows.keys()}
        failed: dict[str, str] = {}
        if waiting:
            if client is None:
                _prepare(waiting, quiet=quiet)
            if scheduler == cluster.LOCAL:
                client = stack.enter_context(cluster.connected(scheduler, min(workers, len(waiting)), quiet=quiet))
            tasks = [task_of(folder, run) for run in waiting]
            ended = on_cores(tasks, workers) if client is None else cluster.on_cluster(client, tasks)
            try:
                failed = _collect(folder, rows, standing, len(waiting), ended, quiet=quiet)
            except KeyboardInterrupt:
                folder.leave()
                note(f"Stopped; {len(rows)} of {len(plan.runs)} runs are done, and what others have done is saved.")
                note("Go on with the same command.")
                raise
        else:
            folder.write_tables(rows, standing)  # it may have been stopped when all was done but this
        return _show(folder, rows, failed, skipped, as_json=as_json)


def _prepare(runs: Sequence[PlannedRun], *, quiet: bool) -> None:
    """Compile what is not compiled yet, once for all workers of this machine."""
    from coevo.study.registry import kind_named

    for kind, run in {run.condition.kind: run for run in runs}.items():
        kind_named(kind).warm_up(run.settings, lambda text: note(text, quiet=quiet))


def _tell_left(
    folder: StudyFolder, chosen: frozenset[str], rows: Mapping[str, Mapping[str, Cell]], *, quiet: bool
) -> None:
    """Say which finished runs the table will lack, as they are not measured anew now."""
    others = [run for run in folder.plan.runs if run.name not in chosen and run.name not in rows]
    left = [run.name for run in others if folder.is_measured_otherwise(run)]
    if left:
        note(
            f"{len(left)} finished runs, such as {left[0]}, are to be measured anew and do not match --only: the table"
            " is incomplete until 'coevo study' is called without it",
            quiet=quiet,
        )


def _collect(
    folder: StudyFolder,
    rows: dict[str, Mapping[str, Cell]],
    standing: Mapping[str, str],
    waiting: int,
    ended: Iterator[Done],
    *,
    quiet: bool,
) -> dict[str, str]:
    """Add the rows of runs as they end, and write the tables now and then; return why runs failed, by their names.

    ``standing`` are failures of runs that are not tried now.
    """
    failed: dict[str, str] = {}
    total, before = len(rows) + waiting, len(rows)
    began = written = time.monotonic()
    try:
        with Progress(total, done=before, quiet=quiet) as progress:
            for done in ended:
                if done.row is None:
                    failed[done.name] = done.failure
                else:
                    rows[done.name] = done.row
                now, count = time.monotonic(), len(rows) + len(failed)
                left = (now - began) / (count - before) * (total - count)
                how = f"done in {duration(done.seconds)}" if done.row is not None else f"failed: {done.failure}"
                progress.step(f"{done.name} {how}  ({count} of {total}, {duration(left)} left)", done=count)
                if now - written > _WRITE_EVERY_S:
                    folder.write_tables(rows, {**standing, **failed})
                    written = time.monotonic()
    finally:
        folder.write_tables(rows, {**standing, **failed})
    return failed


def _show(
    folder: StudyFolder,
    rows: Mapping[str, Mapping[str, Cell]],
    failed: Mapping[str, str],
    skipped: int,
    *,
    as_json: bool,
) -> dict[str, Any]:
    in_order = {run.name: failed[run.name] for run in folder.plan.runs if run.name in failed}
    failures = [f"{name}: {reason}" for name, reason in in_order.items()]
    if not as_json:
        if rows:
            click.echo(_summary(folder.plan, rows))
            click.echo("(mean over seeds, with its 95 % interval)")
        click.echo(f"\n{len(rows)} of {len(folder.plan.runs)} runs are in {folder.table}")
    if failures:
        note("\n".join([f"{len(failures)} runs failed; the same command tries them again:", *failures]))
    return {
        "study": str(folder.path),
        "runs": len(folder.plan.runs),
        "skipped": skipped,
        "failed": len(failed),
        "failures": [{"run": name, "reason": reason} for name, reason in in_order.items()],
        "table": str(folder.table),
    }


def _summary(plan: Plan, rows: Mapping[str, Mapping[str, Cell]]) -> str:
    """Return the columns that people look at first, a line a condition."""
    from coevo.study.registry import kind_named

    kinds = dict.fromkeys(one.kind for one in plan.conditions)
    found = list(dict.fromkeys(headlines for kind in kinds for headlines in kind_named(kind).headlines))
    rows = {run: {name: cell for name, cell in row.items() if cell != ""} for run, row in rows.items()}
    tables = []
    for number, headlines in enumerate(found):
        columns = list(dict.fromkeys(name for row in rows.values() for name in row if name.endswith(headlines.ends)))
        if columns or number == 0:
            tables.append(_headlines(plan, rows, columns, headlines))
    return "\n\n".join(tables)


def _headlines(plan: Plan, rows: Mapping[str, Mapping[str, Cell]], columns: Sequence[str], headlines: Headlines) -> str:
    """Return some columns, a line a condition; where only a few runs have a value it says how many."""
    from coevo.statistics import mean_interval

    lines = []
    for condition in plan.conditions:
        runs = [run for run in plan.runs if run.condition is condition]
        found = [rows[run.name] for run in runs if run.name in rows]
        cells = [condition.label, f"{len(found)} of {len(runs)}"]
        for column in columns:
            values = [float(row[column]) for row in found if column in row]
            some = f" ({len(values)} of {len(found)})" if 0 < len(values) < len(found) else ""
            if len(values) > 1:
                mean, low, high = mean_interval(values)
                cells.append(f"{mean:.3f} [{max(low, headlines.least):.3f}, {min(high, headlines.most):.3f}]{some}")
            else:
                cells.append(f"{values[0]:.3f}{some}" if values else "")
        lines.append(cells)
    return table(["condition", "runs", *columns], lines)
