"""Measure the limits of the size categories: terciles of area over the visible samples of random play.

The defaults of coevo.config.CategorySettings are this, rounded.
"""

from __future__ import annotations

import click
import numpy as np

from analysis.games import unseen_seeds
from coevo.config import RunSettings
from coevo.console import output_options, show, table
from coevo.evolution import random_teams
from coevo.game import SoccerGame, programs_of
from coevo.recipes import read_settings
from coevo.soccer.camera import ROBOTS, camera_params, make_retina, object_count, see

__all__ = ["categories"]


@click.command()
@click.argument("recipes", nargs=-1)
@click.option(
    "--teams",
    type=click.IntRange(min=1),
    default=40,
    show_default=True,
    help="Random teams of each recipe, two games each.",
)
@click.option("--seed", type=click.IntRange(min=0, max=2**63 - 1), default=1, show_default=True)
@output_options
def categories(*, recipes: tuple[str, ...], teams: int, seed: int, as_json: bool, quiet: bool) -> None:
    """Print the terciles of the areas of ball, goals and robots, as robots of random trees see them.

    RECIPES are presets or TOML files, by default the three of section 6.4.

    \b
    Example: coevo reproduce categories
             coevo reproduce categories three-learners --teams 10
    """
    del quiet  # it shows no progress
    areas: dict[str, list[float]] = {"ball": [], "goal": [], "robot": []}
    for recipe in recipes or ("two-learners", "stationary-opponent", "three-learners"):
        settings = read_settings(RunSettings, recipe)
        game, robots = SoccerGame(settings), len(settings.players)
        camera, retina = camera_params(settings.world), make_retina(settings.world)
        features, seen = np.zeros((object_count(robots), 11)), np.zeros(object_count(robots))
        for team, trees in enumerate(random_teams(game, settings.gp, seed=seed, teams=teams)):
            programs = programs_of(game, trees)
            for random in unseen_seeds(seed + team, 2):
                for state in game.arena.trace(programs, random)[1].states[::10]:
                    for robot, player in enumerate(settings.players):
                        if player.control == "evolve":
                            see(camera, state, robot, player.team, retina, features, seen)
                            areas["ball"] += [seen[0]] if seen[0] else []
                            areas["goal"] += [area for area in seen[1:ROBOTS] if area]
                            areas["robot"] += [area for area in seen[ROBOTS:] if area]
    rows, data = [], []
    for kind, found in areas.items():
        low, high = np.quantile(found, [1 / 3, 2 / 3])
        data.append({"seen": kind, "samples": len(found), "small_below_px": float(low), "large_from_px": float(high)})
        rows.append([kind, str(len(found)), f"{low:.0f}", f"{high:.0f}"])
    show(data, table(["seen", "samples", "small below [px]", "large from [px]"], rows), as_json=as_json)
