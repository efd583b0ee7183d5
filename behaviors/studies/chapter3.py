"""Run the experiment of chapter 3: sets of the periods A to D, and E and F in another world.

Each set is a folder, written whole when the set is finished; what is finished is not done again, so the same command
goes on after an interruption. ``coevo reproduce chapter3-report`` reads the folders and makes tables and figures.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import click
import msgspec

from behaviors.practice import joined
from behaviors.schedule.agents import NAMES, rates
from behaviors.schedule.course import Course
from behaviors.schedule.recipe import Schedule, read_schedule
from behaviors.trials.kernels import Results, run_trials
from coevo.compiled import is_compiled
from coevo.console import duration, note, output_options, show
from coevo.errors import InputError
from coevo.seeds import game_seed
from coevo.study import StudyMethod, open_method, table_bytes, write_set
from coevo.study.cores import one_thread_each

__all__ = ["chapter3", "run_set"]

_SAVE_EVERY_S = 20.0

Files = dict[str, bytes]
Report = Callable[[str, int, int], None]


def run_set(schedule: Schedule, number: int, report: Report | None = None, *, checkpoint: Path | None = None) -> Files:
    """Run one set and return its files by name; the same schedule and number give the same bytes.

    Args:
        schedule: the method.
        number: of the set, from 0 on.
        report: called with (period, trials done, trials in all).
        checkpoint: where it stands is kept here now and then; it goes on with what is there.
    """
    seed = int(game_seed(schedule.seed, number))
    if checkpoint is not None and checkpoint.exists():
        course = Course.load(checkpoint, schedule, seed)
    else:
        course = Course(schedule, seed)
    saved = time.monotonic()
    while not course.is_finished:
        at = course.advance()
        if report is not None:
            report(*at)
        if checkpoint is not None and time.monotonic() - saved > _SAVE_EVERY_S:
            course.save(checkpoint)
            saved = time.monotonic()
    summary = {
        "method": schedule.name,
        "kind": schedule.periods,
        "set": number,
        "seed": str(seed),  # JSON has no integers of 64 bits
        "states": course.told["states"],
        "gathered_trials": course.told["gathered"],
        "after": course.told["after"],
        "periods": {name: {"trials": len(found.ends), **rates(found)} for name, found in course.results.items()},
        "models": course.told["models"],
        "prediction_errors": course.told["errors"],
        "exchange": course.told["exchange"],
    }
    return {
        **{f"{name}.npz": data for name, data in course.skills.items()},
        "set.json": msgspec.json.format(msgspec.json.encode(summary), indent=2) + b"\n",
        "trials.csv": _trials(course.results),
        "checks.csv": table_bytes(course.told["checks"]),
        "errors.csv": table_bytes(course.told["traces"]),
    }


def _trials(found: dict[str, Results]) -> bytes:
    periods = [name for name, one in found.items() for _ in one.ends]
    all_of = joined(list(found.values()))
    columns = all_of.ends, all_of.passes, all_of.steps, all_of.nearer
    rows = zip(periods, *(column.tolist() for column in columns), strict=True)
    return table_bytes([{"period": p, "end": e, "passes": n, "steps": s, "nearer": NAMES[r]} for p, e, n, s, r in rows])


def _one(schedule: Schedule, number: int, method: StudyMethod, *, quiet: bool) -> float:
    """Run a set and write its folder; return the seconds that took."""
    name, start = f"{schedule.name} set {number}", time.monotonic()

    def report(period: str, done: int, total: int) -> None:
        if done == total or done % max(250, total // 5 // 250 * 250) == 0:
            note(f"{name}: period {period}, {done} of {total} trials", quiet=quiet)

    files = run_set(schedule, number, report, checkpoint=method.checkpoint(number))
    write_set(method, number, files.pop("set.json"), files)
    return time.monotonic() - start


@click.command()
@click.argument("recipes", nargs=-1, required=True, metavar="RECIPE...")
@click.option("--sets", type=click.IntRange(min=1), default=10, show_default=True, help="Of each method.")
@click.option("--workers", type=click.IntRange(min=1), default=2, show_default=True, help="Sets at the same time.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("runs/chapter3"),
    show_default=True,
    help="Folder of the results: one folder a method, with one folder a set.",
)
@click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="Replace a setting, such as trials=1000.")
@output_options
def chapter3(
    *,
    recipes: tuple[str, ...],
    sets: int,
    workers: int,
    out: Path,
    changes: tuple[str, ...],
    as_json: bool,
    quiet: bool,
) -> None:
    """Run the experiment of chapter 3: sets of its periods for each RECIPE, a name or a TOML file.

    Sets that are finished stay as they are, and one under way goes on where it was: give the same command again after
    an interruption.

    \b
    Example: coevo reproduce chapter3 chapter3/short --sets 2 --out runs/short
             coevo reproduce chapter3 chapter3/schedule chapter3/previous --sets 10
    """
    tasks: list[tuple[Schedule, int, StudyMethod]] = []
    failed: list[str] = []
    for recipe in recipes:
        schedule = read_schedule(recipe, changes)
        settings = msgspec.json.format(msgspec.json.encode(schedule), indent=2).decode() + "\n"
        method = open_method(out / schedule.name, settings)
        tasks += [(schedule, number, method) for number in method.missing(sets)]
    finished = len(recipes) * sets - len(tasks)
    note(f"{len(tasks)} sets to run, {finished} are finished", quiet=quiet)
    if tasks and not is_compiled(run_trials):
        note("Compiling the trials for this machine, once: about 30 s ...", quiet=quiet)
    with one_thread_each(), ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        jobs = {pool.submit(_one, *task, quiet=quiet): f"{task[0].name} set {task[1]}" for task in tasks}
        for ended, job in enumerate(as_completed(jobs), start=1):
            try:
                seconds = job.result()
            except InputError as error:  # the other sets may be worth hours
                failed.append(f"{jobs[job]}: {error}")
                note(f"failed: {failed[-1]}", quiet=quiet)
            else:
                note(f"{jobs[job]} finished after {duration(seconds)} ({ended} of {len(tasks)})", quiet=quiet)
    done = {"folder": str(out), "run": len(tasks) - len(failed), "finished": finished, "failed": failed}
    show(done, f"Written: {out}; now 'coevo reproduce chapter3-report {out}'", as_json=as_json)
    if failed:
        note("these sets failed, the others are written:\n" + "\n".join(failed))
        raise click.exceptions.Exit(1)
