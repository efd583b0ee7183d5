"""The last champions, chosen once more: by more games than evolution had for each, and all from the same starts.

The best of a generation is the luckiest of its population, too. So a few of the best play again, against the same
opponents from the same starts, and the best of these games is the champion. It was chosen by them: games that neither
evolution nor this choice has seen (``coevo.contest.judge``) say how good it is.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.evolution.evaluation import Evaluator, Match
from coevo.fitness import Scorer
from coevo.game import Played
from coevo.run import Run
from coevo.seeds import RunStream, game_seeds
from coevo.tree import Program, compile_program

__all__ = ["judge_again"]

_CANDIDATES = 25  # teams, about
_OPPONENTS = 4  # teams of each other side
_FIRST_SHARE = 4  # a quarter of the games for all, the rest for the best quarter of them


class _Tree(NamedTuple):
    """An individual: generation and index, its fitness there, and its program."""

    generation: int
    place: int
    fitness: float
    program: Program


_Team = Mapping[int, _Tree]  # by role


@dataclass(frozen=True)
class _Score:
    """What a team did. fitness: by role, a sum over blocks. games, won, lost: counted."""

    fitness: Mapping[int, float]
    games: int
    won: int
    lost: int

    def __add__(self, other: _Score) -> _Score:
        fitness = {role: value + other.fitness[role] for role, value in self.fitness.items()}
        return _Score(fitness, self.games + other.games, self.won + other.won, self.lost + other.lost)

    @property
    def total(self) -> float:
        """Mean fitness a block, summed over the roles."""
        return sum(self.fitness.values()) / self.games


def judge_again(run: Run, evaluator: Evaluator, tell: Callable[[str], None]) -> None:
    """Choose the last champions of each team that evolves by ``evaluation.champion_games`` games, and save them.

    Candidates are teams of the best different trees of each role: of the last generation, or in random search of all,
    as those of one generation are no better than those of another. All play a quarter of the games, and the best
    quarter of them the rest; opponents are a few of the best teams of the other sides. A team's worth is the fitness
    of its roles together, in the mean over as many games as evolution had for each.

    Args:
        run: with all generations finished.
        evaluator: plays.
        tell: receives a line before.
    """
    game, settings = run.game, run.config
    games, block = settings.evaluation.champion_games, settings.evaluation.games
    tell(f"Choosing the last champions once more, by {games} games ...")
    scorer = Scorer(settings, game.counts, run.folders)
    teams = sorted({game.roles[role].team for role in run.evolving})
    roles = {team: [role for role in run.evolving if game.roles[role].team == team] for team in teams}
    ranked = {role: _ranked(run, role, scorer) for role in run.evolving}
    blocks = games // block
    first = max(1, blocks // _FIRST_SHARE)
    rows = {}
    for team in teams:
        others = [_in_step(roles[other], ranked) for other in teams if other != team]
        plan = _Plan(run, scorer, team, others)
        candidates = _candidates(roles[team], ranked)
        scores = plan.play(evaluator, candidates, range(first))
        if first < blocks:
            best = sorted(range(len(candidates)), key=lambda k: scores[k].total)[: -(-len(candidates) // _FIRST_SHARE)]
            more = plan.play(evaluator, [candidates[k] for k in best], range(first, blocks))
            found = {k: scores[k] + score for k, score in zip(best, more, strict=True)}
        else:
            found = dict(enumerate(scores))
        chosen = min(sorted(found), key=lambda k: found[k].total)
        score = found[chosen]
        for role, tree in candidates[chosen].items():
            again = score.fitness[role] / blocks
            about = (team, run.evolving[role], tree.generation, tree.place, tree.fitness, again)
            rows[role] = (*about, score.games, score.won, score.lost)
    run.save_champions([rows[role] for role in run.evolving])


def _ranked(run: Run, role: int, scorer: Scorer) -> list[_Tree]:
    """Return the best different trees of a role, as many as are needed, by the fitness of the last generation."""
    last = run.config.gp.generations - 1
    # By tree: rank, fitness as evolved, codes.
    found: dict[bytes, tuple[tuple[float, int, int, int], float, NDArray[np.uint8]]] = {}
    for generation in range(0 if run.config.gp.variation == "random" else last, last + 1):
        record = next(one for one in run.records(generation) if one.role == role)
        fitness = scorer(record.counts, last)
        for index, codes in enumerate(record.codes):
            key, rank = codes.tobytes(), (float(fitness[index]), int(record.depth[index]), generation, index)
            if key not in found or rank < found[key][0]:
                found[key] = rank, float(record.fitness[index]), codes
    functions = run.game.function_set(role)
    return [
        _Tree(rank[2], rank[3], evolved, compile_program(codes, functions))
        for rank, evolved, codes in sorted(found.values(), key=lambda one: one[0])[:_CANDIDATES]
    ]


def _candidates(roles: Sequence[int], ranked: Mapping[int, Sequence[_Tree]]) -> list[_Team]:
    """Return about 25 teams, those of the best trees first."""
    each = max(2, round(_CANDIDATES ** (1.0 / len(roles))))
    places = itertools.product(*(range(min(each, len(ranked[role]))) for role in roles))
    return [
        {role: ranked[role][place] for role, place in zip(roles, where, strict=True)}
        for where in sorted(places, key=lambda where: (sum(where), where))
    ]


def _in_step(roles: Sequence[int], ranked: Mapping[int, Sequence[_Tree]]) -> list[_Team]:
    """Return a few teams of a side: that of the best trees, that of the second best, and so on."""
    size = min(_OPPONENTS, *(len(ranked[role]) for role in roles))
    return [{role: ranked[role][place] for role in roles} for place in range(size)]


@dataclass(frozen=True)
class _Plan:
    """By which games the teams of a side are compared. others: for each other side its teams."""

    run: Run
    scorer: Scorer
    team: int
    others: Sequence[Sequence[_Team]]

    def play(self, evaluator: Evaluator, candidates: Sequence[_Team], blocks: range) -> list[_Score]:
        """Return what each team does in some blocks of games, which are the same for all."""
        evaluation = self.run.config.evaluation
        first, games = blocks.start * evaluation.games, len(blocks) * evaluation.games
        seeds = game_seeds(self.run.config.seed, RunStream.CHAMPIONS, self.team, count=games, first=first)
        # Opponents take turns, so that each block has a few of all.
        turn = (first + np.arange(games)) % (_OPPONENTS if self.others else 1)
        lots = [np.flatnonzero(turn == number) for number in np.unique(turn)]
        outcomes = evaluator.play(
            Match(self._line_up(candidate, int(turn[lot[0]])), seeds[lot]) for candidate in candidates for lot in lots
        )
        back = np.argsort(np.concatenate(lots))
        return [self._score(candidate, [next(outcomes) for _ in lots], back) for candidate in candidates]

    def _line_up(self, candidate: _Team, turn: int) -> list[Program | None]:
        programs: list[Program | None] = [None] * len(self.run.game.roles)
        for part in (candidate, *(teams[turn % len(teams)] for teams in self.others)):
            for role, tree in part.items():
                programs[role] = tree.program
        return programs

    def _score(self, candidate: _Team, played: Sequence[Played], back: NDArray[np.int64]) -> _Score:
        """Return what a team did; ``back``: (games,) puts what was played by lots into the order of the games."""
        block, last = self.run.config.evaluation.games, self.run.config.gp.generations - 1
        counts = {name: np.concatenate([one.counts[name] for one in played])[back] for name in self.run.game.counts}
        fitness = {}
        for role in candidate:
            blocks = {name: values[:, role].reshape(-1, block).sum(axis=1) for name, values in counts.items()}
            fitness[role] = float(self.scorer(blocks, last).sum())
        winner = np.concatenate([one.winner for one in played])
        won, lost = int((winner == self.team).sum()), int(((winner >= 0) & (winner != self.team)).sum())
        return _Score(fitness, len(winner), won, lost)
