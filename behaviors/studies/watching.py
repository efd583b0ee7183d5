"""Watch a passer and a shooter of chapter 3 (Uchibe 1999, Figures 3.11 and 3.12): trials of a finished set."""

from __future__ import annotations

from pathlib import Path

import click

from behaviors.commands.learning import tell_compiling
from behaviors.schedule.agents import NAMES
from behaviors.schedule.course import Course
from behaviors.schedule.recipe import Schedule
from behaviors.trials.scene import Watched
from behaviors.trials.task import SUCCESS
from behaviors.watching import pair_recording
from coevo.config import check
from coevo.console import note, output_options, show
from coevo.errors import InputError
from coevo.replay import check_video, write_video
from coevo.skill import load_skill
from coevo.study import read_set

__all__ = ["chapter3_watch"]


@click.command("chapter3-watch")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--games", type=click.IntRange(min=1, max=100), default=5, show_default=True, help="How many to show.")
@click.option(
    "--only",
    type=click.Choice(["all", "pass", "goal", "both"]),
    default="all",
    show_default=True,
    help="Show trials with a pass, with the shooter's goal, or with both.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("passer-and-shooter.html"),
    show_default=True,
    help="File to write: .html, .mp4 or .gif.",
)
@output_options
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
    watched = course.watch_afterwards(skills, games if only == "all" else schedule.games)
    numbers = [number for number, one in enumerate(watched) if _is_wanted(one, only)][:games]
    if not numbers:
        raise InputError(f"none of the {len(watched)} trials of {folder} is one with {only}; choose another --only")
    if len(numbers) < games:
        note(f"Of {len(watched)} trials only {len(numbers)} are such.", quiet=quiet)
    chosen = [watched[number] for number in numbers]
    name = f"{schedule.name}, set {found.summary['set']}: passer P and shooter S"
    write_video(out, pair_recording(schedule, skills, chosen, numbers, name))
    data = {"trials": [number + 1 for number in numbers], "written": str(out)}
    show(data, f"Written: {out}", as_json=as_json)


def _is_wanted(one: Watched, only: str) -> bool:
    passed, scored = one.passes > 0, one.ends == SUCCESS
    return {"all": True, "pass": passed, "goal": scored, "both": passed and scored}[only]
