"""What a preset is measured by: teams that searches among small trees found, as plain data that can be kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from analysis.baselines import (
    Round,
    Team,
    best_answer,
    best_answers,
    best_single_skills,
    in_text,
    last_met,
    team_line_up,
)
from coevo.contest import LineUp, evolving_teams
from coevo.evolution.evaluation import Evaluator
from coevo.game import Game
from coevo.tree import parse

__all__ = ["Budget", "members", "search_preset", "team_of"]

_MET = 2  # last different standings of the others that a side meets
_SINGLE, _SMALL, _PASSING, _SILENT = range(1000, 1004)  # numbers of searches; those of rounds are smaller
_CHOOSING = 0.1  # of the games of a search choose among single skills


@dataclass(frozen=True)
class Budget:
    """How hard teams are searched for.

    Attributes:
        search_games: of each search, about.
        fresh_games: that say whether an answer is better.
        rounds: of best answers, at most.
        depth: of the deepest tree.
        lost_weight: what a lost game takes away.
        passing: the terminals that pass.
        seed: of all games.
    """

    search_games: int
    fresh_games: int
    rounds: int = 8
    depth: int = 1
    lost_weight: float = 0.0
    passing: tuple[str, ...] = ("pass",)
    seed: int = 0


def members(game: Game, team: int) -> tuple[int, ...]:
    """Return the roles of a team that evolve."""
    return tuple(k for k, role in enumerate(game.roles) if role.evolves and role.team == team)


def team_of(game: Game, texts: Mapping[str, str]) -> Team:
    """Return the trees of texts by the names of their roles.

    Raises:
        InputError: a tree asks or chooses what its role does not know.
    """
    roles = {role.name: number for number, role in enumerate(game.roles)}
    return {roles[name]: parse(text, game.function_set(roles[name])) for name, text in texts.items()}


def search_preset(
    game: Game, evaluator: Evaluator, budget: Budget, tell: Callable[[str], None] = lambda _: None
) -> dict[str, Any]:
    """Return the teams by which the properties of a preset can be measured.

    Args:
        game, evaluator: what is played, and who plays.
        budget: how hard is searched.
        tell: receives a line about what was found.

    Returns:
        ``rounds``: of alternating best answers, each with ``team``, and the trees by the names of their roles:
        ``before``, ``after``, and those that they ``met``. ``sides``: for each team ``team``, ``met`` (the last
        different standings of the others, of which each has another side), and the best teams against these: of
        ``single`` skills, of ``small`` trees, and where several robots can pass, ``passing``, in which somebody does,
        and ``silent``, in which nobody does.
    """

    def report(of: Round) -> None:
        verb = "does better" if of.moved else "does not do better"
        tell(f"round {of.number}: {in_text(game, of.answer.trees)} {verb}: {of.after.share[0]:.3f}, {of.gain[0]:+.3f}")

    rounds = best_answers(
        game,
        evaluator,
        budget.rounds,
        games=budget.search_games,
        fresh=budget.fresh_games,
        seed=budget.seed,
        depth=budget.depth,
        lost_weight=budget.lost_weight,
        report=report,
    )
    sides = []
    for team in evolving_teams(game):
        side = _Side(game, evaluator, budget, team, rounds)
        sides.append(side.found())
        tell(f"team {team}: {sides[-1]}")
    return {"rounds": [_plain(game, one) for one in rounds], "sides": sides}


def _plain(game: Game, one: Round) -> dict[str, Any]:
    answered = {role: one.answer.trees[role] for role in one.roles}
    return {
        "team": one.team,
        "before": in_text(game, one.previous),
        "after": in_text(game, answered),
        "met": in_text(game, one.met),
    }


class _Side:
    """The searches of one team against the last standings of the others."""

    def __init__(self, game: Game, evaluator: Evaluator, budget: Budget, team: int, rounds: Sequence[Round]) -> None:
        self._game, self._budget, self._team = game, budget, team
        self._own = members(game, team)
        self._met = last_met([one.standing for one in rounds], self._own)[:_MET]
        others: list[LineUp] = [team_line_up(game, one) for one in self._met]
        self._arguments = (game, evaluator, team, others)
        self._begin = [{role: rounds[-1].standing[role] for role in self._own}]

    def found(self) -> dict[str, Any]:
        """Return what the searches came to."""
        game, budget = self._game, self._budget
        single = best_single_skills(
            *self._arguments,
            games=round(_CHOOSING * budget.search_games),
            seed=budget.seed,
            number=_SINGLE,
            lost_weight=budget.lost_weight,
        )
        side: dict[str, Any] = {"team": self._team, "met": [in_text(game, one) for one in self._met]}
        side |= {"single": in_text(game, single.trees), "small": self._search(_SMALL, None)}
        terminals = [game.function_set(role).terminals for role in self._own]
        if len(self._own) > 1 and any(_any_of(budget.passing, names) for names in terminals):
            side["passing"] = self._search(_PASSING, self._passes)
            side["silent"] = self._search(_SILENT, lambda team: not self._passes(team))
        return side

    def _passes(self, team: Team) -> bool:
        return any(_any_of(self._budget.passing, tree.names) for tree in team.values())

    def _search(self, number: int, keep: Callable[[Team], bool] | None) -> dict[str, str]:
        budget = self._budget
        answer = best_answer(
            *self._arguments,
            games=budget.search_games,
            seed=budget.seed,
            number=number,
            depth=budget.depth,
            lost_weight=budget.lost_weight,
            starts=self._begin,
            keep=keep,
        )
        return in_text(self._game, answer.trees)


def _any_of(names: Iterable[str], of: Iterable[str]) -> bool:
    return not set(names).isdisjoint(of)
