"""coevo evolve, coevo resume."""

from __future__ import annotations

import shlex
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from coevo.config import EvolutionSettings, RunSettings, without_effect
from coevo.console import Count, Progress, duration, emit, note, output_options, table, worker_options
from coevo.errors import InputError
from coevo.recipes import is_path, read_experiment

if TYPE_CHECKING:
    from coevo.contest import Judged
    from coevo.evolution import GenerationReport
    from coevo.run import Run

__all__ = ["evolve", "resume"]


_unseen_option = click.option(
    "--unseen",
    type=Count(least=0),
    help="Games at the end that judge the last champions; by default a twentieth of all games, 40 to 400.",
)


@click.command()
@click.argument("recipe")
@click.option("--seed", type=click.IntRange(min=0, max=2**63 - 1), help="Replaces the recipe's seed.")
@click.option("--out", type=click.Path(path_type=Path), help="Run folder; by default runs/NAME-seedN.")
@click.option("--generations", type=click.IntRange(min=1), help="Replaces gp.generations.")
@worker_options
@_unseen_option
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
    unseen: int | None,
    assignments: tuple[str, ...],
    as_json: bool,
    quiet: bool,
) -> None:
    """Co-evolve: RECIPE is the name of a preset, of another recipe that comes along, or a TOML file.

    \b
    Presets: two-learners, stationary-opponent, three-learners, smoke.
    Others: chapter6/equal-complexity, chapter6/dissertation-three-learners, ... (README).
    Example: coevo evolve three-learners --seed 3 --set gp.generations=30
    """
    changes = list(assignments)
    changes += [] if seed is None else [f"seed={seed}"]
    changes += [] if generations is None else [f"gp.generations={generations}"]
    settings = read_experiment(recipe, changes)
    from coevo.evolution.evaluation import check_backend
    from coevo.evolution.opponents import check_opponents, with_opponents
    from coevo.fitness import Scorer
    from coevo.game import StartsDoNotFitError, check_playable
    from coevo.hand_typed import hand_typed_teams
    from coevo.levels import check_levels
    from coevo.plugins import search_folders
    from coevo.run import create_run

    check_backend(backend)
    settings = with_opponents(settings)
    folders = search_folders(Path(recipe).parent if is_path(recipe) else Path())
    game = check_playable(settings, folders)  # what is wrong is better found before there is a folder
    Scorer(settings, game.counts, folders)
    check_levels(settings, folders)
    check_opponents(settings, game)
    hand_typed_teams(settings, game)
    run = create_run(out if out is not None else _default_folder(settings), settings, folders)
    for text in without_effect(settings, [change.split("=")[0].strip() for change in changes]):
        note(f"Beware: {text}")
    note(f"Run folder: {run.path}", quiet=quiet)
    try:
        _go_on(run, workers, backend, unseen, as_json=as_json, quiet=quiet)
    except StartsDoNotFitError:
        if run.finished == 0:
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
@worker_options
@_unseen_option
@output_options
def resume(*, folder: Path, workers: int, backend: str, unseen: int | None, as_json: bool, quiet: bool) -> None:
    """Go on with an interrupted run from its last saved generation.

    \b
    Example: coevo resume runs/three-learners-seed0
    """
    from coevo.run import open_run
    from coevo.soundness import differences, require_sound

    run = open_run(folder)
    require_sound(run)
    different = differences(run)
    if different:
        note(
            f"Beware: this run was begun under other conditions ({'; '.join(different)}), so its bytes may come out"
            " otherwise than if it had gone on there."
        )
    if run.is_finished:
        _restored(run)
        note(f"{folder} is finished: all {run.config.gp.generations} generations are there.", quiet=quiet)
        judged = _judged(run, workers, backend, unseen, quiet=quiet)
        _summarise(run, 0.0, judged, as_json=as_json)
        return
    _go_on(run, workers, backend, unseen, as_json=as_json, quiet=quiet)


def _restored(run: Run) -> None:
    """Make tables of a finished run anew that are lost."""
    from coevo.soundness import restore

    release = run.lock()
    try:
        restore(run)
    finally:
        release()


def _go_on(run: Run, workers: int, backend: str, unseen: int | None, *, as_json: bool, quiet: bool) -> None:
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

            evolve_run(run, evaluator, report, lambda text: note(text, quiet=quiet))
    except KeyboardInterrupt:
        note(f"Stopped; {run.finished} of {generations} generations are saved. Go on with: coevo resume {run.path}")
        raise
    finally:
        release()
    seconds = time.perf_counter() - began
    _summarise(run, seconds, _judged(run, workers, backend, unseen, quiet=quiet), as_json=as_json)


def _judged(run: Run, workers: int, backend: str, games: int | None, *, quiet: bool) -> list[Judged]:
    """Let the last champions play games that evolution has not seen."""
    from coevo.contest import judge, unseen_games
    from coevo.evolution.evaluation import Evaluator, check_backend
    from coevo.game import prepare

    check_backend(backend)
    if games is None:
        games = unseen_games(run.config)
    if games == 0:
        return []
    try:
        prepare(run.config, lambda text: note(text, quiet=quiet))
        note(f"Judging the last champions by {games} games that evolution has not seen ...", quiet=quiet)
        with Evaluator(run.config, workers=workers, backend=backend, folders=run.folders) as evaluator:
            return list(judge(run, evaluator, games=games))
    except InputError as error:  # the run itself is whole
        note(f"The last champions could not be judged: {error}")
        return []


