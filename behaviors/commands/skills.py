"""coevo skills, coevo skills evaluate, coevo skills watch."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from behaviors.commands.learning import tell_compiling
from coevo.console import Count, emit, output_options, show, table
from coevo.errors import InputError

if TYPE_CHECKING:
    from behaviors.recipe import Recipe
    from coevo.skill import Skill

__all__ = ["skills"]


@click.group(invoke_without_command=True)
@output_options
@click.pass_context
def skills(context: click.Context, *, as_json: bool, quiet: bool) -> None:
    """List the installed skills with their measured success.

    \b
    Example: coevo skills
             coevo skills evaluate shoot --games 1000 --seed 7
             coevo skills watch shoot
    """
    del quiet
    if context.invoked_subcommand is not None:
        return
    from coevo.skill import installed_skills, load_skill, read_card

    rows, data = [], []
    for name in installed_skills():
        skill, card = load_skill(name), read_card(name)
        if card.get("digest") != skill.digest:
            raise InputError(
                f"the card of {name} belongs to another skill file; make both with 'coevo learn {name} --out FOLDER'"
            )
        best = card["measured"]["in-view"]
        low, high = best["ci95"]
        anywhere = card["measured"].get("anywhere")
        rows.append(
            [
                name,
                card["drive"],
                str(card["states"]),
                " ".join(f"{kind}:{order}/{card['history_lengths'][kind]}" for kind, order in card["orders"].items()),
                f"{best['success_rate']:.3f} [{low:.3f}, {high:.3f}]",
                "" if anywhere is None else f"{anywhere['success_rate']:.3f}",
                f"{best['collision_rate']:.3f}",
                str(best["games"]),
            ]
        )
        data.append(
            {
                "name": name,
                "success_rate": best["success_rate"],
                "ci95": best["ci95"],
                "games": best["games"],
                "drive": card["drive"],
                "states": card["states"],
                "orders": card["orders"],
                "history_lengths": card["history_lengths"],
                "card": card,
            }
        )
    if as_json:
        emit(data)
        return
    header = [
        "skill",
        "drive",
        "states",
        "object:order/history",
        "success in view [95 %]",
        "anywhere",
        "collisions",
        "trials",
    ]
    click.echo(table(header, rows) if rows else "No skills are installed; learn one with 'coevo learn shoot'.")
    click.echo("search starts with the ball out of view; avoid counts 10 s without collision against a random mover")
    click.echo(
        "defend, pass-in-view and shoot-in-view stand while they do not see the ball, and are for trees that ask first"
    )
    click.echo("collisions are those that end a trial: there are none in defend, where the attacker may be touched")


@skills.command()
@click.argument("skill")
@click.option("--games", type=Count(), default=1000, show_default=True)
@click.option("--seed", type=click.IntRange(min=0, max=2**63 - 1), default=7, show_default=True)
@click.option("--starts", type=click.Choice(["in-view", "anywhere"]), default="in-view", show_default=True)
@output_options
def evaluate(*, skill: str, games: int, seed: int, starts: str, as_json: bool, quiet: bool) -> None:
    """Measure a skill anew, from unseen starts; SKILL is the name of an installed skill or the path of a skill file.

    \b
    Example: coevo skills evaluate shoot --games 1000 --seed 7 --starts anywhere
    """
    from behaviors.cards import describe, measure

    loaded, recipe = _with_recipe(skill)
    tell_compiling(quiet=quiet)
    data = {"name": loaded.name, **measure(recipe, loaded, games=games, seed=seed, starts=starts)}
    if as_json:
        emit(data)
        return
    click.echo(f"{loaded.name} ({loaded.drive}, {len(loaded.values)} states)")
    for line in describe(starts, data):
        click.echo(line)


@skills.command()
@click.argument("skill")
@click.option("--games", type=click.IntRange(min=1, max=100), default=5, show_default=True, help="How many trials.")
@click.option("--seed", type=click.IntRange(min=0, max=2**63 - 1), default=7, show_default=True)
@click.option("--starts", type=click.Choice(["in-view", "anywhere"]), default="in-view", show_default=True)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="File to write: .html, .mp4 or .gif; by default NAME.html.",
)
@output_options
def watch(*, skill: str, games: int, seed: int, starts: str, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Watch trials of a skill: the first of those that 'coevo skills evaluate' counts with the same seed and starts.

    SKILL is the name of an installed skill or the path of a skill file.

    \b
    Example: coevo skills watch shoot
             coevo skills watch runs/skills/shoot-seed5/skill.npz --starts anywhere --out shoot.mp4
    """
    from behaviors.watching import skill_recording
    from coevo.replay import check_video, write_video

    loaded, recipe = _with_recipe(skill)
    out = Path(f"{loaded.name}.html") if out is None else out
    check_video(out)
    tell_compiling(quiet=quiet)
    recording = skill_recording(recipe, loaded, games=games, seed=seed, starts=starts)
    write_video(out, recording)
    won = sum(take.point == 0 for take in recording.takes)
    data = {"name": loaded.name, "starts": starts, "games": games, "succeeded": won, "written": str(out)}
    show(data, f"{won} of {games} trials succeeded\nWritten: {out}", as_json=as_json)


def _with_recipe(skill: str) -> tuple[Skill, Recipe]:
    """Return a skill with the recipe that it was learned by."""
    from behaviors.recipe import Recipe
    from coevo.config import check
    from coevo.skill import load_skill

    loaded = load_skill(skill)
    if "team" in loaded.about:
        raise InputError(
            f"{skill} was learned among several robots, and has no task of its own to be measured in; team.json beside"
            " it says what it came to, and a game plays it by [skills]"
        )
    return loaded, check(Recipe, dict(loaded.about.get("recipe", {})), f"the recipe in {skill}")
