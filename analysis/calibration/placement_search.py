"""Search start regions in which passing is worth it: random placements, hand-typed teams, the best measured again.

What counts is the fitness (6.1) that evolution sees, of both robots: it rewards touching the ball too, so that a robot
that dribbles by itself may be fitter than one that passes though its team scores less. Each game runs to the longest
time limit, and says what shorter ones would have made of it. docs/decisions/0004-placements.md says what was chosen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from analysis.games import play
from coevo.config import RunSettings, check, file_kind
from coevo.console import note, output_options, show, table
from coevo.errors import InputError
from coevo.fitness import fixed
from coevo.game import SoccerGame, StartsDoNotFitError
from coevo.recipes import read_recipe
from coevo.tree import parse

__all__ = ["placement_search"]

_SHOOTER = "IF_ball_is_lost(search, shoot)"
_PASSER = "IF_ball_is_lost(search, pass)"
_ALONE = [("shoot", "search"), ("search", "shoot"), ("shoot", "shoot"), (_SHOOTER, _SHOOTER)]
_PASSING = [("pass", "shoot"), (_PASSER, "shoot"), (_PASSER, _SHOOTER), ("IF_ball_is_small(search, pass)", "shoot")]
_LIMITS = np.array([350, 400, 450, 500, 550, 600, 700, 800])
_SPREAD = 0.25  # half width of the regions [m]
_FIRST_LOOK = 40  # games a team, before the rest of a placement is measured
_GAMES_OF_ONE_GROUPING = 20
_LENGTH, _WIDTH = 8.22, 4.575


@dataclass(frozen=True)
class _Worth:
    """What a team is worth: (limits,) goals and lost goals in 20 games, and the sum of both robots' fitness."""

    goals: NDArray[np.float64]
    lost: NDArray[np.float64]
    fitness: NDArray[np.float64]


def _region(x: float, y: float, edge: float) -> dict[str, Any]:
    low_x, high_x = max(edge, x - _SPREAD), min(_LENGTH - edge, x + _SPREAD)
    low_y, high_y = max(edge, y - _SPREAD), min(_WIDTH - edge, y + _SPREAD)
    return {"x_m": [round(low_x, 2), round(high_x, 2)], "y_m": [round(low_y, 2), round(high_y, 2)]}


def _placement(recipe: dict[str, Any], random: np.random.Generator) -> dict[str, Any]:
    """Return the recipe with ball, r0 and r1 somewhere else: r0 near the ball, r1 farther off."""
    ball_x, ball_y = random.uniform(1.0, 7.4), random.uniform(0.4, 2.3)
    angle, far = random.uniform(-np.pi, np.pi), random.uniform(0.6, 1.2)
    r0_x = float(np.clip(ball_x + far * np.cos(angle), 0.5, 7.7))
    r0_y = float(np.clip(ball_y + far * np.sin(angle), 0.45, 4.1))
    while True:
        r1_x, r1_y = random.uniform(1.0, 7.2), random.uniform(0.6, 4.0)
        if np.hypot(r1_x - ball_x, r1_y - ball_y) > 2.0:
            break
    players = [dict(player) for player in recipe["players"]]
    players[0]["start"] = {**_region(r0_x, r0_y, 0.25), "facing": "ball", "spread_deg": 15.0}
    facing = str(random.choice(["ball", "opponent_goal"]))
    players[1]["start"] = {**_region(r1_x, r1_y, 0.25), "facing": facing, "spread_deg": 15.0}
    game = {"time_limit_steps": int(_LIMITS[-1]), "ball_start": _region(ball_x, ball_y, 0.15)}
    return {**recipe, "game": game, "players": players}


