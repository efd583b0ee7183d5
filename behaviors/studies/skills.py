"""Learn the installed recipes with several seeds and report every one: no best of many.

The table of docs/skills.md is made by this.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from coevo.statistics import mean_interval

__all__ = ["seed_rows", "skills"]


def _one(name: str, seed: int, games: int, changes: tuple[str, ...]) -> dict[str, Any]:
    recipe = msgspec.structs.replace(read_recipe(name, changes), seed=seed)
    return make_card(recipe, learn(recipe), games=games, seed=StartsSeed.SKILLS)


def seed_rows(
    name: str, cards: Sequence[Mapping[str, Any]], against: Sequence[Mapping[str, Any]] = ()
) -> list[list[str]]:
    """Return a row for each measure of a skill: its median over the seeds, and every seed.

    Args:
        name: of the skill.
        cards: one for each seed, from 1 on.
        against: the same with another setting; two rows more then have what these came to, and the mean
            difference over the seeds with its 95 % interval, and every seed's.
    """
    rows = []
    for starts in cards[0]["measured"]:
        for key in ["success_rate", "collision_rate"] + (["collision_rate_chaser"] if name == "avoid" else []):
            values = np.array([card["measured"][starts][key] for card in cards])
            rows.append([name, starts, key, f"{np.median(values):.3f}", *(f"{value:.3f}" for value in values)])
            if against:
                others = np.array([card["measured"][starts][key] for card in against])
                of_others = [f"{value:.3f}" for value in others]
                rows.append([name, starts, f"{key}: the other", f"{np.median(others):.3f}", *of_others])
                each = [f"{value:+.3f}" for value in values - others]
                mean, low, high = mean_interval(values - others)
                rows.append([name, starts, f"{key}: difference", f"{mean:+.3f} [{low:+.3f}, {high:+.3f}]", *each])
    return rows


@click.command()
@click.argument("names", nargs=-1)
@click.option("--seeds", type=click.IntRange(min=1), default=5, show_default=True, help="How many seeds, from 1 on.")
@click.option(
    "--games", type=click.IntRange(min=1), default=1000, show_default=True, help="Trials that measure each result."
)
@click.option("--workers", type=click.IntRange(min=1), default=2, show_default=True)
@click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="Replace a setting of the recipes.")
@click.option("--against", multiple=True, metavar="KEY=VALUE", help="Compare with another value, seed by seed.")
@click.option("--out", type=click.Path(path_type=Path), help="Write the cards to a JSON file.")
@output_options
def skills(
    *,
    names: tuple[str, ...],
    seeds: int,
    games: int,
    workers: int,
    changes: tuple[str, ...],
    against: tuple[str, ...],
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Learn the recipes NAMES (all that are installed) with several seeds and print what each came to.

    \b
    Example: coevo reproduce skills --seeds 5
             coevo reproduce skills search --seeds 2 --games 200
             coevo reproduce skills pass --against learning.return_lambda=0.9
    """
    chosen = list(names or installed_recipes())
    arms = [changes, *([(*changes, *against)] if against else [])]
    tasks = [(name, seed, games, arm) for arm in arms for name in chosen for seed in range(1, seeds + 1)]
    cards: list[dict[str, Any]] = []
    for card in joblib.Parallel(n_jobs=workers, return_as="generator")(joblib.delayed(_one)(*task) for task in tasks):
        cards.append(card)
        note(f"{card['name']} seed {card['learned_with']['seed']} done ({len(cards)} of {len(tasks)})", quiet=quiet)
    half = len(chosen) * seeds
    rows = []
    for name in chosen:
        mine, others = ([card for card in part if card["name"] == name] for part in (cards[:half], cards[half:]))
        rows += seed_rows(name, mine, others)
    header = ["skill", "starts", "measure", "median", *(f"seed {s}" for s in range(1, seeds + 1))]
    told = [{"settings": list(arms[n // half]), **card} for n, card in enumerate(cards)]
    show(told, table(header, rows), as_json=as_json, out=out)
