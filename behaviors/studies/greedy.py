"""How much of its failure is the literal learner's greedy policy: the same tables, greedy and with random actions.

One-step updates in aliased cells reward short loops, which a random action now and then breaks. The table of
docs/learning.md is made by this.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import joblib
import msgspec

from behaviors.learning import evaluate, learn
from behaviors.recipe import Recipe, read_recipe
from behaviors.studies.ablation import LITERAL, mean_cell
from coevo.console import note, output_options, show, table
from coevo.seeds import StartsSeed

__all__ = ["greedy"]

_EPSILONS = (0.0, 0.1, 0.2)


def _one(recipe: Recipe, seed: int, games: int) -> list[dict[str, float]]:
    """Return the shares of successes and of trials that ran out of time, for each share of random actions."""
    skill = learn(recipe, seed=seed)
    found = [evaluate(recipe, skill, games=games, seed=StartsSeed.GREEDY, epsilon=epsilon) for epsilon in _EPSILONS]
    return [{"success": one.success_rate, "timed_out": float((one.outcomes == 0).mean())} for one in found]


@click.command()
@click.option("--seeds", type=click.IntRange(min=1), default=10, show_default=True, help="How many seeds, from 1 on.")
@click.option(
    "--games", type=click.IntRange(min=1), default=1000, show_default=True, help="Trials that measure each result."
)
@click.option("--trials", type=click.IntRange(min=1), help="Replaces the trials of learning, for a quick look.")
@click.option("--workers", type=click.IntRange(min=1), default=2, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), help="Write the shares of each seed to a JSON file.")
@output_options
def greedy(
    *, seeds: int, games: int, trials: int | None, workers: int, out: Path | None, as_json: bool, quiet: bool
) -> None:
    """Learn to shoot to the letter and by the installed recipe, and measure both with 0, 10 and 20 % random actions.

    \b
    Example: coevo reproduce greedy --seeds 10
             coevo reproduce greedy --seeds 1 --trials 500 --games 200
    """
    recipes = [read_recipe(LITERAL), read_recipe("shoot")]
    if trials is not None:
        recipes = [msgspec.structs.replace(recipe, trials=trials) for recipe in recipes]
    tasks = [(recipe, seed, games) for recipe in recipes for seed in range(1, seeds + 1)]
    measured: list[list[dict[str, float]]] = []
    for found in joblib.Parallel(n_jobs=workers, return_as="generator")(joblib.delayed(_one)(*task) for task in tasks):
        measured.append(found)
        note(f"{len(measured)} of {len(tasks)} learned", quiet=quiet)
    rows, data = [], []
    for i, recipe in enumerate(recipes):
        mine = measured[i * seeds : (i + 1) * seeds]
        for k, epsilon in enumerate(_EPSILONS):
            shares: dict[str, Any] = {key: [one[k][key] for one in mine] for key in ("success", "timed_out")}
            rows.append([recipe.name, f"{epsilon:g}", *(mean_cell(values) for values in shares.values())])
            data.append({"recipe": recipe.name, "epsilon": epsilon, **shares})
    header = ["recipe", "random actions", "success [95 % over seeds]", "ran out of time"]
    show(data, table(header, rows), as_json=as_json, out=out)
