"""Alternating best answers: one side answers the other, which answers it, and so on: do they move, cycle or stop?"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from analysis.baselines.search import Answer, Measured, Team, best_answer, gain, measure, team_line_up
from analysis.baselines.trees import behaviour
from coevo.contest import LineUp, evolving_teams, single_skills
from coevo.evolution.evaluation import Evaluator
from coevo.game import Game
from coevo.tree import Tree

__all__ = ["Round", "best_answers", "last_met", "moves", "single_skill_teams"]


@dataclass(frozen=True)
class Round:
    """One answer.

    Attributes:
        number: from 1.
        team: who answers.
        roles: the roles that do.
        answer: what the search came to.
        previous: the trees of these roles before.
        met: the trees of all other roles that evolve.
        standing: the trees of all roles that evolve, after it.
        before, after: fresh games against the same opponents: as it was before, and by the answer.
        gain: by how much the answer is worth more, with its interval.
        moved: whether that interval is above 0; only then the answer takes the place of what was there.
        again: number of the earlier round after which all trees did the same; None if there is none.
    """

    number: int
    team: int
    roles: tuple[int, ...]
    answer: Answer
    previous: Team
    met: Team
    standing: Team
    before: Measured
    after: Measured
    gain: tuple[float, float, float]
    moved: bool
    again: int | None


def moves(rounds: Sequence[Round]) -> int:
    """Return in how many rounds the answer was better than what was there, as their intervals say."""
    return sum(one.moved for one in rounds)


def single_skill_teams(
    game: Game, evaluator: Evaluator, *, games: int, seed: int, lost_weight: float = 0.0
) -> dict[int, Team]:
    """Return for each team that evolves the team of single skills that does best against all those of the others.

    Args:
        game, evaluator: what is played, and who plays.
        games: of each team against each, about; at least one.
        seed: of these games.
        lost_weight: as of ``best_answer``.
    """
    teams = {
        team: [{role: Tree((name,)) for role, name in names.items()} for names, _ in single_skills(game, team)]
        for team in evolving_teams(game)
    }
    found: dict[int, Team] = {}
    for team, candidates in teams.items():
        others = _product(game, [teams[other] for other in teams if other != team])
        parts = [team_line_up(game, one) for one in candidates]
        played = measure(game, evaluator, team, parts, others, games=games * len(others), seed=seed, number=1000 + team)
        worths = [one.worth(lost_weight) for one in played]
        found[team] = candidates[max(range(len(worths)), key=worths.__getitem__)]
    return found


def _product(game: Game, teams: Sequence[Sequence[Team]]) -> list[LineUp]:
    """Return all ways to take one of each."""
    found: list[dict[int, Tree]] = [{}]
    for choices in teams:
        found = [{**part, **choice} for part in found for choice in choices]
    return [team_line_up(game, one) for one in found]


def best_answers(
    game: Game,
    evaluator: Evaluator,
    rounds: int,
    *,
    games: int,
    seed: int,
    fresh: int = 1000,
    begin: Mapping[int, Team] | None = None,
    candidates: Mapping[int, Sequence[Tree]] | None = None,
    depth: int = 1,
    restarts: int = 3,
    sweeps: int = 2,
    lost_weight: float = 0.0,
    memory: int = 1,
    report: Callable[[Round], None] | None = None,
) -> list[Round]:
    """Let the teams answer each other in turn; where only one evolves, its robots answer one another.

    Args:
        game, evaluator: what is played, and who plays.
        rounds: how many answers; fewer if all sides in turn could not do better.
        games: of each search, about.
        seed: of all games.
        fresh: games that measure an answer.
        begin: for each team the trees of its roles; by default the teams of single skills that do best against those of
            the others.
        candidates, depth, restarts, sweeps, lost_weight: as of ``best_answer``.
        memory: to how many last standings of the others an answer is searched for; it is measured against the last.
        report: called after each round.
    """
    teams = evolving_teams(game)
    sides = [
        (team, tuple(k for k, role in enumerate(game.roles) if role.evolves and role.team == team)) for team in teams
    ]
    if len(sides) == 1:
        sides = [(team, (role,)) for team, roles in sides for role in roles]
    begin = begin or single_skill_teams(game, evaluator, games=20, seed=seed, lost_weight=lost_weight)
    standing: dict[int, Tree] = {role: tree for team in teams for role, tree in begin[team].items()}
    history: list[dict[int, Tree]] = [dict(standing)]
    found: list[Round] = []
    still = 0
    for number in range(1, rounds + 1):
        team, roles = sides[(number - 1) % len(sides)]
        met = [team_line_up(game, one) for one in last_met(history, roles)[:memory]]
        own = {role: standing[role] for role in roles}
        others = {role: tree for role, tree in standing.items() if role not in roles}
        answer = best_answer(
            game,
            evaluator,
            team,
            met,
            candidates,
            games=games,
            seed=seed,
            number=number,
            roles=roles,
            depth=depth,
            restarts=restarts,
            sweeps=sweeps,
            lost_weight=lost_weight,
            starts=[own],
        )
        parts = [team_line_up(game, own), answer.line_up(game)]
        before, after = measure(game, evaluator, team, parts, met[:1], games=fresh, seed=seed, number=number)
        by = gain(after, before, lost_weight)
        moved = by[1] > 0.0
        if moved:
            standing |= answer.trees
        does = _behaviours(game, standing)
        again = next((k for k, old in enumerate(history) if moved and _behaviours(game, old) == does), None)
        history.append(dict(standing))
        found.append(Round(number, team, roles, answer, own, others, dict(standing), before, after, by, moved, again))
        if report is not None:
            report(found[-1])
        still = 0 if moved else still + 1
        if still >= len(sides):
            break
    return found


def last_met(history: Sequence[Team], roles: Sequence[int]) -> list[Team]:
    """Return what the other roles of standings were, each once, the last first; nothing where there are no others.

    Args:
        history: the trees of all roles that evolve, the last at the end.
        roles: those that are left out.
    """
    met: list[Team] = []
    for old in reversed(history):
        others = {role: tree for role, tree in old.items() if role not in roles}
        if others and others not in met:
            met.append(others)
    return met


def _behaviours(game: Game, team: Team) -> tuple[object, ...]:
    return tuple(behaviour(tree, game.function_set(role)) for role, tree in sorted(team.items()))
