"""Every generation of a run against every other: the games, kept in the run folder.

Of each team one generation's champions meet the other side's champions of each generation (CIAO plots: D. Cliff and
G. F. Miller, "Tracking the Red Queen", ECAL 1995; their mean over all opponents is the master tournament of S. Nolfi
and D. Floreano, "Coevolving predator and prey robots", Artificial Life 4, 1998). Instead of the champions whole
generations can play, by members drawn at random (A. Bader-Natal and J. B. Pollack, "A population-differential approach
to monitoring failure in coevolution", AAAI 2004).

Each champion plays from the same starts in all: with n generations that take part, the pair of the i-th and the j-th
plays from block (i + j) modulo n. A team that plays alone has block j in column j.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coevo.contest import LineUp, champions, evolving_teams, line_up
from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator, Match
from coevo.game import Played
from coevo.run import Run
from coevo.seeds import RunStream, game_seeds, generator
from coevo.tree import compile_program

__all__ = [
    "INDIVIDUALS",
    "Tournament",
    "chosen_generations",
    "kept_name",
    "largest_tournament",
    "play_tournament",
    "stored_tournaments",
]

INDIVIDUALS = ("best", "all")
_SAVE_SECONDS = 2.0
_ENOUGH_GAMES = 5  # of a pair, to be shown as what came of a run


@dataclass(frozen=True)
class Tournament:
    """Games between the generations of a run.

    Attributes:
        teams: numbers of the teams that evolve.
        robots: for each of them the names of its roles that evolve.
        generations: which took part.
        games: of each pair.
        individuals: "best" or "all", who plays for a generation.
        wins: (matrices, n, n, teams) int64, games that each team won; -1 where they are not played yet. With one team
            the columns are sets of starts. With two the rows are generations of the first team and the
            columns those of the second. With more, matrix k has rows of team k, and columns of all others together.
        foreign: (matrices, n, n) int64, games that a team won of which no role evolves.
        totals: (matrices, n, n, roles, counts) int64, what was counted, summed over the games of a pair.
    """

    teams: tuple[int, ...]
    robots: tuple[tuple[str, ...], ...]
    generations: tuple[int, ...]
    games: int
    individuals: str
    wins: NDArray[np.int64]
    foreign: NDArray[np.int64]
    totals: NDArray[np.int64]

    @property
    def is_finished(self) -> bool:
        """Whether all games are played."""
        return bool((self.wins >= 0).all())

    def share(self, side: int) -> NDArray[np.float64]:
        """Return (n, n) share of games won; rows are the champions of side ``side``, columns the other side's.

        Args:
            side: index among ``teams``.
        """
        return self._of(side, side).astype(np.float64) / self.games

    def lost(self, side: int) -> NDArray[np.float64]:
        """Return (n, n) share of games that any other side won."""
        others = [self._of(side, other) for other in range(len(self.teams)) if other != side]
        total: NDArray[np.float64] = np.sum([self._seen_from(side, self.foreign), *others], axis=0) / self.games
        return total

    def _of(self, side: int, winner: int) -> NDArray[np.int64]:
        return self._seen_from(side, self.wins[..., winner])

    def _seen_from(self, side: int, counts: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return (n, n) of (matrices, n, n), a row a generation of the side."""
        found: NDArray[np.int64] = counts[side if len(self.teams) > 2 else 0]
        return found.T if len(self.teams) == 2 and side == 1 else found


def chosen_generations(finished: int, every: int) -> tuple[int, ...]:
    """Return every ``every``-th of the finished generations, and the last.

    Raises:
        InputError: none is finished.

    Example:
        >>> from analysis.tournament import chosen_generations
        >>> chosen_generations(8, 3)
        (0, 3, 6, 7)
    """
    if finished < 1:
        raise InputError("the run has no finished generation; go on with 'coevo resume' first")
    return tuple(sorted({*range(0, finished, every), finished - 1}))


def kept_name(what: str, times: int, generations: Sequence[int]) -> str:
    """Return the name under which something about some generations is kept."""
    step = generations[1] - generations[0] if len(generations) > 1 else 1
    return f"{what}-{times}x{len(generations)}-every{step}-to{generations[-1]}"


def _members(run: Run, generation: int, games: int) -> list[dict[int, LineUp]]:
    """Return for each game whom each team sends: members of a generation drawn at random."""
    game = run.game
    found: list[dict[int, dict[int, Any]]] = [{team: {} for team in evolving_teams(game)} for _ in range(games)]
    for record in run.records(generation):
        functions = game.function_set(record.role)
        drawn = generator(run.config.seed, RunStream.MEMBERS, record.role, generation).integers(
            len(record.codes), size=games
        )
        for at, k in enumerate(drawn.tolist()):
            found[at][game.roles[record.role].team][record.role] = compile_program(record.codes[k], functions)
    return [dict(one) for one in found]


@dataclass(frozen=True)
class _Plan:
    """What is to be played."""

    run: Run
    generations: tuple[int, ...]
    games: int
    entrants: list[list[dict[int, LineUp]]]  # by generation: one line-up, or one a game

    def matches(self, team: int, i: int, j: int) -> list[Match]:
        """Return the matches of generation i of a team against generation j of all others."""
        config, game = self.run.config, self.run.game
        alone = len(evolving_teams(game)) == 1
        block = j if alone else (i + j) % len(self.generations)
        seeds = game_seeds(config.seed, RunStream.TOURNAMENT, block, count=self.games)
        pairs = list(zip(self.entrants[i], self.entrants[j], strict=True))
        lots = np.split(seeds, len(pairs))
        return [
            Match(line_up(game, own[team], *(part for other, part in met.items() if other != team)), lot)
            for (own, met), lot in zip(pairs, lots, strict=True)
        ]


