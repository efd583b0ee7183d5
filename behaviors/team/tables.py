"""What happened to several robots, as rows: block by block while they learned, and in the games after it."""

from __future__ import annotations

from typing import Any

import numpy as np

from behaviors.team.recipe import TeamRecipe, TurnSettings
from behaviors.team.scene import COUNTED
from behaviors.trials.kernels import Results
from behaviors.trials.task import FAILURE, SUCCESS

__all__ = ["measured", "rates", "scored", "turn_rows"]

_TRIALS = 250  # a row


def scored(found: Results, team: int) -> int:
    """Return how many trials ended with a goal of a side."""
    return int((found.ends == (SUCCESS, FAILURE)[team]).sum())


def rates(found: Results, robot: int) -> dict[str, float]:
    """Return the share of trials in which what a robot may be rewarded for happened, by the name of the event."""
    return {event: float((found.counts[:, robot, number] > 0).mean()) for event, number in COUNTED.items()}


def turn_rows(recipe: TeamRecipe, turn: TurnSettings, found: Results, before: int) -> list[dict[str, Any]]:
    """Return the rows of ``frequencies.csv`` of one turn.

    Columns: ``turn``; ``trial`` at the end of the block, of all turns; ``trials`` in it; ``robot``, ``team``, and
    whether it ``learns``; ``scored``, trials that ended with a goal of its side; ``goals`` of its own, ``conceded``
    ones, ``passes``, ``giveaways`` (passes to an opponent); ``kicks``, steps of contact with the ball, and ``kicked``,
    trials with any; ``collisions``, and ``collided``, trials with any.

    Args:
        recipe, turn: which.
        found: its trials.
        before: how many trials came before it.
    """
    rows = []
    for first in range(0, len(found.ends), _TRIALS):
        block = Results(*(column[first : first + _TRIALS] for column in found))
        for n, member in enumerate(recipe.robots):
            sums = {event: block.counts[:, n, number] for event, number in COUNTED.items()}
            rows.append(
                {
                    "turn": turn.name,
                    "trial": before + first + len(block.ends),
                    "trials": len(block.ends),
                    "robot": member.name,
                    "team": member.team,
                    "learns": int(member.name in turn.learners),
                    "scored": scored(block, member.team),
                    "goals": int(sums["goal"].sum()),
                    "conceded": int(sums["conceded"].sum()),
                    "passes": int(sums["pass"].sum()),
                    "giveaways": int(sums["giveaway"].sum()),
                    "kicks": int(sums["kick"].sum()),
                    "kicked": int((sums["kick"] > 0).sum()),
                    "collisions": int(sums["collision"].sum()),
                    "collided": int((sums["collision"] > 0).sum()),
                }
            )
    return rows


def measured(recipe: TeamRecipe, found: Results) -> dict[str, Any]:
    """Return what greedy games came to: of each side the share of games with its goal, of each robot its rates."""
    teams = sorted({member.team for member in recipe.robots})
    return {
        "games": len(found.ends),
        "steps": float(np.mean(found.steps)),
        "scored": {str(team): scored(found, team) / len(found.ends) for team in teams},
        "robots": {member.name: rates(found, n) for n, member in enumerate(recipe.robots)},
    }