def _line(of: GenerationReport, generations: int, left: float) -> str:
    robots = "  ".join(f"{name} {best:7.3f} / {of.mean[name]:7.3f}" for name, best in of.best.items())
    rate = of.games / (of.playing_seconds + of.other_seconds)
    level = "" if of.level is None else f"  level {of.level}"
    return (
        f"generation {of.generation + 1:3d}/{generations}{level}  fitness best / mean  {robots}"
        f"  {rate:6.0f} games/s  {duration(left)} left"
    )


def _summarise(run: Run, seconds: float, judged: Sequence[Judged], *, as_json: bool) -> None:
    from coevo.evolution.grouping import games_of_run

    settings = run.config
    last = settings.gp.generations - 1
    robots: dict[str, dict[str, Any]] = {}
    champions = run.champions()
    for robot in run.evolving.values():
        generation, rank = run.champion(robot, last)
        best = run.record(generation, robot).iloc[rank]
        robots[robot] = {
            "best_fitness": float(best["fitness"]),
            "depth": int(best["depth"]),
            "nodes": int(best["nodes"]),
        }
        robots[robot] |= {name: int(best[name]) for name in run.game.counts}
        if champions is not None:
            chosen = champions[champions["robot"] == robot].iloc[0]
            robots[robot] |= {"fitness_again": float(chosen["fitness_again"]), "generation": generation}
    games = games_of_run(settings, run.game.roles, settings.gp.generations)
    if as_json:
        emit(
            {
                "run": str(run.path),
                "seed": settings.seed,
                "generations": settings.gp.generations,
                "games": games,
                "seconds": round(seconds, 3),
                "robots": robots,
                "unseen": [asdict(one) for one in judged],
            }
        )
        return
    took = f" in {duration(seconds)}" if seconds else ""
    who = "The best of the last generation" if champions is None else "The last champions"
    click.echo(f"{settings.gp.generations} generations, {games} games{took}. {who}:")
    click.echo(_champion_table(run, robots))
    if judged:
        click.echo(f"\n{_verdict(judged)}")
    folder = shlex.quote(str(run.path))
    click.echo(f"\nRun folder: {run.path}. What next:")
    click.echo(f"  One page to read and show:  coevo report {folder}")
    click.echo(f"  What a robot does:          coevo inspect {folder} --robot {next(iter(robots))}")
    watch = " --games 3 --video game.html" if isinstance(settings, RunSettings) else ""
    click.echo(f"  Let them play:              coevo play {folder}{watch}")


def _champion_table(run: Run, robots: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the last champions, and what their numbers are worth."""
    settings = run.config
    again = settings.evaluation.champion_blocks * settings.evaluation.games
    shown = ["goals", "lost"] if {"goals", "lost"} <= set(run.game.counts) else list(run.game.counts)[:4]
    judged = ["judged again"] if again else []
    rows = [
        [
            name,
            f"{of['best_fitness']:.3f}",
            *([f"{of['fitness_again']:.3f}"] if again else []),
            *(str(of[column]) for column in (*shown, "depth", "nodes")),
        ]
        for name, of in robots.items()
    ]
    what = f"{' and '.join(shown)}: of {settings.evaluation.games} games; smaller fitness is better"
    luck = f"The best is the luckiest of {settings.gp.population}, too"
    if again:
        luck = f"Judged again, and chosen, by {again} games from common starts"
    lines = table(["robot", "fitness", *judged, *shown, "depth", "nodes"], rows)
    return f"{lines}\n({what}. {luck}.)"


def _verdict(judged: Sequence[Judged]) -> str:
    """Return the shares of unseen games won as a table, and in words what may be said."""
    header = ["team", "last champions", "first champions", "best single skills"]
    rows, words = [], []
    for one in judged:
        who = ", ".join(one.robots)
        rows.append(
            [who, *(f"{x:.3f} [{low:.3f}, {high:.3f}]" for x, low, high in (one.last, one.first, one.single_skills))]
        )
        skills = ", ".join(one.skills.values())
        words.append(
            f"{who}: {_compared(one.over_first)} the first champions,"
            f" {_compared(one.over_single_skills)} single skills ({skills})"
        )
    title = f"Share of {judged[0].games} unseen games won, with its 95 % interval"
    others = ", all against the last champions of the other team" if len(judged) > 1 else ""
    return "\n".join([f"{title}{others}:", table(header, rows), *words])


def _compared(above: tuple[float, float, float]) -> str:
    difference, low, high = above
    if low > 0.0:
        return f"better by {difference:.3f} [{low:.3f}, {high:.3f}] than"
    if high < 0.0:
        return f"worse by {-difference:.3f} [{-high:.3f}, {-low:.3f}] than"
    return f"not told apart ({difference:+.3f} [{low:+.3f}, {high:+.3f}]) from"
