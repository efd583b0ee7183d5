"""The best answer to given opponents: a search among small trees, by games from common starts.

Many candidates meet the opponents a few times, the better quarter of them goes on to more games, and so on (successive
halving: K. Jamieson and A. Talwalkar, "Non-stochastic best arm identification and hyperparameter optimization",
AISTATS 2016). A team of several robots is found robot by robot, each time the best tree beside those of its mates, from
several teams of single skills, as two robots may have to change together.

What was chosen by games looks better in them than it is. ``measure`` plays fresh ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.baselines.trees import behaviour, neighbours, small_trees
from coevo.contest import LineUp, line_up, single_skills
from coevo.evolution.evaluation import Evaluator, Match
from coevo.game import Game, Played
from coevo.seeds import RunStream, game_seeds
from coevo.statistics import mean_interval, paired_difference, share_interval
from coevo.tree import Program, Tree, compile_program, tree_codes

__all__ = [
    "Answer",
    "Measured",
    "Team",
    "best_answer",
    "best_of",
    "best_single_skills",
    "gain",
    "in_text",
    "measure",
    "team_line_up",
]

Team = Mapping[int, Tree]
"""The trees of some roles, by the role's number."""

_QUARTER = 4  # of the candidates one goes on
_LOT = 50  # games of one task of a worker
_FOR_SINGLES = 0.1  # of the games choose among teams of single skills
_FOR_LAST = 0.1  # choose among what was found from different beginnings


def team_line_up(game: Game, team: Team) -> LineUp:
    """Return the programs of a team.

    Raises:
        InputError: a tree asks or chooses what its role does not know.
    """
    return {role: _program(game, role, tree) for role, tree in team.items()}


def _program(game: Game, role: int, tree: Tree) -> Program:
    functions = game.function_set(role)
    return compile_program(tree_codes(tree, functions), functions)


def in_text(game: Game, team: Team) -> dict[str, str]:
    """Return the text of each tree by the name of its role."""
    return {game.roles[role].name: str(tree) for role, tree in sorted(team.items())}


@dataclass(frozen=True)
class Answer:
    """What a search came to.

    Attributes:
        team: the team's number.
        trees: of the roles that were searched for.
        worth: share of games won, less the share lost times its weight, in the games that it was chosen by: too good.
        games: how many the search played.
    """

    team: int
    trees: Team
    worth: float
    games: int

    def line_up(self, game: Game) -> LineUp:
        """Return its programs."""
        return team_line_up(game, self.trees)


@dataclass(frozen=True)
class Measured:
    """Games of a team that it was not chosen by.

    Attributes:
        won, lost: (games,) bool.
        passes: (games,) int64, passes of the team, 0 where the game does not count them.
        steps: (games,) int64, length of each game, 0 likewise.
    """

    won: NDArray[np.bool_]
    lost: NDArray[np.bool_]
    passes: NDArray[np.int64]
    steps: NDArray[np.int64]

    @property
    def share(self) -> tuple[float, float, float]:
        """Share of games won with its interval (share, low, high)."""
        return (float(self.won.mean()), *share_interval(int(self.won.sum()), len(self.won)))

    @property
    def lost_share(self) -> float:
        """Share of games that somebody else won."""
        return float(self.lost.mean())

    @property
    def time_out(self) -> float:
        """Share of games that nobody won."""
        return float((~self.won & ~self.lost).mean())

    def worth(self, lost_weight: float = 0.0) -> float:
        """Return the share of games won, less ``lost_weight`` times the share lost."""
        return float(self.won.mean() - lost_weight * self.lost.mean())


def gain(after: Measured, before: Measured, lost_weight: float = 0.0) -> tuple[float, float, float]:
    """Return by how much one team is worth more than another in the same games, with its interval (gain, low, high)."""
    if lost_weight == 0.0:
        return paired_difference(after.won, before.won)
    return mean_interval(_worths(after, lost_weight) - _worths(before, lost_weight))


def _worths(of: Measured, lost_weight: float) -> NDArray[np.float64]:
    worths: NDArray[np.float64] = of.won.astype(np.float64) - lost_weight * of.lost
    return worths


def play_parts(
    game: Game, evaluator: Evaluator, parts: Sequence[LineUp], others: Sequence[LineUp], seeds: NDArray[np.uint64]
) -> list[list[Played]]:
    """Let each part play from the same starts; start number i is against opponent number i modulo their number.

    Args:
        game: what is played.
        evaluator: plays.
        parts: programs of some roles.
        others: programs of all other roles that evolve, each; at least one, which is empty if there are none.
        seeds: (games,) a number that the opponents divide.

    Returns:
        for each part its games in lots, ordered by opponent and then by start, alike for all parts.
    """
    dealt = [(other, seeds[k :: len(others)]) for k, other in enumerate(others)]
    lots = [(other, lot[at : at + _LOT]) for other, lot in dealt for at in range(0, len(lot), _LOT)]
    played = evaluator.play(Match(line_up(game, part, other), lot) for part in parts for other, lot in lots)
    return [[next(played) for _ in lots] for _ in parts]