def _empty(run: Run, generations: tuple[int, ...], games: int, individuals: str) -> Tournament:
    game, n = run.game, len(generations)
    teams = evolving_teams(game)
    robots = tuple(tuple(role.name for role in game.roles if role.evolves and role.team == team) for team in teams)
    shape = (len(teams) if len(teams) > 2 else 1, n, n)
    totals = np.zeros((*shape, len(game.roles), len(game.counts)), np.int64)
    wins, foreign = np.full((*shape, len(teams)), -1), np.zeros(shape, np.int64)
    return Tournament(teams, robots, generations, games, individuals, wins, foreign, totals)


def _enter(tournament: Tournament, run: Run, at: tuple[int, int, int], played: Sequence[Played]) -> None:
    winner = np.concatenate([one.winner for one in played])
    tournament.totals[at] = np.array(
        [np.sum([one.counts[name].sum(axis=0) for one in played], axis=0) for name in run.game.counts]
    ).T
    tournament.foreign[at] = ((winner >= 0) & ~np.isin(winner, tournament.teams)).sum()
    # Last: what is stopped in between is not taken for played.
    tournament.wins[at] = [(winner == team).sum() for team in tournament.teams]


def play_tournament(
    run: Run,
    evaluator: Evaluator,
    *,
    generations: Sequence[int],
    games: int,
    individuals: str = "best",
    report: Callable[[int, int], None] | None = None,
) -> Tournament:
    """Play a tournament, or go on with one that was stopped, and keep it in the run folder.

    Args:
        run: with these generations finished.
        evaluator: plays.
        generations: which take part, ascending.
        games: of each pair.
        individuals: "best", the champions play; "all", members of the generations drawn at random, others in each game.
        report: called after each row with the number of pairs that are played, and of all.
    """
    chosen = tuple(generations)
    name = kept_name(f"tournament-{individuals}", games, chosen)
    tournament = _read(run, name, chosen, games, individuals) or _empty(run, chosen, games, individuals)
    if tournament.is_finished:
        return tournament
    of_generation = (
        [[champions(run, g)] for g in chosen] if individuals == "best" else [_members(run, g, games) for g in chosen]
    )
    plan = _Plan(run, chosen, games, of_generation)
    saved = time.monotonic()
    matrices, n = tournament.wins.shape[:2]
    try:
        for matrix in range(matrices):
            for i in range(n):
                missing = [j for j in range(n) if tournament.wins[matrix, i, j, 0] < 0]
                rows = [plan.matches(tournament.teams[matrix], i, j) for j in missing]
                outcomes = evaluator.play([match for row in rows for match in row])
                found = [[next(outcomes) for _ in row] for row in rows]
                for j, played in zip(missing, found, strict=True):
                    _enter(tournament, run, (matrix, i, j), played)
                if time.monotonic() - saved > _SAVE_SECONDS:
                    _save(run, name, tournament)
                    saved = time.monotonic()
                if report is not None:
                    report((matrix * n + i + 1) * n, matrices * n * n)
    finally:
        _save(run, name, tournament)
    return tournament


def _save(run: Run, name: str, tournament: Tournament) -> None:
    told = {"generations": np.array(tournament.generations), "games": np.array([tournament.games])}
    parts = {"wins": tournament.wins, "foreign": tournament.foreign, "totals": tournament.totals}
    run.save_result(name, {**told, **parts})


def _read(run: Run, name: str, generations: tuple[int, ...], games: int, individuals: str) -> Tournament | None:
    arrays = run.result(name)
    if arrays is None:
        return None
    fresh = _empty(run, generations, games, individuals)
    same = tuple(arrays["generations"].tolist()) == generations and int(arrays["games"][0]) == games
    parts = [arrays.get(part) for part in ("wins", "foreign", "totals")]
    shapes = [fresh.wins.shape, fresh.foreign.shape, fresh.totals.shape]
    if not same or [None if part is None else part.shape for part in parts] != shapes:
        return None
    wins, foreign, totals = (part.copy() for part in parts if part is not None)
    return Tournament(fresh.teams, fresh.robots, generations, games, individuals, wins, foreign, totals)


def largest_tournament(run: Run) -> Tournament | None:
    """Return the tournament of champions with most generations that is kept, if it goes to the last generation."""
    kept = [one for one in stored_tournaments(run) if one.individuals == "best" and one.games >= _ENOUGH_GAMES]
    return next((one for one in kept if one.generations[-1] == run.finished - 1), None)


def stored_tournaments(run: Run) -> list[Tournament]:
    """Return the finished tournaments of a run folder, the one with most generations and games first."""
    found = []
    for name in run.results:
        kind, _, rest = name.partition("-")
        individuals = rest.partition("-")[0]
        if kind == "tournament" and individuals in INDIVIDUALS:
            arrays = run.result(name)
            assert arrays is not None
            generations, games = tuple(arrays["generations"].tolist()), int(arrays["games"][0])
            one = _read(run, name, generations, games, individuals)
            if one is not None and one.is_finished:
                found.append(one)
    return sorted(found, key=lambda one: (one.individuals != "best", -len(one.generations), -one.games))
