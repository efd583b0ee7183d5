"""Learn the installed recipes with several seeds and report every one: no best of many.

The table of docs/skills.md is made by this.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import joblib
import msgspec
import numpy as np

from behaviors.cards import make_card
from behaviors.learning import learn
from behaviors.recipe import installed_recipes, read_recipe
from coevo.console import note, output_options, show, table
from coevo.seeds import StartsSeed

__all__ = ["skills"]


def _one(name: str, seed: int, games: int, changes: tuple[str, ...]) -> dict[str, Any]:
    recipe = msgspec.structs.replace(read_recipe(name, changes), seed=seed)
    return make_card(recipe, learn(recipe), games=games, seed=StartsSeed.SKILLS)


@click.command()
@click.argument("names", nargs=-1)
@click.option("--seeds", type=click.IntRange(min=1), default=5, show_default=True, help="How many seeds, from 1 on.")
@click.option(
    "--games", type=click.IntRange(min=1), default=1000, show_default=True, help="Trials that measure each result."
)
@click.option("--workers", type=click.IntRange(min=1), default=2, show_default=True)
@click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="Replace a setting of the recipes.")
@click.option("--out", type=click.Path(path_type=Path), help="Write the cards to a JSON file.")
@output_options
def skills(
    *,
    names: tuple[str, ...],
    seeds: int,
    games: int,
    workers: int,
    changes: tuple[str, ...],
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Learn the recipes NAMES (all that are installed) with several seeds and print what each came to.

    \b
    Example: coevo reproduce skills --seeds 5
             coevo reproduce skills search --seeds 2 --games 200
             coevo reproduce skills pass --set learning.return_lambda=0.9
    """
    chosen = list(names or installed_recipes())
    tasks = [(name, seed) for name in chosen for seed in range(1, seeds + 1)]
    cards: list[dict[str, Any]] = []
    for card in joblib.Parallel(n_jobs=workers, return_as="generator")(
        joblib.delayed(_one)(*t, games, changes) for t in tasks
    ):
        cards.append(card)
        note(f"{card['name']} seed {card['learned_with']['seed']} done ({len(cards)} of {len(tasks)})", quiet=quiet)
    rows = []
    for name in chosen:
        mine = [card for card in cards if card["name"] == name]
        for starts in mine[0]["measured"]:
            found = [card["measured"][starts] for card in mine]
            keys = ["success_rate", "collision_rate"] + (["collision_rate_chaser"] if name == "avoid" else [])
            for key in keys:
                values = [data[key] for data in found]
                rows.append([name, starts, key, f"{np.median(values):.3f}", *(f"{value:.3f}" for value in values)])
    header = ["skill", "starts", "measure", "median", *(f"seed {s}" for s in range(1, seeds + 1))]
    show(cards, table(header, rows), as_json=as_json, out=out)
