"""coevo evolve, coevo resume."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from coevo.config import EvolutionSettings, RunSettings
from coevo.console import Progress, duration, emit, note, output_options, table
from coevo.recipes import is_path, read_experiment

if TYPE_CHECKING:
    from coevo.evolution import GenerationReport
    from coevo.run import Run

__all__ = ["evolve", "resume"]


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _worker_options(command: Any) -> Any:
    command = click.option(
        "--backend",
        type=click.Choice(["threads", "processes"]),
        default="threads",
        show_default=True,
        help="What workers are; results do not depend on it.",
    )(command)
    return click.option(
        "--workers",
        type=click.IntRange(min=1),
        default=_cores(),
        show_default=True,
        help="How many games at a time.",
    )(command)


@click.command()
@click.argument("recipe")
@click.option("--seed", type=click.IntRange(min=0, max=2**63 - 1), help="Replaces the recipe's seed.")
@click.option("--out", type=click.Path(path_type=Path), help="Run folder; by default runs/NAME-seedN.")
@click.option("--generations", type=click.IntRange(min=1), help="Replaces gp.generations.")
@_worker_options
@click.option("--set", "assignments", multiple=True, metavar="KEY=VALUE", help="Replaces a setting; may be repeated.")
@output_options
def evolve(
    *,
    recipe: str,
    seed: int | None,
    out: Path | None,
    generations: int | None,
    workers: int,
    backend: str,
    assignments: tuple[str, ...],
    as_json: bool,
    quiet: bool,
) -> None:
    """Co-evolve: RECIPE is the name of a preset or a TOML file.

    \b
    Presets: two-learners, stationary-opponent, three-learners, smoke.
    Example: coevo evolve three-learners --seed 3 --set fitness.kind=varying
    """
    changes = list(assignments)
    changes += [] if seed is None else [f"seed={seed}"]
    changes += [] if generations is None else [f"gp.generations={generations}"]
    settings = read_experiment(recipe, changes)
    from coevo.evolution.evaluation import check_backend
    from coevo.fitness import Scorer
    from coevo.game import StartsDoNotFitError, check_playable
    from coevo.plugins import search_folders
    from coevo.run import create_run

    check_backend(backend)
    folders = search_folders(Path(recipe).parent if is_path(recipe) else Path())
    game = check_playable(settings, folders)  # what is wrong is better found before there is a folder
    Scorer(settings, game.counts, folders)
    run = create_run(out if out is not None else _default_folder(settings), settings, folders)
    note(f"Run folder: {run.path}", quiet=quiet)
    try:
        _go_on(run, workers, backend, as_json=as_json, quiet=quiet)
    except StartsDoNotFitError:
        shutil.rmtree(run.path)  # it could never go on
        raise


def _default_folder(settings: EvolutionSettings) -> Path:
    """Return the first free name."""
    base = Path("runs") / f"{settings.name}-seed{settings.seed}"
    path, number = base, 1
    while path.exists():
        number += 1
        path = base.with_name(f"{base.name}-{number}")
    return path


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@_worker_options
@output_options
def resume(*, folder: Path, workers: int, backend: str, as_json: bool, quiet: bool) -> None:
    """Go on with an interrupted run from its last saved generation.

    \b
    Example: coevo resume runs/three-learners-seed0
    """
    from coevo.run import open_run

    run = open_run(folder)
    if run.is_finished:
        note(f"{folder} is finished: all {run.config.gp.generations} generations are there.", quiet=quiet)
        _summarise(run, 0.0, as_json=as_json)
        return
    _go_on(run, workers, backend, as_json=as_json, quiet=quiet)


def _go_on(run: Run, workers: int, backend: str, *, as_json: bool, quiet: bool) -> None:
    from coevo.evolution import evolve as evolve_run
    from coevo.evolution.evaluation import Evaluator, check_backend
    from coevo.game import prepare

    check_backend(backend)
    release = run.lock()
    began = time.perf_counter()
    generations = run.config.gp.generations
    try:
        prepare(run.config, lambda text: note(text, quiet=quiet))
        state = run.checkpoint()
        done = state.generation if state is not None else run.finished
        if done:
            note(f"Going on at generation {done} of {generations}.", quiet=quiet)
        with (
            Evaluator(run.config, workers=workers, backend=backend, folders=run.folders) as evaluator,
            Progress(generations, done=done, quiet=quiet) as progress,
        ):
            since = time.perf_counter()

            def report(of: GenerationReport) -> None:
                now = time.perf_counter()
                left = (now - since) / (of.generation + 1 - done) * (generations - of.generation - 1)
                progress.step(_line(of, generations, left), done=of.generation + 1)

            evolve_run(run, evaluator, report)
    except KeyboardInterrupt:
        note(f"Stopped; {run.finished} of {generations} generations are saved. Go on with: coevo resume {run.path}")
        raise
    finally:
        release()
    _summarise(run, time.perf_counter() - began, as_json=as_json)


def _line(of: GenerationReport, generations: int, left: float) -> str:
    robots = "  ".join(f"{name} {best:7.3f} / {of.mean[name]:7.3f}" for name, best in of.best.items())
    rate = of.games / (of.playing_seconds + of.other_seconds)
    return (
        f"generation {of.generation + 1:3d}/{generations}  fitness best / mean  {robots}"
        f"  {rate:6.0f} games/s  {duration(left)} left"
    )


def _summarise(run: Run, seconds: float, *, as_json: bool) -> None:
    settings = run.config
    last = settings.gp.generations - 1
    robots: dict[str, dict[str, Any]] = {}
    for robot in run.evolving.values():
        best = run.record(last, robot).iloc[0]
        robots[robot] = {
            "best_fitness": float(best["fitness"]),
            "depth": int(best["depth"]),
            "nodes": int(best["nodes"]),
        }
        robots[robot] |= {name: int(best[name]) for name in run.game.counts}
    games = settings.gp.generations * settings.gp.population * settings.evaluation.games
    if as_json:
        emit(
            {
                "run": str(run.path),
                "seed": settings.seed,
                "generations": settings.gp.generations,
                "games": games,
                "seconds": round(seconds, 3),
                "robots": robots,
            }
        )
        return
    took = f" in {duration(seconds)}" if seconds else ""
    click.echo(f"{settings.gp.generations} generations, {games} games{took}. The best of the last generation:")
    shown = ["goals", "lost"] if {"goals", "lost"} <= set(run.game.counts) else list(run.game.counts)[:4]
    header = ["fitness", *shown, "depth", "nodes"]
    rows = [
        [name, f"{r['best_fitness']:.3f}", *(str(r[column]) for column in header[1:])] for name, r in robots.items()
    ]
    click.echo(table(["robot", *header], rows))
    click.echo(f"({' and '.join(shown)}: of {settings.evaluation.games} games; smaller fitness is better)")
    click.echo(f"\nRun folder: {run.path}")
    click.echo(f"  Look at a tree:   coevo inspect {run.path} --robot {next(iter(robots))} --simplified")
    watch = " --video game.html" if isinstance(settings, RunSettings) else ""
    click.echo(f"  Let them play:    coevo play {run.path}{watch}")
    click.echo(f"  Fitness curves:   {run.path / 'generations.csv'}")
