"""Compare ways to make one skill of several (appendix B.2) with plain Q learning and with the first skill alone.

The table of docs/skills.md, section "Several behaviours at once", is made by this.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import joblib
import msgspec

from behaviors.learning import evaluate, learn
from behaviors.recipe import Recipe, of_seed, read_recipe
from coevo.console import note, output_options, show, table
from coevo.errors import InputError
from coevo.seeds import StartsSeed
from coevo.skill import Skill, load_skill
from coevo.statistics import share_interval

__all__ = ["coordination"]

_PLAIN = {"areas": "none", "initial": "zero"}
# What differs from the recipe's [coordination], and whether the trials that its skills took are granted on top.
_WAYS: dict[str, tuple[dict[str, str], bool]] = {
    "areas, avoid where its value is high": ({}, False),
    "areas, avoid where its value is low": ({"avoid_where": "threat"}, False),
    "the same, areas worth max Q": ({"avoid_where": "threat", "worth": "values"}, False),
    "no areas, first values the sum": ({"areas": "none"}, False),
    "plain Q learning": (_PLAIN, False),
    "plain, with the skills' trials": (_PLAIN, True),
}
_ALONE = "the first skill alone"


def _measured(recipe: Recipe, skill: Skill, games: int) -> dict[str, Any]:
    """Return counts of successes and collisions from both kinds of starts."""
    found: dict[str, Any] = {}
    for starts in ("in-view", "anywhere"):
        result = evaluate(recipe, skill, games=games, seed=StartsSeed.SKILLS, starts=starts)
        collisions = round(result.collision_rate * games)
        found[starts] = {"success": int(result.success.sum()), "collisions": collisions}
    return found


def _learned(recipe: Recipe, way: str, seed: int, games: int) -> dict[str, Any]:
    assert recipe.coordination is not msgspec.UNSET
    changes, granted = _WAYS[way]
    trials = recipe.trials
    if granted:
        trials += sum(int(load_skill(of_seed(source, seed)).about["trials"]) for source in recipe.coordination.skills)
    coordination = msgspec.structs.replace(recipe.coordination, **changes)
    recipe = msgspec.structs.replace(recipe, seed=seed, trials=trials, coordination=coordination)
    skill = learn(recipe)
    return {"way": way, "seed": seed, "trials": trials, "about": skill.about, "found": _measured(recipe, skill, games)}


def _alone(recipe: Recipe, games: int) -> dict[str, Any]:
    assert recipe.coordination is not msgspec.UNSET
    skill = load_skill(of_seed(recipe.coordination.skills[0], recipe.seed))
    kinds = {model.kind for model in skill.objects}
    objects = tuple(model for model in recipe.objects if model.kind in kinds)
    task = msgspec.structs.replace(recipe, objects=objects, coordination=msgspec.UNSET)
    return {"way": _ALONE, "seed": None, "trials": 0, "found": _measured(task, skill, games)}


def _share(count: int, games: int) -> str:
    low, high = share_interval(count, games)
    return f"{count / games:.3f} [{low:.3f}, {high:.3f}]"


@click.command()
@click.argument("source", default="chapter3/shoot-avoiding", metavar="[RECIPE]")
@click.option(
    "--seeds",
    type=click.IntRange(min=1),
    default=3,
    show_default=True,
    help="How many seeds of the learning, from 1 on.",
)
@click.option("--trials", type=click.IntRange(min=1), help="Replaces the recipe's number of trials.")
@click.option(
    "--games",
    type=click.IntRange(min=1),
    default=1000,
    show_default=True,
    help="Unseen starts of each kind that measure each result.",
)
@click.option("--workers", type=click.IntRange(min=1), default=2, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), help="Write all counts to a JSON file.")
@output_options
def coordination(
    *,
    source: str,
    seeds: int,
    trials: int | None,
    games: int,
    workers: int,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Learn a recipe with [coordination] in several ways and print what each came to, with 95 % Wilson intervals.

    RECIPE is a name, by default chapter3/shoot-avoiding, or a TOML file.

    \b
    Example: coevo reproduce coordination
             coevo reproduce coordination --seeds 1 --trials 1000 --games 200
    """
    recipe = read_recipe(source)
    if recipe.coordination is msgspec.UNSET:
        raise InputError(f"{source} coordinates no skills: it has no [coordination]")
    if trials is not None:
        recipe = msgspec.structs.replace(recipe, trials=trials)
    results = [_alone(recipe, games)]
    jobs = (joblib.delayed(_learned)(recipe, way, seed, games) for way in _WAYS for seed in range(1, seeds + 1))
    for one in joblib.Parallel(n_jobs=workers, return_as="generator")(jobs):
        results.append(one)
        note(f"{one['way']}, seed {one['seed']} done ({len(results) - 1} of {len(_WAYS) * seeds})", quiet=quiet)
    rows = [
        [
            one["way"],
            "" if one["seed"] is None else str(one["seed"]),
            str(one["trials"]),
            *(
                _share(one["found"][starts][what], games)
                for starts in ("in-view", "anywhere")
                for what in ("success", "collisions")
            ),
        ]
        for one in results
    ]
    header = ["way", "seed", "trials", "success in view", "collisions", "success anywhere", "collisions"]
    show(results, table(header, rows), as_json=as_json, out=out)
