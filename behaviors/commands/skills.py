"""coevo skills, coevo skills evaluate."""

from __future__ import annotations

import click

from behaviors.commands.learning import tell_compiling
from coevo.console import emit, output_options, table
from coevo.errors import InputError

__all__ = ["skills"]


@click.group(invoke_without_command=True)
@output_options
@click.pass_context
def skills(context: click.Context, *, as_json: bool, quiet: bool) -> None:
    """List the installed skills with their measured success.

    \b
    Example: coevo skills
             coevo skills evaluate shoot --games 1000 --seed 7
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


@skills.command()
@click.argument("skill")
@click.option("--games", type=click.IntRange(min=1), default=1000, show_default=True)
@click.option("--seed", type=click.IntRange(min=0, max=2**63 - 1), default=7, show_default=True)
@click.option("--starts", type=click.Choice(["in-view", "anywhere"]), default="in-view", show_default=True)
@output_options
def evaluate(*, skill: str, games: int, seed: int, starts: str, as_json: bool, quiet: bool) -> None:
    """Measure a skill anew, from unseen starts; SKILL is the name of an installed skill or the path of a skill file.

    \b
    Example: coevo skills evaluate shoot --games 1000 --seed 7 --starts anywhere
    """
    from behaviors.cards import describe, measure
    from behaviors.recipe import Recipe
    from coevo.config import check
    from coevo.skill import load_skill

    loaded = load_skill(skill)
    recipe = check(Recipe, dict(loaded.about.get("recipe", {})), f"the recipe in {skill}")
    tell_compiling(quiet=quiet)
    data = {"name": loaded.name, **measure(recipe, loaded, games=games, seed=seed, starts=starts)}
    if as_json:
        emit(data)
        return
    click.echo(f"{loaded.name} ({loaded.drive}, {len(loaded.values)} states)")
    for line in describe(starts, data):
        click.echo(line)
