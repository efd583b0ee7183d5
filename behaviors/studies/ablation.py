"""From the learner of chapter 3 to the letter to the installed recipe of shoot, one change at a time.

Each row keeps the changes of the rows above it. The table of docs/learning.md is made by this.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import joblib
import msgspec

from behaviors.learning import evaluate, learn
from behaviors.recipe import Recipe, read_recipe
from coevo.console import note, output_options, show, table
from coevo.seeds import StartsSeed
from coevo.statistics import mean_interval

__all__ = ["LITERAL", "ablation", "mean_cell", "steps_of"]

LITERAL = "chapter3/literal-shoot"
_STARTS = ("in-view", "anywhere")

# What is changed, and the settings that it takes from the installed recipe: their section and names.
_CHANGES: list[tuple[str, str, tuple[str, ...]]] = [
    ("lambda-returns at the end of a trial", "learning", ("update", "return_lambda")),
    ("discount a step of 1/30 s", "learning", ("gamma", "discount_per")),
    ("learning rate falls with visits", "learning", ("alpha_visits", "alpha_min")),
    ("exploration falls", "learning", ("epsilon_end",)),
    ("an action lasts 5 steps or more", "action", ("min_steps",)),
    ("orders 3 and 3, cells of 0.6", "objects", ("order", "history_length", "cell")),
    ("two lost states", "objects", ("lost_states",)),
    ("axes by varimax", "objects", ("axes",)),
    ("easy starts first", "learning", ("easy_share",)),
    ("the best of regular checks is kept: the installed recipe", "learning", ("check_every",)),
]


def steps_of(literal: Recipe, installed: Recipe) -> list[tuple[str, Recipe]]:
    """Return the recipes from the literal learner to the installed one, with what each changes.

    Raises:
        AssertionError: the changes do not lead from the one to the other.
    """
    recipe, found = literal, [("chapter 3 to the letter", literal)]
    for label, section, names in _CHANGES:
        if section == "objects":
            objects = tuple(
                msgspec.structs.replace(old, **{name: getattr(new, name) for name in names})
                for old, new in zip(recipe.objects, installed.objects, strict=True)
            )
            recipe = msgspec.structs.replace(recipe, objects=objects)
        else:
            part, wanted = getattr(recipe, section), getattr(installed, section)
            changed = msgspec.structs.replace(part, **{name: getattr(wanted, name) for name in names})
            recipe = msgspec.structs.replace(recipe, **{section: changed})
        found.append((label, recipe))
    assert msgspec.structs.replace(recipe, name=installed.name, seed=installed.seed) == installed
    return found


def _one(recipe: Recipe, seed: int, games: int) -> list[float]:
    skill = learn(recipe, seed=seed)
    return [
        evaluate(recipe, skill, games=games, seed=StartsSeed.ABLATION, starts=starts).success_rate for starts in _STARTS
    ]


def mean_cell(values: list[float]) -> str:
    """Return the mean over seeds with its 95 % interval by Student's t, within 0 and 1."""
    mean, low, high = mean_interval(values)
    return f"{mean:.3f}" + (f" [{max(0.0, low):.3f}, {min(1.0, high):.3f}]" if len(values) > 1 else "")


@click.command()
@click.option("--seeds", type=click.IntRange(min=1), default=3, show_default=True, help="How many seeds, from 1 on.")
@click.option(
    "--games", type=click.IntRange(min=1), default=1000, show_default=True, help="Trials that measure each result."
)
@click.option("--trials", type=click.IntRange(min=1), help="Replaces the trials of learning, for a quick look.")
@click.option("--workers", type=click.IntRange(min=1), default=2, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), help="Write the shares of each seed to a JSON file.")
@output_options
def ablation(
    *, seeds: int, games: int, trials: int | None, workers: int, out: Path | None, as_json: bool, quiet: bool
) -> None:
    """Learn to shoot as in chapter 3 to the letter and as installed, one change at a time, with several seeds.

    \b
    Example: coevo reproduce ablation --seeds 3
             coevo reproduce ablation --seeds 1 --trials 500 --games 200
    """
    steps = steps_of(read_recipe(LITERAL), read_recipe("shoot"))
    if trials is not None:
        steps = [(label, msgspec.structs.replace(recipe, trials=trials)) for label, recipe in steps]
    tasks = [(recipe, seed, games) for _, recipe in steps for seed in range(1, seeds + 1)]
    shares: list[list[float]] = []
    for found in joblib.Parallel(n_jobs=workers, return_as="generator")(joblib.delayed(_one)(*task) for task in tasks):
        shares.append(found)
        note(f"{len(shares)} of {len(tasks)} learned", quiet=quiet)
    rows, data = [], []
    for i, (label, _) in enumerate(steps):
        mine = shares[i * seeds : (i + 1) * seeds]
        by_start: dict[str, Any] = {starts: [one[k] for one in mine] for k, starts in enumerate(_STARTS)}
        rows.append([label, *(mean_cell(by_start[starts]) for starts in _STARTS)])
        data.append({"change": label, **by_start})
    header = ["change", *(f"success {starts} [95 % over seeds]" for starts in _STARTS)]
    show(data, table(header, rows), as_json=as_json, out=out)
