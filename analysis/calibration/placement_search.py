"""Search start regions in which passing is worth it: random placements, hand-typed teams, the best measured again.

What counts is the fitness (6.1) that evolution sees, of both robots: it rewards touching the ball too, so that a robot
that dribbles by itself may be fitter than one that passes though its team scores less. Each game runs to the longest
time limit, and says what shorter ones would have made of it. docs/decisions/0004-placements.md says what was chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import click
import numpy as np
import pandas as pd

from analysis.calibration.hand_typed import GAMES_OF_ONE_GROUPING, ONCE, PASSER, SHOOTER, needs_opponent, team_trees
from analysis.games import play
from coevo.config import FieldSettings, RunSettings, check, file_kind
from coevo.console import note, output_options, show, table
from coevo.errors import InputError
from coevo.fitness import fixed
from coevo.game import SoccerGame, StartsDoNotFitError
from coevo.recipes import read_recipe

__all__ = ["LIMITS", "Place", "best_places", "gain_of", "placement_search", "random_placement", "worth"]

LIMITS = (350, 400, 450, 500, 550, 600, 700, 800)
"""Time limits [steps] that are compared; games run to the last."""

_Teams = Sequence[tuple[str, str]]
_ALONE: _Teams = [("shoot", "search"), ("search", "shoot"), ("shoot", "shoot"), (SHOOTER, SHOOTER)]
_PASSING: _Teams = [("pass", "shoot"), (PASSER, "shoot"), (PASSER, SHOOTER), (ONCE, "shoot")]
_SPREAD = 0.25  # half width of the regions [m]
_FIRST_LOOK = 40  # games a team, before the rest of a placement is measured
_FIRST_TEAMS = 2  # of either kind, in that look
_NEARLY = 2.0  # in fitness: a placement that is farther behind in the first look is not measured on
_SHOWN = 8
_FIELD = FieldSettings()


@dataclass(frozen=True)
class Place:
    """A placement that was measured.

    Attributes:
        settings: ``game`` and ``players`` of a recipe, as plain data.
        worth: a row a team and time limit; see ``worth``, and ``kind`` (alone or passing).
        limit: the time limit [steps] at which passing is ahead most.
        gain: by how much it is, in fitness.
    """

    settings: dict[str, Any]
    worth: pd.DataFrame
    limit: int
    gain: float


def _region(x: float, y: float, edge: float) -> dict[str, Any]:
    low_x, high_x = max(edge, x - _SPREAD), min(_FIELD.length_m - edge, x + _SPREAD)
    low_y, high_y = max(edge, y - _SPREAD), min(_FIELD.width_m - edge, y + _SPREAD)
    return {"x_m": [round(low_x, 2), round(high_x, 2)], "y_m": [round(low_y, 2), round(high_y, 2)]}


def random_placement(recipe: dict[str, Any], random: np.random.Generator) -> dict[str, Any]:
    """Return a recipe with ball, r0 and r1 somewhere else: r0 near the ball, r1 farther off.

    Args:
        recipe: plain data, on the field of the presets; it is not changed.
        random: draws.
    """
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
    game = {"time_limit_steps": LIMITS[-1], "ball_start": _region(ball_x, ball_y, 0.15)}
    return {**recipe, "game": game, "players": players}


def worth(game: SoccerGame, team: tuple[str, str], opponent: str | None, *, games: int, seed: int) -> pd.DataFrame:
    """Return what a team of r0 and r1 is worth, a row a time limit, from games that were played once.

    Args:
        game: with a time limit of the longest of ``LIMITS``.
        team: trees of r0 and r1.
        opponent: tree of the others that evolve, None where none does.
        games: that are played.
        seed: of these games.

    Returns:
        ``limit`` [steps], and in 20 games ``goals``, ``lost`` and ``steps``, exactly as with that limit; ``kicks_r0``
        and ``kicks_r1`` (steps of contact), as if a game's were spread evenly over it: up to a thousand too many, for
        robots that come to the ball late, at limits far below the longest; ``fitness``, the sum of (6.1) of both robots
        (a thousand kicks are 1), without collisions, of which a game does not say when they happened either.
    """
    outcome = play(game, team_trees(game, team, opponent), games=games, seed=seed)
    side = game.roles[0].team
    won, lost = outcome.scorer == side, (outcome.scorer >= 0) & (outcome.scorer != side)
    rows = []
    for limit in LIMITS:
        played = np.minimum(outcome.steps, limit)
        in_time = outcome.steps <= limit
        goals, against = (GAMES_OF_ONE_GROUPING * float((in_time & what).mean()) for what in (won, lost))
        shares = outcome.kicks[:, :2] * (played / outcome.steps)[:, None]
        kicks = (GAMES_OF_ONE_GROUPING * shares.mean(axis=0)).tolist()
        steps = GAMES_OF_ONE_GROUPING * float(played.mean())
        fitness = sum(float(fixed(goals, against, touched, 0, steps)) for touched in kicks)
        rows.append((limit, goals, against, steps, *kicks, fitness))
    return pd.DataFrame(rows, columns=["limit", "goals", "lost", "steps", "kicks_r0", "kicks_r1", "fitness"])


def gain_of(worths: pd.DataFrame) -> pd.Series:
    """Return by how much the fittest team that passes is ahead of the fittest that does not, by time limit.

    Args:
        worths: rows of ``worth``, with ``kind``: alone or passing. Less fitness is better.
    """
    least = worths.groupby(["kind", "limit"])["fitness"].min()
    gain: pd.Series = least["alone"] - least["passing"]
    return gain


def _worths(
    game: SoccerGame, alone: _Teams, passing: _Teams, opponent: str | None, games: int, seed: int
) -> pd.DataFrame:
    frames = [
        worth(game, team, opponent, games=games, seed=seed).assign(kind=kind, team=" + ".join(team))
        for kind, teams in (("alone", alone), ("passing", passing))
        for team in teams
    ]
    return pd.concat(frames, ignore_index=True)


def best_places(
    recipe: str,
    *,
    candidates: int,
    games: int,
    seed: int,
    opponent: str | None = None,
    report: Callable[[int], None] = lambda _: None,
) -> list[Place]:
    """Return the placements, of random ones, where passing makes both robots fittest: the best first, up to eight.

    Args:
        recipe: name or path.
        candidates: how many placements are drawn.
        games: of each team in the search; the best are measured by four times as many others.
        seed: of placements and games.
        opponent: tree of the others that evolve.
        report: is told after each placement how many are done.

    Raises:
        InputError: r0 and r1 are no team that evolves, another robot evolves and has no tree, or the field is not that
            of the presets.
    """
    plain = read_recipe(recipe, file_kind(RunSettings))
    settings = check(RunSettings, plain, recipe)
    if opponent is None and needs_opponent(SoccerGame(settings)):
        raise InputError(f"in {recipe} another robot evolves too: say how it plays, as in --opponent shoot")
    if (settings.world.field.length_m, settings.world.field.width_m) != (_FIELD.length_m, _FIELD.width_m):
        raise InputError(
            f"placements are drawn for a field of {_FIELD.length_m:g} x {_FIELD.width_m:g} m;"
            f" leave world.field.length_m and width_m out of {recipe}"
        )
    random = np.random.default_rng(seed)
    found: list[tuple[float, dict[str, Any]]] = []
    for number in range(candidates):
        data = random_placement(plain, random)
        game = SoccerGame(check(RunSettings, data, recipe))
        try:
            quick = _worths(game, _ALONE[:_FIRST_TEAMS], _PASSING[:_FIRST_TEAMS], opponent, _FIRST_LOOK, seed)
            if gain_of(quick).max() > _NEARLY:
                gain = gain_of(_worths(game, _ALONE, _PASSING, opponent, games, seed))
                found.append((float(gain.max()), data))
        except StartsDoNotFitError:
            pass
        report(number + 1)
    best = sorted(found, key=lambda item: -item[0])[:_SHOWN]
    return [_measured(data, recipe, opponent, 4 * games, seed + 1) for _, data in best]


def _measured(data: dict[str, Any], recipe: str, opponent: str | None, games: int, seed: int) -> Place:
    worths = _worths(SoccerGame(check(RunSettings, data, recipe)), _ALONE, _PASSING, opponent, games, seed)
    gain = gain_of(worths)
    at = int(gain.to_numpy().argmax())
    settings = {"game": data["game"], "players": data["players"]}
    return Place(settings, worths, LIMITS[at], float(gain.to_numpy()[at]))


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
    Example: coevo reproduce placement-search chapter6/dissertation-two-learners --candidates 200
    """

    def report(done: int) -> None:
        if done % 50 == 0:
            note(f"{done} of {candidates} placements", quiet=quiet)

    found = best_places(recipe, candidates=candidates, games=games, seed=seed, opponent=opponent, report=report)
    data = [{**place.settings, "steps": place.limit, "gain": place.gain} for place in found]
    show(data, _text(found), as_json=as_json)


def _text(found: Iterable[Place]) -> str:
    rows = []
    for place in found:
        where = [place.settings["game"]["ball_start"], *(player["start"] for player in place.settings["players"][:2])]
        at = place.worth[place.worth["limit"] == place.limit]
        rows.append(
            [
                *(f"x {np.mean(w['x_m']):.1f} y {np.mean(w['y_m']):.1f} {w.get('facing', '')}" for w in where),
                str(place.limit),
                *(
                    " ".join(f"{w['goals']:.1f}-{w['lost']:.1f}" for w in at[at["kind"] == kind].to_dict("records"))
                    for kind in ("alone", "passing")
                ),
                f"{place.gain:.1f}",
            ]
        )
    header = ["ball", "r0", "r1", "steps", "r0 / r1 / both shoot / hand-typed", "four teams that pass", "fitness gain"]
    return table(header, rows)
