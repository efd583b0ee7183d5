"""How much a setting's placement leaves to evolve: hand-typed teams and random trees, measured.

A placement is fit for co-evolution if random trees are far from the best hand-typed team, so that there is room, and
if r0 passing and r1 shooting beats either robot alone and both shooting, so that it is worth it.
"""

from __future__ import annotations

import click
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.calibration.hand_typed import (
    GAMES_OF_ONE_GROUPING,
    SHOOTER,
    TEAMS,
    needs_opponent,
    team_trees,
)
from analysis.games import play
from coevo.config import GPSettings, RunSettings
from coevo.console import output_options, show, table
from coevo.evolution import random_teams
from coevo.game import SoccerGame
from coevo.recipes import read_settings
from coevo.statistics import mean_interval

__all__ = ["hand_typed_table", "placement", "random_goals"]

_OPPONENTS = ("search", SHOOTER)


def hand_typed_table(game: SoccerGame, *, games: int, seed: int) -> pd.DataFrame:
    """Return what hand-typed teams of r0 and r1 come to, a row a team and opponent; all play the same games.

    Args:
        game: r0 and r1 are a team that evolves.
        games: of each row.
        seed: of these games.

    Returns:
        ``team``; ``opponent``: the tree of the others that evolve, None where none does. In 20 games: ``goals``,
        ``low``, ``high`` (with the interval over games, cut at 0 and 20), ``lost``, ``passes`` of r0, ``kicks_r0``,
        ``kicks_r1``, ... (steps of contact of each robot) and ``collisions`` of the one that has most. ``steps`` is of
        one game.

    Raises:
        InputError: r0 and r1 are no team that evolves.
    """
    rows = []
    for name, team in TEAMS.items():
        for opponent in _OPPONENTS if needs_opponent(game) else (None,):
            outcome = play(game, team_trees(game, team, opponent), games=games, seed=seed)
            side = game.roles[0].team
            goals, lost = outcome.scorer == side, (outcome.scorer >= 0) & (outcome.scorer != side)
            mean, low, high = (GAMES_OF_ONE_GROUPING * value for value in mean_interval(goals.astype(float)))
            kicks = GAMES_OF_ONE_GROUPING * outcome.kicks.mean(axis=0)
            rows.append(
                {
                    "team": name,
                    "opponent": opponent,
                    "goals": mean,
                    "low": max(0.0, low),
                    "high": min(float(GAMES_OF_ONE_GROUPING), high),
                    "lost": GAMES_OF_ONE_GROUPING * float(lost.mean()),
                    "steps": float(outcome.steps.mean()),
                    "passes": GAMES_OF_ONE_GROUPING * float(outcome.passes[:, 0].mean()),
                    **{f"kicks_{role.name}": float(k) for role, k in zip(game.roles, kicks, strict=True)},
                    "collisions": GAMES_OF_ONE_GROUPING * float(outcome.collisions.mean(axis=0).max()),
                }
            )
    return pd.DataFrame(rows)


def random_goals(game: SoccerGame, settings: GPSettings, *, teams: int, seed: int) -> NDArray[np.int64]:
    """Return (teams,) goals of r0's team in 20 games, for teams of random trees.

    Args:
        game: what is played.
        settings: how trees are made; no more teams than a population has individuals.
        teams: how many.
        seed: of the trees, and of the games that all teams play.
    """
    drawn = random_teams(game, settings, seed=seed, teams=teams)
    side = game.roles[0].team
    goals = [play(game, trees, games=GAMES_OF_ONE_GROUPING, seed=seed).goals_of(side) for trees in drawn]
    return np.array(goals, np.int64)


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
    """Measure hand-typed teams and random trees of RECIPE; r2 searches, or searches and shoots, where it evolves.

    \b
    Example: coevo reproduce placement two-learners
             coevo reproduce placement three-learners --set game.time_limit_steps=800
    """
    del quiet  # it shows no progress
    settings = read_settings(RunSettings, recipe, assignments)
    game = SoccerGame(settings)
    teams = hand_typed_table(game, games=games, seed=seed)
    found = random_goals(game, settings.gp, teams=random_count, seed=seed)
    data = {
        "recipe": recipe,
        "games": games,
        "teams": [
            {
                **{name: row[name] for name in ("team", "opponent")},
                "goals": [row[name] for name in ("goals", "low", "high")],
                **{name: row[name] for name in ("lost", "steps")},
            }
            for row in teams.to_dict("records")
        ],
        "random_teams": found.tolist(),
    }
    text = (
        f"{recipe}: goals of r0 and r1 in 20 games (95 % interval), {games} games a row\n{_text(teams)}\n"
        f"random trees ({len(found)} teams, 20 games each): mean {found.mean():.1f},"
        f" standard deviation {found.std():.1f}, best {found.max()}, none in {np.mean(found == 0):.0%}"
    )
    show(data, text, as_json=as_json)


def _text(teams: pd.DataFrame) -> str:
    kicks = [name for name in teams.columns if name.startswith("kicks_")]
    rows = [
        [
            row["team"] + ("" if row["opponent"] is None else f" / r2: {row['opponent']}"),
            f"{row['goals']:.1f} [{row['low']:.1f}, {row['high']:.1f}]",
            f"{row['lost']:.1f}",
            f"{row['steps']:.0f}",
            f"{row['passes']:.1f}",
            " ".join(f"{row[name]:.0f}" for name in kicks),
            f"{row['collisions']:.0f}",
        ]
        for row in teams.to_dict("records")
    ]
    return table(["team", "goals", "lost", "steps", "passes r0", "kicks", "collisions"], rows)
