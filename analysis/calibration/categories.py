"""Measure the limits of the size categories: terciles of area over the visible samples of random play.

The defaults of coevo.config.CategorySettings are about this; docs/decisions/0004-placements.md says how near.
"""

from __future__ import annotations

from collections.abc import Sequence

import click
import numpy as np
import pandas as pd

from analysis.games import unseen_seeds
from coevo.config import RunSettings
from coevo.console import output_options, show, table
from coevo.evolution import random_teams
from coevo.game import SoccerGame, programs_of
from coevo.recipes import read_settings
from coevo.soccer.camera import BALL, FEATURES, ROBOTS, camera_params, make_retina, object_count, see

__all__ = ["areas_table", "categories", "tercile_table"]

_GAMES = 2  # of each random team
_EVERY = 10  # steps from sample to sample


def areas_table(settings: RunSettings, *, teams: int, seed: int) -> pd.DataFrame:
    """Return the areas of what robots of random trees see, a row a sight.

    Args:
        settings: the experiment; a robot that stands is seen, and sees nothing.
        teams: of random trees, two games each; no more than a population has individuals.
        seed: of the trees, and with the number of the team of its games.

    Returns:
        ``team``, ``game``, ``step`` (every tenth), ``robot`` (who looks), ``seen`` (ball, goal or robot), ``area_px``.
    """
    game, robots = SoccerGame(settings), len(settings.players)
    camera, retina = camera_params(settings.world), make_retina(settings.world)
    features, areas = np.zeros((object_count(robots), FEATURES)), np.zeros(object_count(robots))
    kinds = ["ball" if thing == BALL else "goal" if thing < ROBOTS else "robot" for thing in range(len(areas))]
    rows = []
    for team, trees in enumerate(random_teams(game, settings.gp, seed=seed, teams=teams)):
        programs = programs_of(game, trees)
        for number, random in enumerate(unseen_seeds(seed + team, _GAMES)):
            states = game.arena.trace(programs, random)[1].states
            for step in range(0, len(states), _EVERY):
                for robot, player in enumerate(settings.players):
                    if player.control == "evolve":
                        see(camera, states[step], robot, player.team, retina, features, areas)
                        rows += [
                            (team, number, step, robot, kind, area)
                            for kind, area in zip(kinds, areas.tolist(), strict=True)
                            if area > 0.0
                        ]
    return pd.DataFrame(rows, columns=["team", "game", "step", "robot", "seen", "area_px"])


def tercile_table(areas: pd.DataFrame) -> pd.DataFrame:
    """Return ``seen``, ``samples``, ``small_below_px``, ``large_from_px``: terciles of what was seen of each kind.

    Args:
        areas: of ``areas_table``; a kind that was never seen has no row.
    """
    rows = []
    for kind in ("ball", "goal", "robot"):
        found = areas.loc[areas["seen"] == kind, "area_px"].to_numpy()
        if len(found):
            low, high = np.quantile(found, [1 / 3, 2 / 3])
            rows.append((kind, len(found), float(low), float(high)))
    return pd.DataFrame(rows, columns=["seen", "samples", "small_below_px", "large_from_px"])


def _together(recipes: Sequence[str], teams: int, seed: int) -> pd.DataFrame:
    settings = [read_settings(RunSettings, recipe) for recipe in recipes]
    return pd.concat([areas_table(one, teams=teams, seed=seed) for one in settings], ignore_index=True)


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
    presets = tuple(
        f"chapter6/dissertation-{name}" for name in ("two-learners", "stationary-opponent", "three-learners")
    )
    found = tercile_table(_together(recipes or presets, teams, seed))
    rows = [
        [row["seen"], str(row["samples"]), f"{row['small_below_px']:.0f}", f"{row['large_from_px']:.0f}"]
        for row in found.to_dict("records")
    ]
    text = table(["seen", "samples", "small below [px]", "large from [px]"], rows)
    show(found.to_dict("records"), text, as_json=as_json)
