"""How much a setting's placement leaves to evolve: hand-typed teams and random trees, measured.

A placement is fit for co-evolution if random trees are far from the best hand-typed team, so that there is room, and
if r0 passing and r1 shooting beats either robot alone and both shooting, so that it is worth it.
"""

from __future__ import annotations

import click
import numpy as np

from analysis.games import play
from coevo.config import RunSettings
from coevo.console import output_options, show, table
from coevo.evolution import random_teams
from coevo.game import SoccerGame
from coevo.recipes import read_settings
from coevo.statistics import mean_interval
from coevo.tree import parse

__all__ = ["placement"]

_SHOOTER = "IF_ball_is_lost(search, shoot)"
_PASSER = "IF_ball_is_lost(search, pass)"
_ONCE = "IF_ball_is_small(search, pass)"  # gives the ball away and stays back
_TEAMS = {
    "r0 shoots": ("shoot", "search"),
    "r1 shoots": ("search", "shoot"),
    "both shoot": ("shoot", "shoot"),
    "both search, then shoot": (_SHOOTER, _SHOOTER),
    "r0 passes, r1 shoots": ("pass", "shoot"),
    "r0 searches, then passes, r1 shoots": (_PASSER, "shoot"),
    "both search, then r0 passes, r1 shoots": (_PASSER, _SHOOTER),
    "r0 passes once, r1 shoots": (_ONCE, "shoot"),
}


@click.command()
@click.argument("recipe")
@click.option("--games", type=click.IntRange(min=1), default=400, show_default=True, help="A hand-typed team.")
@click.option(
    "--random-teams", "random_count", type=click.IntRange(min=1), default=60, show_default=True, help="20 games each."
)
@click.option("--seed", type=click.IntRange(min=0, max=2**63 - 1), default=1, show_default=True)
@click.option("--set", "assignments", multiple=True, metavar="KEY=VALUE", help="Replaces a setting; may be repeated.")
@output_options
def placement(
    *,
    recipe: str,
    games: int,
    random_count: int,
    seed: int,
    assignments: tuple[str, ...],
    as_json: bool,
    quiet: bool,
) -> None:
    """Measure hand-typed teams and random trees of RECIPE; r2 shoots where it evolves, stands where it does not.

    \b
    Example: coevo reproduce placement two-learners
             coevo reproduce placement three-learners --set game.time_limit_steps=800
    """
    del quiet  # it shows no progress
    settings = read_settings(RunSettings, recipe, assignments)
    game, robots = SoccerGame(settings), len(settings.players)
    rows, data = [], []
    opponents = (
        [None, parse("search"), parse(_SHOOTER)] if robots > 2 and settings.players[2].control == "evolve" else [None]
    )
    for name, team in _TEAMS.items():
        for opponent in opponents if robots > 2 else [None]:
            if robots > 2 and opponent is None and settings.players[2].control == "evolve":
                continue
            trees = [parse(team[0]), parse(team[1]), *([opponent] if robots > 2 else [])]
            outcome = play(game, trees, games=games, seed=seed)
            goals, lost = outcome.scorer == 0, outcome.scorer == 1
            low, high = mean_interval(goals.astype(float))[1:]
            data.append(
                {
                    "team": name,
                    "opponent": None if opponent is None else str(opponent),
                    "goals": [20.0 * value for value in mean_interval(goals.astype(float))],
                    "lost": 20.0 * float(lost.mean()),
                    "steps": float(outcome.steps.mean()),
                }
            )
            rows.append(
                [
                    name + ("" if opponent is None else f" / r2: {opponent}"),
                    f"{20 * goals.mean():.1f} [{20 * low:.1f}, {20 * high:.1f}]",
                    f"{20 * lost.mean():.1f}",
                    f"{outcome.steps.mean():.0f}",
                    f"{20 * outcome.passes[:, 0].mean():.1f}",
                    " ".join(f"{20 * k:.0f}" for k in outcome.kicks.mean(axis=0)),
                    f"{20 * outcome.collisions.mean(axis=0).max():.0f}",
                ]
            )
    teams = random_teams(game, settings.gp, seed=seed, teams=random_count)
    found = np.array([play(game, trees, games=20, seed=seed).goals_of(0) for trees in teams])
    header = ["team", "goals", "lost", "steps", "passes r0", "kicks", "collisions"]
    text = (
        f"{recipe}: goals of r0 and r1 in 20 games (95 % interval), {games} games a row\n{table(header, rows)}\n"
        f"random trees ({len(found)} teams, 20 games each): mean {found.mean():.1f},"
        f" standard deviation {found.std():.1f}, best {found.max()}, none in {np.mean(found == 0):.0%}"
    )
    show({"recipe": recipe, "games": games, "teams": data, "random_teams": found.tolist()}, text, as_json=as_json)
