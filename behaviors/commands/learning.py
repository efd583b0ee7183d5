"""coevo learn."""

from __future__ import annotations

import shlex
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from coevo.console import Count, Progress, emit, note, output_options
from coevo.errors import InputError

if TYPE_CHECKING:
    from behaviors.learning import Learning
    from behaviors.recipe import Recipe

__all__ = ["learn", "tell_compiling"]

_GAMES = 1000  # starts that cards are measured on
_FILMED = 5  # trials


@click.command()
@click.argument("source", metavar="SKILL|RECIPE.toml")
@click.option("--seed", type=click.IntRange(min=0, max=2**63 - 1), help="Replaces the recipe's seed.")
@click.option("--trials", type=click.IntRange(min=1, max=10_000_000), help="Replaces the recipe's number of trials.")
@click.option("--drive", type=click.Choice(["pws", "4ws"]), help="Replaces the recipe's drive.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder of the learned skill; by default runs/skills/NAME-seedN.",
)
@click.option(
    "--games",
    type=Count(),
    default=_GAMES,
    show_default=True,
    help="How many trials measure the result.",
)
@click.option(
    "--video", type=click.Path(path_type=Path), help="Then show 5 trials of what was learned: .html, .mp4 or .gif."
)
@click.option("--resume", is_flag=True, help="Go on with the unfinished learning in the folder.")
@click.option("--restart", is_flag=True, help="Throw away the learning, or the skill, in the folder.")
@output_options
def learn(
    *,
    source: str,
    seed: int | None,
    trials: int | None,
    drive: str | None,
    out: Path | None,
    games: int,
    video: Path | None,
    resume: bool,
    restart: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Learn a skill, measure it, and write it with its recipe and its card.

    It is learned from nothing; by a recipe with [coordination] from skills that are learned already. A learning that
    was stopped goes on with --resume, and ends as if it had never stopped.

    \b
    Example: coevo learn shoot --seed 5
             coevo learn shoot --seed 5 --resume
             coevo learn search --trials 500 --video search.html
             coevo learn chapter3/shoot-avoiding
    """
    from behaviors.cards import make_card
    from behaviors.learned import CHECKPOINT, SKILL, held_folder, write_learned, writing
    from behaviors.recipe import is_recipe_of, read_recipe
    from coevo.replay import check_video
    from coevo.seeds import StartsSeed

    if video is not None:
        check_video(video)
    if resume and restart:
        raise InputError("--resume goes on with a learning and --restart throws it away: give one of them")
    recipe = read_recipe(source)
    if drive is not None:
        robot = msgspec.structs.replace(recipe.world.robot, drive=drive)
        recipe = msgspec.structs.replace(recipe, world=msgspec.structs.replace(recipe.world, robot=robot))
    changes = {
        "seed": seed if seed is not None else recipe.seed,
        "trials": trials if trials is not None else recipe.trials,
    }
    recipe = msgspec.structs.replace(recipe, **changes)
    folder = out if out is not None else Path("runs") / "skills" / f"{recipe.name}-seed{recipe.seed}"
    checkpoint = folder / CHECKPOINT
    finished = resume and not checkpoint.exists() and (folder / SKILL).exists()
    if not finished:
        _refuse_taken(folder, recipe, out, resume=resume, restart=restart)
    with held_folder(folder):
        if finished:
            card = _finished(folder, recipe, games)
            said = f"Finished before: {folder}"
        else:
            if (folder / SKILL).exists() and not resume:
                note(f"{folder} is replaced.", quiet=quiet)
            learning = _begin(recipe, checkpoint, resume=resume, quiet=quiet)
            try:
                _go_on(learning, recipe, checkpoint, quiet=quiet)
                skill = learning.skill()
                card = make_card(recipe, skill, games=games, seed=StartsSeed.CARDS)
            except KeyboardInterrupt:
                with writing(folder):
                    learning.save(checkpoint)
                counted = None if games == _GAMES else games
                again = _again(source, seed=seed, trials=trials, drive=drive, out=out, games=counted, video=video)
                note(f"Stopped; {learning.done} of {recipe.trials} trials are saved. Go on with: {again}")
                raise
            card = write_learned(folder, learning, skill, card, None if is_recipe_of(source, folder) else recipe)
            said = f"Written: {folder}"
    _film(folder, recipe, video)
    _show(folder, card, as_json=as_json, said=_written(said, video))


def _refuse_taken(folder: Path, recipe: Recipe, out: Path | None, *, resume: bool, restart: bool) -> None:
    """Refuse a folder with an unfinished learning, or with another skill, unless the user said what to do with it."""
    from behaviors.learned import CHECKPOINT, SKILL, is_learned
    from coevo.skill import load_skill

    if resume or restart:
        return
    if (folder / CHECKPOINT).exists():
        _refuse(folder / CHECKPOINT)
    if out is None or not (folder / SKILL).exists():
        return
    try:
        same = is_learned(load_skill(folder / SKILL), recipe)
    except InputError:
        same = False
    if not same:
        raise InputError(f"{folder} holds another skill; replace it with --restart, or choose another --out")


def _written(said: str, video: Path | None) -> str:
    return said if video is None else f"{said}\nWritten: {video}"


def _film(folder: Path, recipe: Recipe, video: Path | None) -> None:
    """Show the first of the trials that the card counts."""
    if video is None:
        return
    from behaviors.watching import skill_recording
    from coevo.replay import write_video
    from coevo.seeds import StartsSeed
    from coevo.skill import load_skill

    skill = load_skill(folder / "skill.npz")
    write_video(video, skill_recording(recipe, skill, games=_FILMED, seed=StartsSeed.CARDS, starts="in-view"))


def _refuse(checkpoint: Path) -> None:
    from behaviors.checkpoint import trials_done

    raise InputError(
        f"{checkpoint.parent} holds an unfinished learning, {trials_done(checkpoint)}; go on with --resume, or throw it"
        " away with --restart"
    )


def _finished(folder: Path, recipe: Recipe, games: int) -> dict[str, Any]:
    """Return the card of a learning that is finished; one that a kill has kept from being written is made."""
    from behaviors.cards import make_card
    from behaviors.learned import SKILL, card_of, is_learned, writing
    from coevo.files import write_whole
    from coevo.seal import seal
    from coevo.seeds import StartsSeed
    from coevo.skill import load_skill

    skill = load_skill(folder / SKILL)
    if not is_learned(skill, recipe):
        raise InputError(
            f"{folder} holds another skill and no unfinished learning; replace it with --restart, or choose another"
            " --out"
        )
    try:
        card = card_of(folder, recipe)
    except InputError:
        card = None
    if card is None:
        card = make_card(recipe, skill, games=games, seed=StartsSeed.CARDS)
        with writing(folder):
            write_whole(folder / "card.json", seal(card))
    return card


def _begin(recipe: Recipe, checkpoint: Path, *, resume: bool, quiet: bool) -> Learning:
    from behaviors.learned import writing
    from behaviors.learning import Learning
    from behaviors.lpm import PersistentExcitationWarning

    tell_compiling(quiet=quiet)
    if resume and checkpoint.exists():
        learning = Learning.load(checkpoint, recipe, seed=recipe.seed, trials=recipe.trials)
        note(f"Going on after {learning.done} of {recipe.trials} trials.", quiet=quiet)
        return learning
    if resume:
        note("Nothing was saved yet: from the beginning.", quiet=quiet)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PersistentExcitationWarning)
        learning = Learning(recipe, seed=recipe.seed, trials=recipe.trials)
    for warning in caught:
        note(f"Beware: {warning.message}")
    with writing(checkpoint.parent):
        checkpoint.unlink(missing_ok=True)
    return learning


def _go_on(learning: Learning, recipe: Recipe, checkpoint: Path, *, quiet: bool) -> None:
    """Learn to the end, and write a checkpoint now and then."""
    from behaviors.learned import go_on

    total = recipe.trials
    with Progress(total, done=learning.done, quiet=quiet) as progress:

        def report(share: float) -> None:
            done = learning.done
            due = done % max(250, total // 20 // 250 * 250) == 0
            if due or learning.is_finished or learning.moved:
                said = f"{recipe.name}: {done} of {total} trials, {share:.0%} of the last block succeeded"
                progress.step(said + learning.words, done=done)

        go_on(learning, checkpoint, report)


def _again(source: str, **options: object) -> str:
    given = [part for name, value in options.items() if value is not None for part in (f"--{name}", str(value))]
    return shlex.join(["coevo", "learn", source, *given, "--resume"])


def _show(folder: Path, card: dict[str, Any], *, as_json: bool, said: str) -> None:
    from behaviors.cards import describe, describe_curriculum

    if as_json:
        emit({"folder": str(folder), **card})
        return
    click.echo(f"{card['name']} ({card['drive']}, {card['states']} states)")
    if "curriculum" in card:
        click.echo(f"  {describe_curriculum(card['curriculum'])}")
    for who, key in (("", "measured"), ("random: ", "random_actions"), ("true state: ", "true_state_controller")):
        for starts, data in card[key].items():
            for line in describe(who + starts, data):
                click.echo(line)
    click.echo(said)


def tell_compiling(*, quiet: bool) -> None:
    """Say that learning and measuring compile the trials first, if they do."""
    from behaviors.trials.kernels import run_trials
    from coevo.compiled import is_compiled

    if not is_compiled(run_trials):
        note("Compiling the trials for this machine, once: about 20 s ...", quiet=quiet)