def _worth(game: SoccerGame, team: tuple[str, str], opponent: str | None, games: int, seed: int) -> _Worth:
    robots = len(game.settings.players)
    trees = [parse(text) for text in team] + [None if opponent is None else parse(opponent)] * (robots - 2)
    outcome = play(game, trees, games=games, seed=seed)
    rows = []
    for limit in _LIMITS:
        played = np.minimum(outcome.steps, limit)
        in_time = outcome.steps <= limit
        goals, lost = (_GAMES_OF_ONE_GROUPING * float((in_time & (outcome.scorer == side)).mean()) for side in (0, 1))
        # A game does not say when the ball was touched: as if evenly.
        kicks = _GAMES_OF_ONE_GROUPING * (outcome.kicks[:, :2] * (played / outcome.steps)[:, None]).mean(axis=0)
        steps = _GAMES_OF_ONE_GROUPING * float(played.mean())
        rows.append([goals, lost, sum(fixed(goals, lost, float(touched), 0, steps) for touched in kicks)])
    return _Worth(*np.array(rows).T)


def _least(worths: list[_Worth]) -> NDArray[np.float64]:
    best: NDArray[np.float64] = np.min([worth.fitness for worth in worths], axis=0)
    return best


@click.command()
@click.argument("recipe")
@click.option("--candidates", type=click.IntRange(min=1), default=200, show_default=True)
@click.option(
    "--games",
    type=click.IntRange(min=1),
    default=150,
    show_default=True,
    help="A team in the search; the best are measured with four times as many.",
)
@click.option("--seed", type=click.IntRange(min=0, max=2**63 - 1), default=1, show_default=True)
@click.option("--opponent", default=None, help="Tree of r2 if it evolves.")
@output_options
def placement_search(
    *, recipe: str, candidates: int, games: int, seed: int, opponent: str | None, as_json: bool, quiet: bool
) -> None:
    """Print the placements and time limits of RECIPE where passing makes both robots fittest.

    \b
    Example: coevo reproduce placement-search two-learners --candidates 200
    """
    random = np.random.default_rng(seed)
    plain = read_recipe(recipe, file_kind(RunSettings))
    others = check(RunSettings, plain, recipe).players[2:]
    if opponent is None and any(player.control == "evolve" for player in others):
        raise InputError(f"in {recipe} another robot evolves too: say how it plays, as in --opponent shoot")
    found: list[tuple[float, dict[str, Any]]] = []
    for number in range(candidates):
        data = _placement(plain, random)
        game = SoccerGame(check(RunSettings, data, recipe))
        try:
            quick = [_worth(game, team, opponent, _FIRST_LOOK, seed) for team in (*_ALONE[:2], *_PASSING[:2])]
        except StartsDoNotFitError:
            continue
        if float((_least(quick[:2]) - _least(quick[2:])).max()) > 2.0:
            alone = _least([_worth(game, team, opponent, games, seed) for team in _ALONE])
            passing = _least([_worth(game, team, opponent, games, seed) for team in _PASSING])
            found.append((float((alone - passing).max()), data))
        if (number + 1) % 50 == 0:
            note(f"{number + 1} of {candidates} placements", quiet=quiet)
    rows, told = [], []
    for _, data in sorted(found, key=lambda item: -item[0])[:8]:
        game = SoccerGame(check(RunSettings, data, recipe))
        alone_worth = [_worth(game, team, opponent, 4 * games, seed + 1) for team in _ALONE]
        passing_worth = [_worth(game, team, opponent, 4 * games, seed + 1) for team in _PASSING]
        gain = _least(alone_worth) - _least(passing_worth)
        at = int(gain.argmax())
        where = [data["game"]["ball_start"], *(player["start"] for player in data["players"][:2])]
        told.append(
            {"game": data["game"], "players": data["players"], "steps": int(_LIMITS[at]), "gain": float(gain[at])}
        )
        rows.append(
            [
                *(f"x {np.mean(w['x_m']):.1f} y {np.mean(w['y_m']):.1f} {w.get('facing', '')}" for w in where),
                str(_LIMITS[at]),
                *(
                    " ".join(f"{w.goals[at]:.1f}-{w.lost[at]:.1f}" for w in kind)
                    for kind in (alone_worth, passing_worth)
                ),
                f"{gain[at]:.1f}",
            ]
        )
    header = ["ball", "r0", "r1", "steps", "r0 / r1 / both shoot / hand-typed", "four teams that pass", "fitness gain"]
    show(told, table(header, rows), as_json=as_json)
