"""Learn the installed recipes with several seeds and report every one: no best of many.

    python -m behaviors.studies.skills --seeds 5

The table of docs/skills.md is made by this.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
import joblib
import msgspec
import numpy as np

from behaviors.cards import make_card
from behaviors.learning import learn
from behaviors.recipe import installed_recipes, read_recipe
from coevo.console import note, table

__all__ = ["STARTS_SEED", "main"]

STARTS_SEED = 2_000_000  # of the starts that the study is measured on: neither those of cards nor of learning


def _one(name: str, seed: int, games: int) -> dict[str, Any]:
    recipe = msgspec.structs.replace(read_recipe(name), seed=seed)
    return make_card(recipe, learn(recipe), games=games, seed=STARTS_SEED)


@click.command()
@click.argument("names", nargs=-1)
@click.option("--seeds", default=5, show_default=True, help="How many seeds, from 1 on.")
@click.option("--games", default=1000, show_default=True, help="Trials that measure each result.")
@click.option("--workers", default=2, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), help="Write the cards to a JSON file.")
def main(*, names: tuple[str, ...], seeds: int, games: int, workers: int, out: Path | None) -> None:
    """Learn the recipes NAMES (all that are installed) with several seeds and print what each came to."""
    chosen = list(names or installed_recipes())
    tasks = [(name, seed) for name in chosen for seed in range(1, seeds + 1)]
    cards: list[dict[str, Any]] = []
    for card in joblib.Parallel(n_jobs=workers, return_as="generator")(joblib.delayed(_one)(*t, games) for t in tasks):
        cards.append(card)
        note(f"{card['name']} seed {card['learned_with']['seed']} done ({len(cards)} of {len(tasks)})")
    if out is not None:
        out.write_text(json.dumps(cards, indent=2) + "\n", encoding="utf-8")
    rows = []
    for name in chosen:
        mine = [card for card in cards if card["name"] == name]
        for starts in mine[0]["measured"]:
            found = [card["measured"][starts] for card in mine]
            keys = ["success_rate", "collision_rate"] + (["collision_rate_chaser"] if name == "avoid" else [])
            for key in keys:
                values = [data[key] for data in found]
                rows.append([name, starts, key, f"{np.median(values):.3f}", *(f"{value:.3f}" for value in values)])
    click.echo(table(["skill", "starts", "measure", "median", *(f"seed {s}" for s in range(1, seeds + 1))], rows))


if __name__ == "__main__":
    main()
