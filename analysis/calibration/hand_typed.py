"""Teams that a person would type: what evolved trees, and placements, are measured by."""

from __future__ import annotations

from coevo.errors import InputError
from coevo.game import SoccerGame
from coevo.tree import Tree, parse

__all__ = ["GAMES_OF_ONE_GROUPING", "ONCE", "PASSER", "SHOOTER", "TEAMS", "needs_opponent", "team_trees"]

SHOOTER = "IF_ball_is_lost(search, shoot)"
PASSER = "IF_ball_is_lost(search, pass)"
ONCE = "IF_ball_is_small(search, pass)"  # gives the ball away and stays back

TEAMS = {
    "r0 shoots": ("shoot", "search"),
    "r1 shoots": ("search", "shoot"),
    "both shoot": ("shoot", "shoot"),
    "both search, then shoot": (SHOOTER, SHOOTER),
    "r0 passes, r1 shoots": ("pass", "shoot"),
    "r0 searches, then passes, r1 shoots": (PASSER, "shoot"),
    "both search, then r0 passes, r1 shoots": (PASSER, SHOOTER),
    "r0 passes once, r1 shoots": (ONCE, "shoot"),
}
"""The trees of r0 and r1, by what people call the team."""

GAMES_OF_ONE_GROUPING = 20
"""What people count goals in: those of Table 6.3 by which an individual is judged."""


def needs_opponent(game: SoccerGame) -> bool:
    """Return whether somebody beside the team mates r0 and r1 evolves, and has to be told how to play.

    Raises:
        InputError: r0 and r1 are no team that evolves.
    """
    evolves = [role.evolves for role in game.roles]
    if len(evolves) < 2 or not all(evolves[:2]) or game.roles[0].team != game.roles[1].team:
        raise InputError("hand-typed teams are of r0 and r1: they must be in one team, and both evolve")
    return any(evolves[2:])


def team_trees(game: SoccerGame, team: tuple[str, str], opponent: str | None) -> list[Tree | None]:
    """Return who plays: the trees of r0 and r1, and for all others that evolve that of the opponent.

    Raises:
        InputError: r0 and r1 are no team, or somebody has no tree.
    """
    if needs_opponent(game) != (opponent is not None):
        raise InputError(f"an opponent plays by a tree where it evolves, and only there; got {opponent!r}")
    others = [parse(opponent) if role.evolves and opponent is not None else None for role in game.roles[2:]]
    return [parse(team[0]), parse(team[1]), *others]
