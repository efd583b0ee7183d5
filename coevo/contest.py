"""Champions of a run in games that evolution has not seen, against others and beside others."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coevo.config import EvolutionSettings
from coevo.evolution.evaluation import Evaluator, Match
from coevo.game import Game, Played, teams_of
from coevo.run import Run
from coevo.seeds import RunStream, game_seeds, generator
from coevo.statistics import paired_difference, share_interval
from coevo.tree import Program, compile_program, tree_codes

__all__ = [
    "Judged",
    "LineUp",
    "champions",
    "evolving_teams",
    "judge",
    "line_up",
    "play_lots",
    "single_skills",
    "unseen_games",
]

LineUp = Mapping[int, Program]
"""The programs of some roles, by the role's number."""

_MOST_TEAMS = 64  # of single skills that are tried
_LAST_ROUND = 4  # of them that are tried longer
_LOT = 50  # games of one task of a worker


def unseen_games(settings: EvolutionSettings) -> int:
    """Return how many games judge a run unless somebody says otherwise: a twentieth of all its games, 40 to 400."""
    gp = settings.gp
    return min(400, max(40, gp.generations * gp.population * settings.evaluation.games // 20))


def evolving_teams(game: Game) -> tuple[int, ...]:
    """Return the numbers of the teams of which at least one role evolves, ascending."""
    return tuple(team for team in teams_of(game) if any(role.evolves for role in game.roles if role.team == team))


def champions(run: Run, generation: int) -> dict[int, LineUp]:
    """Return the champions of a generation (``Run.champion``), by team."""
    game = run.game
    found: dict[int, dict[int, Program]] = {team: {} for team in evolving_teams(game)}
    for role, name in run.evolving.items():
        functions = game.function_set(role)
        codes = tree_codes(run.champion_tree(name, generation), functions)
        found[game.roles[role].team][role] = compile_program(codes, functions)
    return dict(found)


def line_up(game: Game, *parts: LineUp) -> list[Program | None]:
    """Return who plays: the programs of all roles that evolve, put together from parts."""
    programs: list[Program | None] = [None] * len(game.roles)
    for part in parts:
        for role, program in part.items():
            programs[role] = program
    return programs


def single_skills(game: Game, team: int, *, seed: int = 0) -> list[tuple[dict[int, str], LineUp]]:
    """Return the teams in which each robot uses one terminal throughout, with their names by role.

    Where there are more than 64 such teams, up to 64 of them, drawn by ``seed``.
    """
    roles = [number for number, role in enumerate(game.roles) if role.evolves and role.team == team]
    sizes = [len(game.function_set(role).terminals) for role in roles]
    if math.prod(sizes) <= _MOST_TEAMS:
        choices = list(itertools.product(*map(range, sizes)))
    else:
        drawn = generator(seed, RunStream.SINGLES, team).integers(sizes, size=(_MOST_TEAMS, len(sizes)))
        choices = sorted({tuple(row) for row in drawn.tolist()})
    return [
        (
            {role: game.function_set(role).terminals[k] for role, k in zip(roles, ks, strict=True)},
            {role: _alone(k) for role, k in zip(roles, ks, strict=True)},
        )
        for ks in choices
    ]


def _alone(terminal: int) -> Program:
    return Program(np.array([-1 - terminal], np.int16), np.zeros(1, np.int32))


@dataclass(frozen=True)
class Judged:
    """How the last champions of a team do in games that evolution has not seen.

    All three meet the same opponents, the last champions of the other teams, from the same starts.

    Attributes:
        team: its number.
        robots: names of its roles that evolve.
        games: how many each played.
        last, first, single_skills: share of games won, with its interval: the last champions, the first ones, and the
            best team in which each robot uses one skill throughout (chosen by other games).
        skills: that team's skill by name of the robot.
        over_first, over_single_skills: by how much the last champions' share is above, with its interval over the
            same games.
    """

    team: int
    robots: tuple[str, ...]
    games: int
    last: tuple[float, float, float]
    first: tuple[float, float, float]
    single_skills: tuple[float, float, float]
    skills: Mapping[str, str]
    over_first: tuple[float, float, float]
    over_single_skills: tuple[float, float, float]


def _lots(seeds: NDArray[np.uint64]) -> list[NDArray[np.uint64]]:
    return [seeds[first : first + _LOT] for first in range(0, len(seeds), _LOT)]


def play_lots(
    evaluator: Evaluator, teams: Sequence[Sequence[Program | None]], seeds: NDArray[np.uint64]
) -> Iterator[Played]:
    """Let each team play the same games, (games,) seeds; yield what happened, lot by lot, in their order."""
    return evaluator.play(Match(programs, lot) for programs in teams for lot in _lots(seeds))


def _winners(
    evaluator: Evaluator, teams: Sequence[Sequence[Program | None]], seeds: NDArray[np.uint64]
) -> NDArray[np.int64]:
    """Return (teams, games) who won; every team plays the same games."""
    played = [outcome.winner for outcome in play_lots(evaluator, teams, seeds)]
    return np.concatenate(played).reshape(len(teams), len(seeds))


def _share(won: NDArray[np.bool_]) -> tuple[float, float, float]:
    return (float(won.mean()), *share_interval(int(won.sum()), len(won)))


def _best_single_skills(
    game: Game, evaluator: Evaluator, team: int, others: Sequence[LineUp], seeds: NDArray[np.uint64]
) -> tuple[dict[int, str], LineUp]:
    """Return the team of single skills that wins most: by a quarter of the games, then the best few by the rest."""
    singles = single_skills(game, team)
    first = max(1, len(seeds) // 4)
    won = (_winners(evaluator, [line_up(game, part, *others) for _, part in singles], seeds[:first]) == team).sum(
        axis=1
    )
    best = np.argsort(-won, kind="stable")[:_LAST_ROUND]
    if first < len(seeds):
        teams = [line_up(game, singles[k][1], *others) for k in best]
        won[best] += (_winners(evaluator, teams, seeds[first:]) == team).sum(axis=1)
    return singles[int(best[won[best].argmax()])]


def judge(run: Run, evaluator: Evaluator, *, games: int) -> Iterator[Judged]:
    """Judge the last champions of each team that evolves, in turn.

    Args:
        run: with at least one finished generation.
        evaluator: plays.
        games: by which each is judged; as many others choose the best team of single skills.
    """
    game, seed, generation = run.game, run.config.seed, run.finished - 1
    name = f"judged-{games}-of{generation}"
    kept = run.result(name)
    if kept is not None:
        yield from _kept(run, kept, games)
        return
    found = []
    unseen = game_seeds(seed, RunStream.UNSEEN, count=games)
    choosing = game_seeds(seed, RunStream.CHOICE, count=games)
    last, first = champions(run, generation), champions(run, 0)
    for team in last:
        others = [part for other, part in last.items() if other != team]
        names, best = _best_single_skills(game, evaluator, team, others, choosing)
        teams = [line_up(game, part, *others) for part in (last[team], first[team], best)]
        won = _winners(evaluator, teams, unseen) == team
        above = [paired_difference(won[0], other) for other in won[1:]]
        robots = tuple(run.evolving[role] for role in last[team])
        skills = {game.roles[role].name: name for role, name in names.items()}
        shares = [_share(of) for of in won]
        found.append(Judged(team, robots, games, shares[0], shares[1], shares[2], skills, above[0], above[1]))
        yield found[-1]
    run.save_result(name, _as_arrays(run, found))


_SHARES = ("last", "first", "single_skills", "over_first", "over_single_skills")


def _as_arrays(run: Run, found: Sequence[Judged]) -> dict[str, NDArray[Any]]:
    """Return what was found: shares (teams, 5, 3), and each role's skill by its number (roles,), -1 for none."""
    skills = np.full(len(run.game.roles), -1)
    for one in found:
        for robot, skill in one.skills.items():
            role = run.number_of(robot)
            skills[role] = run.game.function_set(role).terminals.index(skill)
    return {"shares": np.array([[getattr(one, key) for key in _SHARES] for one in found]), "skills": skills}


def _kept(run: Run, arrays: Mapping[str, NDArray[Any]], games: int) -> Iterator[Judged]:
    game = run.game
    for team, shares in zip(evolving_teams(game), arrays["shares"].tolist(), strict=True):
        roles = [role for role in run.evolving if game.roles[role].team == team]
        robots = tuple(run.evolving[role] for role in roles)
        skills = {run.evolving[role]: game.function_set(role).terminals[arrays["skills"][role]] for role in roles}
        last, first, single, over_first, over_single = (tuple(share) for share in shares)
        yield Judged(team, robots, games, last, first, single, skills, over_first, over_single)