def measure(
    game: Game,
    evaluator: Evaluator,
    team: int,
    parts: Sequence[LineUp],
    others: Sequence[LineUp],
    *,
    games: int,
    seed: int,
    number: int = 0,
) -> list[Measured]:
    """Let teams play fresh games, the same for all of them.

    Args:
        game: what is played.
        evaluator: plays.
        team: of the parts.
        parts: programs of some roles, whose games are told.
        others: programs of all other roles that evolve, each; start number i is against opponent i modulo their number.
        games: of each part; raised to a multiple of the number of opponents.
        seed: of the games.
        number: another number is other games.
    """
    met = list(others) or [{}]
    seeds = game_seeds(seed, RunStream.ANSWERED, number, count=math.ceil(games / len(met)) * len(met))
    mates = [role for role, one in enumerate(game.roles) if one.team == team]
    found = []
    for lots in play_parts(game, evaluator, parts, met, seeds):
        winner = np.concatenate([one.winner for one in lots])
        none = [np.zeros((len(one.winner), len(game.roles)), np.int64) for one in lots]
        passes, steps = (
            np.concatenate([one.counts.get(name, zero) for one, zero in zip(lots, none, strict=True)])
            for name in ("passes", "steps")
        )
        won = winner == team
        found.append(Measured(won, (winner >= 0) & ~won, passes[:, mates].sum(axis=1), steps[:, 0]))
    return found


class _Search:
    """Races between teams, each from starts of its own."""

    def __init__(
        self,
        game: Game,
        evaluator: Evaluator,
        team: int,
        others: Sequence[LineUp],
        *,
        seed: int,
        number: int,
        lost_weight: float,
        keep: Callable[[Team], bool] | None,
    ) -> None:
        self.game, self._evaluator, self._team, self._others = game, evaluator, team, list(others) or [{}]
        self._key, self._weight, self._keep = (seed, RunStream.ANSWERS, number, team), lost_weight, keep
        self._programs: dict[tuple[int, Tree], Program] = {}
        self._races = 0
        self.games = 0

    def allowed(self, teams: Iterable[Team]) -> list[Team]:
        """Return the teams that may be an answer, those of one behaviour once."""
        chosen: dict[object, Team] = {}
        for team in teams:
            if self._keep is None or self._keep(team):
                does = tuple((role, behaviour(tree, self.game.function_set(role))) for role, tree in team.items())
                chosen.setdefault(does, team)
        return list(chosen.values())

    def race(self, teams: Sequence[Team], games: float) -> list[tuple[Team, float]]:
        """Return the last few teams of a race with what they were worth, best first.

        Args:
            teams: at least one; of equal ones the first wins, which stays to the end.
            games: in all, about; each team plays at least once against each opponent.
        """
        self._races += 1
        worth, count = np.zeros(len(teams)), 0
        alive = np.arange(len(teams))
        rungs = max(1, math.ceil(math.log(len(teams), _QUARTER))) if len(teams) > 1 else 1
        for rung in range(rungs):
            more = max(1, int(games / rungs / len(alive) / len(self._others))) * len(self._others)
            seeds = game_seeds(*self._key, self._races, first=count, count=more)
            worth[alive] += self._worth([teams[k] for k in alive.tolist()], seeds)
            count += more
            alive = alive[np.argsort(-worth[alive], kind="stable")]
            if rung < rungs - 1:
                alive = np.union1d(alive[: math.ceil(len(alive) / _QUARTER)], [0])
        return [(teams[k], float(worth[k]) / count) for k in alive.tolist()]

    def _worth(self, teams: Sequence[Team], seeds: NDArray[np.uint64]) -> NDArray[np.float64]:
        parts = [{role: self._compiled(role, tree) for role, tree in team.items()} for team in teams]
        played = play_parts(self.game, self._evaluator, parts, self._others, seeds)
        self.games += len(teams) * len(seeds)
        winners = np.array([np.concatenate([one.winner for one in lots]) for lots in played])
        won, lost = winners == self._team, (winners >= 0) & (winners != self._team)
        worth: NDArray[np.float64] = won.sum(axis=1) - self._weight * lost.sum(axis=1)
        return worth

    def _compiled(self, role: int, tree: Tree) -> Program:
        if (role, tree) not in self._programs:
            self._programs[role, tree] = _program(self.game, role, tree)
        return self._programs[role, tree]


