"""Measure the limits of the size categories: terciles of area over the visible samples of random play.

    python -m analysis.categories

The defaults of coevo.config.CategorySettings are this, rounded.
"""

from __future__ import annotations

import click
import numpy as np

from analysis._games import unseen_seeds
from coevo.cli.evolving import read_recipe
from coevo.config import RunSettings, check
from coevo.console import table
from coevo.evolution.population import codes_of, first_population
from coevo.game import Arena
from coevo.soccer.camera import ROBOTS, camera_params, make_retina, object_count, see
from coevo.tree import compile_program, function_set

__all__ = ["main"]


@click.command()
@click.argument("recipes", nargs=-1)
@click.option("--teams", default=40, show_default=True, help="Random teams of each recipe, two games each.")
@click.option("--seed", default=1, show_default=True)
def main(*, recipes: tuple[str, ...], teams: int, seed: int) -> None:
    """Print the terciles of the areas of ball, goals and robots, as robots of random trees see them."""
    areas: dict[str, list[float]] = {"ball": [], "goal": [], "robot": []}
    for recipe in recipes or ("two-learners", "stationary-opponent", "three-learners"):
        settings = check(RunSettings, read_recipe(recipe), recipe)
        arena, robots = Arena(settings), len(settings.players)
        functions = [function_set(robot, robots) for robot in range(robots)]
        populations = [first_population(settings.gp, functions[r], seed=seed, robot=r) for r in range(robots)]
        camera, retina = camera_params(settings.world), make_retina(settings.world)
        features, seen = np.zeros((object_count(robots), 11)), np.zeros(object_count(robots))
        for team in range(min(teams, settings.gp.population)):
            programs = [
                compile_program(codes_of(populations[r][team], functions[r]), functions[r])
                if player.control == "evolve"
                else None
                for r, player in enumerate(settings.players)
            ]
            for random in unseen_seeds(seed + team, 2):
                for state in arena.trace(programs, random)[1].states[::10]:
                    for robot, player in enumerate(settings.players):
                        if player.control == "evolve":
                            see(camera, state, robot, player.team, retina, features, seen)
                            areas["ball"] += [seen[0]] if seen[0] else []
                            areas["goal"] += [area for area in seen[1:ROBOTS] if area]
                            areas["robot"] += [area for area in seen[ROBOTS:] if area]
    rows = []
    for kind, found in areas.items():
        low, high = np.quantile(found, [1 / 3, 2 / 3])
        rows.append([kind, str(len(found)), f"{low:.0f}", f"{high:.0f}"])
    click.echo(table(["seen", "samples", "small below [px]", "large from [px]"], rows))


if __name__ == "__main__":
    main()
