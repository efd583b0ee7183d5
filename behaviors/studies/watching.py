"""Watch what was learned together: a passer and a shooter (Figs. 3.11 and 3.12), and robots that learned by turns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from behaviors.commands.learning import tell_compiling
from behaviors.schedule.agents import NAMES
from behaviors.schedule.course import Course
from behaviors.schedule.recipe import Schedule
from behaviors.studies.team import TEAM
from behaviors.team.course import TeamCourse
from behaviors.team.recipe import TeamRecipe
from behaviors.team.scene import unlearned
from behaviors.trials.scene import Watched
from behaviors.trials.task import PASSED, SUCCEEDED, SUCCESS
from behaviors.watching import pair_recording, team_recording
from coevo.config import check, read_toml
from coevo.console import note, output_options, show
from coevo.errors import InputError
from coevo.replay import Recording, check_video, write_video
from coevo.skill import load_skill
from coevo.soundness import require_as_learned
from coevo.study import read_set

__all__ = ["chapter3_watch", "chapter5_watch"]

_ALL, _ONLY = "all", ("pass", "goal", "both")


def _options(about: str, out: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give a command the folder that it shows trials of, which of them, and the file that it writes."""

    def give(command: Callable[..., Any]) -> Callable[..., Any]:
        options = (
            click.argument("folder", type=click.Path(path_type=Path)),
            click.option(
                "--games", type=click.IntRange(1, 100), default=5, show_default=True, help="How many to show."
            ),
            click.option("--only", type=click.Choice([_ALL, *_ONLY]), default=_ALL, show_default=True, help=about),
            click.option(
                "--out",
                type=click.Path(path_type=Path),
                default=Path(out),
                show_default=True,
                help="File to write: .html, .mp4 or .gif.",
            ),
            output_options,
        )
        for option in reversed(options):
            command = option(command)
        return command

    return give


@click.command("chapter3-watch")
@_options("Show trials with a pass, with the shooter's goal, or with both.", "passer-and-shooter.html")
def chapter3_watch(*, folder: Path, games: int, only: str, out: Path, as_json: bool, quiet: bool) -> None:
    """Watch what the passer and the shooter of a finished set learned in the periods A to D: Figures 3.11 and 3.12.

    FOLDER is that of a set. The trials are the first of those that its rates "after" are made of, on starts that no
    learning has seen.

    \b
    Example: coevo reproduce chapter3-watch runs/chapter3/schedule/set-00 --only both
    """
    check_video(out)
    found, settings = read_set(folder)
    schedule = check(Schedule, settings, f"the settings of {folder.parent}")
    skills = [load_skill(folder / f"{name}.npz") for name in NAMES]
    tell_compiling(quiet=quiet)
    course = Course(schedule, int(found.summary["seed"]))
    watched = course.watch_afterwards(skills, games if only == _ALL else schedule.games)
    name = f"{schedule.name}, set {found.summary['set']}: passer P and shooter S"
    numbers = _chosen(
        folder,
        watched,
        lambda one: _happened(passed=one.passes > 0, scored=one.ends == SUCCESS),
        only=only,
        games=games,
        quiet=quiet,
    )
    chosen = [watched[number] for number in numbers]
    _write(out, pair_recording(schedule, skills, chosen, numbers, name), numbers, as_json=as_json)


@click.command("chapter5-watch")
@_options("Show games with a pass, with a goal of a robot, or with both.", "team.html")
def chapter5_watch(*, folder: Path, games: int, only: str, out: Path, as_json: bool, quiet: bool) -> None:
    """Watch what robots that learned by turns do after the last turn: tasks (iii) and (iv) of chapter 5.

    FOLDER is that of a run of such a study. The games are the first of those that measure it, greedy and on starts that
    no learning has seen.

    \b
    Example: coevo reproduce chapter5-watch runs/pass-study/shoot-and-pass-votes-seed0 --only goal
    """
    check_video(out)
    if not (folder / TEAM).exists():
        raise InputError(
            f"{folder} holds no robots that learned by turns; name a run of a study such as chapter5/pass-study"
        )
    require_as_learned(folder)
    recipe = check(TeamRecipe, read_toml(folder / "recipe.toml"), str(folder / "recipe.toml"))
    skills = {name: load_skill(path) for name in recipe.names if (path := folder / f"{name}.npz").exists()}
    tell_compiling(quiet=quiet)
    course = TeamCourse(recipe, recipe.seed, members=unlearned(recipe))
    watched = course.watch_afterwards(skills, games if only == _ALL else recipe.games)

    def happened(one: Watched) -> set[str]:
        return _happened(passed=bool(one.counts[:, PASSED].any()), scored=bool(one.counts[:, SUCCEEDED].any()))

    numbers = _chosen(folder, watched, happened, only=only, games=games, quiet=quiet)
    name = f"{recipe.name}, seed {recipe.seed}: {', '.join(recipe.names)}"
    chosen = [watched[number] for number in numbers]
    _write(out, team_recording(recipe, skills, chosen, numbers, name), numbers, as_json=as_json)


def _happened(*, passed: bool, scored: bool) -> set[str]:
    """Return of which kinds a trial is."""
    return {_ALL, *(["pass"] * passed), *(["goal"] * scored), *(["both"] * (passed and scored))}


def _chosen(
    folder: Path,
    watched: Sequence[Watched],
    kinds: Callable[[Watched], set[str]],
    *,
    only: str,
    games: int,
    quiet: bool,
) -> list[int]:
    """Return the numbers of the first trials of a kind.

    Raises:
        InputError: there is none.
    """
    numbers = [number for number, one in enumerate(watched) if only in kinds(one)][:games]
    if not numbers:
        raise InputError(f"none of the {len(watched)} trials of {folder} is one with {only}; choose another --only")
    if len(numbers) < games:
        note(f"Of {len(watched)} trials only {len(numbers)} are such.", quiet=quiet)
    return numbers


def _write(out: Path, recording: Recording, numbers: Sequence[int], *, as_json: bool) -> None:
    write_video(out, recording)
    show({"trials": [number + 1 for number in numbers], "written": str(out)}, f"Written: {out}", as_json=as_json)
