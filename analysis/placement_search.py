"""Search start regions in which passing is worth it: random placements, hand-typed teams, the best measured again.

    python -m analysis.placement_search two-learners --candidates 200

For each placement the best team that passes is compared with the best that does not. The presets' placements were
chosen from this list; docs/decisions/0004-placements.md says which and why.
"""

from __future__ import annotations

from typing import Any

import click
import numpy as np

from analysis._games import play
from coevo.cli.evolving import read_recipe
from coevo.config import RunSettings, check
from coevo.console import note, table
from coevo.game import Arena
from coevo.tree import parse

__all__ = ["main"]

_SHOOTER = "IF_ball_is_lost(search, shoot)"
_ALONE = [("shoot", "search"), ("search", "shoot"), ("shoot", "shoot"), (_SHOOTER, _SHOOTER)]
_PASSING = [
    ("pass", "shoot"),
    ("pass", _SHOOTER),
    ("IF_ball_is_lost(search, pass)", _SHOOTER),
    ("IF_ball_is_small(search, pass)", "shoot"),
]
_ROOM, _SIGNAL = 14.0, 3.0  # goals in 20 games that one robot alone may have at most, and hand-typed shooters at least
_BALL_SPREAD, _ROBOT_SPREAD = 0.3, 0.3  # half widths of the regions [m]


def _placement(recipe: dict[str, Any], random: np.random.Generator) -> dict[str, Any]:
    """Return the recipe with ball, r0 and r1 somewhere else: r0 near the ball, r1 farther off."""

    def region(x: float, y: float, half: float, edge: float) -> dict[str, Any]:
        low_x, high_x = max(edge, x - half), min(8.22 - edge, x + half)
        low_y, high_y = max(edge, y - half), min(4.575 - edge, y + half)
        return {"x_m": [round(low_x, 2), round(high_x, 2)], "y_m": [round(low_y, 2), round(high_y, 2)]}

    ball_x, ball_y = random.uniform(1.5, 6.5), random.uniform(0.5, 2.3)
    angle, far = random.uniform(-np.pi, np.pi), random.uniform(0.7, 1.2)
    r0_x, r0_y = (
        float(np.clip(ball_x + far * np.cos(angle), 0.6, 7.6)),
        float(np.clip(ball_y + far * np.sin(angle), 0.5, 4.1)),
    )
    while True:
        r1_x, r1_y = random.uniform(0.8, 6.5), random.uniform(0.6, 4.0)
        if np.hypot(r1_x - ball_x, r1_y - ball_y) > 1.8:
            break
    facing = str(random.choice(["ball", "opponent_goal"]))
    players = [dict(player) for player in recipe["players"]]
    players[0]["start"] = {**region(r0_x, r0_y, _ROBOT_SPREAD, 0.25), "facing": "ball", "spread_deg": 15.0}
    players[1]["start"] = {**region(r1_x, r1_y, _ROBOT_SPREAD, 0.25), "facing": facing, "spread_deg": 15.0}
    limit = int(random.choice([400, 500, 600, 700] if len(players) == 2 else [500, 600, 800, 1000]))
    game = {"time_limit_steps": limit, "ball_start": region(ball_x, ball_y, _BALL_SPREAD, 0.15)}
    return {**recipe, "game": game, "players": players}


def _goals(arena: Arena, team: tuple[str, str], opponent: str | None, games: int, seed: int) -> float:
    robots = len(arena.settings.players)
    trees = [parse(text) for text in team] + [None if opponent is None else parse(opponent)] * (robots - 2)
    outcome = play(arena, trees, games=games, seed=seed)
    return 20.0 * float((outcome.scorer == 0).mean() - (outcome.scorer == 1).mean())


@click.command()
@click.argument("recipe")
@click.option("--candidates", default=200, show_default=True)
@click.option(
    "--games", default=60, show_default=True, help="A team in the search; the best are measured with ten times as many."
)
@click.option("--seed", default=1, show_default=True)
@click.option("--opponent", default=None, help="Tree of r2 if it evolves.")
def main(*, recipe: str, candidates: int, games: int, seed: int, opponent: str | None) -> None:
    """Print the placements of RECIPE where passing helps most: goals minus lost goals in 20 games."""
    random = np.random.default_rng(seed)
    plain = read_recipe(recipe)
    found: list[tuple[float, float, float, dict[str, Any]]] = []
    for number in range(candidates):
        data = _placement(plain, random)
        arena = Arena(check(RunSettings, data, recipe))
        goals = [_goals(arena, team, opponent, games, seed) for team in _ALONE]
        alone = max(goals)
        if alone < _ROOM and goals[-1] > _SIGNAL:
            passing = max(_goals(arena, team, opponent, games, seed) for team in _PASSING)
            found.append((passing - alone, passing, alone, data))
        if (number + 1) % 50 == 0:
            note(f"{number + 1} of {candidates} placements")
    rows = []
    for _, _, _, data in sorted(found, key=lambda item: -item[0])[:8]:
        arena = Arena(check(RunSettings, data, recipe))
        single = [_goals(arena, team, opponent, 10 * games, seed + 1) for team in _ALONE]
        together = [_goals(arena, team, opponent, 10 * games, seed + 1) for team in _PASSING]
        where = [data["game"]["ball_start"], *(player["start"] for player in data["players"][:2])]
        places = [f"x {np.mean(w['x_m']):.1f} y {np.mean(w['y_m']):.1f} {w.get('facing', '')}" for w in where]
        rows.append(
            [
                *places,
                str(data["game"]["time_limit_steps"]),
                " ".join(f"{goals:.1f}" for goals in single),
                " ".join(f"{goals:.1f}" for goals in together),
            ]
        )
    header = ["ball", "r0", "r1", "steps", "r0 / r1 / both shoot / hand-typed", "four teams that pass"]
    click.echo(table(header, rows))


if __name__ == "__main__":
    main()