def best_answer(
    game: Game,
    evaluator: Evaluator,
    team: int,
    others: Sequence[LineUp] = (),
    candidates: Mapping[int, Sequence[Tree]] | None = None,
    *,
    games: int,
    seed: int,
    number: int = 0,
    roles: Sequence[int] | None = None,
    depth: int = 1,
    restarts: int = 3,
    sweeps: int = 2,
    lost_weight: float = 0.0,
    starts: Sequence[Team] = (),
    keep: Callable[[Team], bool] | None = None,
    tell: Callable[[str], None] | None = None,
) -> Answer:
    """Return the team of small trees that does best against opponents, as far as so many games can find it.

    Args:
        game: what is played.
        evaluator: plays it.
        team: number of the team that answers.
        others: opponents, each the programs of all other roles that evolve; starts are dealt to them in turn. Nothing
            where nobody else evolves.
        candidates: for roles the trees that are tried; by default all ``small_trees`` of depth 1 at most.
        games: of the whole search, about; with very few, each candidate is still tried once against each opponent.
        seed: of the games that choose.
        number: another number is other games.
        roles: which roles of the team are searched for; by default all that evolve. The others are then in ``others``.
        depth: from 2 on, trees that are one change away from the best are tried besides, down to this depth.
        restarts: from how many teams of single skills the search begins, the best ones.
        sweeps: how often each robot in turn is given the best of its candidates; fewer if nothing changes any more.
        lost_weight: what a game that is lost takes away, where one that is won is 1.
        starts: further teams that the search begins from; they are candidates themselves.
        keep: which teams may be an answer; by default all.
        tell: receives a line after each race.

    Raises:
        ValueError: no team is left that may be an answer.
    """
    chosen = tuple(roles or (k for k, role in enumerate(game.roles) if role.evolves and role.team == team))
    options = {role: (candidates or {}).get(role) or small_trees(game.function_set(role)) for role in chosen}
    search = _Search(game, evaluator, team, others, seed=seed, number=number, lost_weight=lost_weight, keep=keep)
    singles = search.allowed(_singles(game, team, chosen))
    begun = search.allowed({role: start[role] for role in chosen} for start in starts)
    if len(chosen) == 1:  # all candidates are tried at once; deeper trees begin from the best of them
        begun += [{chosen[0]: tree} for tree in options[chosen[0]]]
        sweeps, restarts = 0, restarts if depth > 1 else 1
    pool = search.allowed([*begun, *singles])
    if not pool:
        raise ValueError("expected at least one team that may be an answer, got none")
    share = _FOR_SINGLES if len(chosen) > 1 else 1.0 / (1.0 + depth) if depth > 1 else 1.0
    raced = search.race(pool if len(chosen) == 1 else singles or pool, share * games)
    if share == 1.0:
        return Answer(team, *raced[0], search.games)
    begin = search.allowed([*(begun if len(chosen) > 1 else []), *(one for one, _ in raced[:restarts])])
    deeper = depth if depth > 1 else 0
    steps = len(begin) * len(chosen) * (sweeps + deeper)
    each = (1.0 - share - _FOR_LAST) * games / max(1, steps)
    ends = []
    for at, start in enumerate(begin):
        now = start
        for sweep in range(sweeps + deeper):
            before = now
            for role in chosen:
                near = sweep >= sweeps
                trees = neighbours(now[role], game.function_set(role), depth) if near else options[role]
                (now, worth), *_ = search.race(search.allowed([now, *({**now, role: tree} for tree in trees)]), each)
                if tell is not None:
                    tell(f"beginning {at + 1} of {len(begin)}, sweep {sweep + 1}: {worth:.3f} {in_text(game, now)}")
            if now == before and (sweep >= sweeps or not deeper):
                break
        ends.append(now)
    (best, worth), *_ = search.race(search.allowed([*ends, *begin]), max(_FOR_LAST * games, games - search.games))
    return Answer(team, best, worth, search.games)


def _singles(game: Game, team: int, roles: Sequence[int]) -> list[Team]:
    """Return the teams of single skills, as far as they differ in some roles."""
    named = [{role: Tree((names[role],)) for role in roles} for names, _ in single_skills(game, team)]
    return list({tuple(one.values()): one for one in named}.values())


def best_single_skills(
    game: Game,
    evaluator: Evaluator,
    team: int,
    others: Sequence[LineUp] = (),
    *,
    games: int,
    seed: int,
    number: int = 0,
    roles: Sequence[int] | None = None,
    lost_weight: float = 0.0,
    keep: Callable[[Team], bool] | None = None,
) -> Answer:
    """Return the team in which each robot uses one skill throughout that does best; arguments as of ``best_answer``.

    Raises:
        ValueError: no team is left that may be an answer.
    """
    chosen = tuple(roles or (k for k, role in enumerate(game.roles) if role.evolves and role.team == team))
    singles = [one for one in _singles(game, team, chosen) if keep is None or keep(one)]
    return best_of(
        game, evaluator, team, others, singles, games=games, seed=seed, number=number, lost_weight=lost_weight
    )


def best_of(
    game: Game,
    evaluator: Evaluator,
    team: int,
    others: Sequence[LineUp],
    teams: Sequence[Team],
    *,
    games: int,
    seed: int,
    number: int = 0,
    lost_weight: float = 0.0,
) -> Answer:
    """Return the best of some teams of the same roles; arguments as of ``best_answer``.

    Raises:
        ValueError: there is none.
    """
    if not teams:
        raise ValueError("expected at least one team that may be an answer, got none")
    search = _Search(game, evaluator, team, others, seed=seed, number=number, lost_weight=lost_weight, keep=None)
    return Answer(team, *search.race(teams, games)[0], search.games)
