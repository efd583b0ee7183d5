"""How much of its failure is the literal learner's greedy policy: the same tables, greedy and with random actions.

    python -m behaviors.studies.greedy --seeds 10

One-step updates in aliased cells reward short loops, which a random action now and then breaks. The table of
docs/learning.md is made by this.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
import joblib
import msgspec

from behaviors.learning import evaluate, learn
from behaviors.recipe import Recipe, read_recipe
from behaviors.studies.ablation import LITERAL, mean_cell
from coevo.config import check, read_toml
from coevo.console import note, table

__all__ = ["main"]

_STARTS_SEED = 5_000_000  # of the starts that are measured: not those of cards, other studies or learning
_EPSILONS = (0.0, 0.1, 0.2)


def _one(recipe: Recipe, seed: int, games: int) -> list[dict[str, float]]:
    """Return the shares of successes and of trials that ran out of time, for each share of random actions."""
    skill = learn(recipe, seed=seed)
    found = [evaluate(recipe, skill, games=games, seed=_STARTS_SEED, epsilon=epsilon) for epsilon in _EPSILONS]
    return [{"success": one.success_rate, "timed_out": float((one.outcomes == 0).mean())} for one in found]


@click.command()
@click.option("--seeds", default=10, show_default=True, help="How many seeds, from 1 on.")
@click.option("--games", default=1000, show_default=True, help="Trials that measure each result.")
@click.option("--trials", type=int, help="Replaces the trials of learning, for a quick look.")
@click.option("--workers", default=2, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), help="Write the shares of each seed to a JSON file.")
def main(*, seeds: int, games: int, trials: int | None, workers: int, out: Path | None) -> None:
    """Learn to shoot to the letter and by the installed recipe, and measure both with 0, 10 and 20 % random actions."""
    recipes = [check(Recipe, read_toml(LITERAL), str(LITERAL)), read_recipe("shoot")]
    if trials is not None:
        recipes = [msgspec.structs.replace(recipe, trials=trials) for recipe in recipes]
    tasks = [(recipe, seed, games) for recipe in recipes for seed in range(1, seeds + 1)]
    measured: list[list[dict[str, float]]] = []
    for found in joblib.Parallel(n_jobs=workers, return_as="generator")(joblib.delayed(_one)(*task) for task in tasks):
        measured.append(found)
        note(f"{len(measured)} of {len(tasks)} learned")
    rows, data = [], []
    for i, recipe in enumerate(recipes):
        mine = measured[i * seeds : (i + 1) * seeds]
        for k, epsilon in enumerate(_EPSILONS):
            shares: dict[str, Any] = {key: [one[k][key] for one in mine] for key in ("success", "timed_out")}
            rows.append([recipe.name, f"{epsilon:g}", *(mean_cell(values) for values in shares.values())])
            data.append({"recipe": recipe.name, "epsilon": epsilon, **shares})
    if out is not None:
        out.write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")
    click.echo(table(["recipe", "random actions", "success [95 % over seeds]", "ran out of time"], rows))


if __name__ == "__main__":
    main()
