"""Champions of a run beside its baselines: all play the same fresh games against the same opponents."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.baselines.hand_typed import HandTyped
from analysis.baselines.identity import digest, identity
from analysis.baselines.search import (
    Measured,
    Team,
    best_answer,
    best_of,
    best_single_skills,
    gain,
    in_text,
    measure,
    team_line_up,
)
from analysis.tournament import same_game
from coevo.contest import LineUp, champions, evolving_teams
from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator
from coevo.evolution.grouping import games_of_run
from coevo.run import Run
from coevo.statistics import bootstrap_interval
from coevo.tree import parse

__all__ = ["COLUMNS", "KINDS", "check_comparable", "equal_games", "over_runs", "table"]

KINDS = ("champions", "single skills", "small trees", "hand-typed", "random search", "other run")
COLUMNS = (
    *("run", "team", "robots", "kind", "name", "trees", "chosen", "games"),
    *("share", "low", "high", "lost", "time_out", "over", "over_low", "over_high"),
)
_CHOOSING = 0.1  # of the games of the search choose among single skills, and among hand-typed teams if that is more
_SINGLES, _SMALL, _HAND = 0, 1, 2  # numbers of searches: each has starts of its own


@dataclass(frozen=True)
class _Entrant:
    """Who plays: a kind of ``KINDS``, what it is called, its trees as text where they are small, and its programs."""

    kind: str
    name: str
    trees: str
    chosen: bool
    line_up: LineUp


def equal_games(run: Run, other: Run) -> bool:
    """Return whether two runs play equally many games: of evolution, with those of guests, and to choose champions."""

    def games(of: Run) -> tuple[int, int]:
        evaluation = of.config.evaluation
        of_evolution = games_of_run(of.config, of.game.roles, of.config.gp.generations)
        return of_evolution, evaluation.champion_blocks * evaluation.games

    return games(run) == games(other)


def check_comparable(run: Run, team: int | None, beside: Run | None, met: Sequence[Run] = ()) -> None:
    """Refuse what ``table`` cannot compare; arguments are its own.

    Raises:
        InputError: says what was expected.
    """
    teams = evolving_teams(run.game)
    if team is not None and team not in teams:
        raise InputError(f"expected a team that evolves ({', '.join(map(str, teams))}), got {team}")
    if met and len(teams) < 2:
        raise InputError(f"only one team evolves in {run.path}: there are no opponents of other runs for it to meet")
    for one in (run, *met) if beside is None else (run, beside, *met):
        if one.finished < 1:
            raise InputError(f"{one.path} has no finished generation yet; go on with 'coevo resume {one.path}'")
        if not same_game([run, one]):
            raise InputError(
                f"{one.path} is about another game than {run.path}, or has other skills: their champions cannot meet"
            )


def table(
    run: Run,
    evaluator: Evaluator,
    *,
    games: int = 400,
    search_games: int = 40_000,
    depth: int = 1,
    team: int | None = None,
    hand: Sequence[HandTyped] = (),
    beside: Run | None = None,
    met: Sequence[Run] = (),
    tell: Callable[[str], None] = lambda _: None,
) -> pd.DataFrame:
    """Return the last champions of a run beside its baselines; what was played is kept in the run folder.

    Where other teams evolve, the opponents are their last champions, and those of the run beside if there is one:
    starts are dealt to both in turn, so that neither is favoured. In cross-play (``met``) they are those of other runs
    instead, who did not evolve against these champions. Single skills, small trees and hand-typed teams are
    chosen against the same opponents, by other games.

    Args:
        run: with a finished generation.
        evaluator: plays its games.
        games: fresh ones, of each row.
        search_games: of the search among small trees, about.
        depth: of the deepest of them.
        team: whose champions; by default of each that evolves.
        hand: hand-typed teams; those of other teams are left out.
        beside: another run of the same game, by random search or by other settings of evolution.
        met: other runs of the same game, whose last champions are the opponents instead.
        tell: receives a line before what takes long.

    Returns:
        ``COLUMNS``, a row a team and line-up, the champions first. ``kind``: of ``KINDS``. ``trees``: as text; none of
        evolved ones. ``chosen``: whether the row stands for its kind: of the hand-typed teams the best one. ``share``,
        ``low``, ``high``: of games won; ``lost``, ``time_out``: shares of games. ``over``, ``over_low``, ``over_high``:
        by how much the champions' share is above it in the same games, none for themselves.

    Raises:
        InputError: no generation is finished, there is no such team, another run is about another game, or there are
            runs to meet and no other team that evolves.
    """
    check_comparable(run, team, beside, met)
    teams = evolving_teams(run.game)
    last = champions(run, run.finished - 1)
    other = {} if beside is None else champions(beside, beside.finished - 1)
    opponents = [champions(one, one.finished - 1) for one in met] or [of for of in (last, other) if of]
    frames = []
    for number in teams if team is None else (team,):
        others = [part for part in (_without(of, number) for of in opponents) if part]
        found = _Kept(run, evaluator, number, others, tell)
        entrants = [_Entrant("champions", "last champions", "", True, last[number])]
        entrants.append(found.single_skills(round(_CHOOSING * search_games)))
        entrants.append(found.small_trees(search_games, depth))
        mine = [one for one in hand if one.team == number]
        # They are few, and some of them near each other: as many games choose among them as measure them.
        entrants += found.hand_typed(mine, max(round(_CHOOSING * search_games), games * len(mine)))
        if beside is not None:
            kind = "random search" if beside.config.gp.variation == "random" else "other run"
            entrants.append(_Entrant(kind, beside.path.name, "", True, other[number]))
        frames.append(_rows(run, number, entrants, found.measured(entrants, games)))
    return pd.concat(frames, ignore_index=True)


def _without(of: dict[int, LineUp], team: int) -> LineUp:
    return {role: program for other, part in of.items() if other != team for role, program in part.items()}


def _rows(run: Run, team: int, entrants: Sequence[_Entrant], measured: Sequence[Measured]) -> pd.DataFrame:
    names = ", ".join(name for role, name in run.evolving.items() if run.game.roles[role].team == team)
    rows = []
    for one, of in zip(entrants, measured, strict=True):
        over = (np.nan,) * 3 if one.kind == "champions" else gain(measured[0], of)
        told = (str(run.path), team, names, one.kind, one.name, one.trees, one.chosen, len(of.won))
        rows.append((*told, *of.share, of.lost_share, of.time_out, *over))
    return pd.DataFrame(rows, columns=list(COLUMNS))


class _Kept:
    """What baselines of one team of a run came to, taken from the run folder or played and kept there."""

    def __init__(
        self, run: Run, evaluator: Evaluator, team: int, others: Sequence[LineUp], tell: Callable[[str], None]
    ) -> None:
        self._run, self._evaluator, self._team, self._others, self._tell = run, evaluator, team, others, tell
        self._met = [identity(one) for one in others]
        self._arguments = (run.game, evaluator, team, others)
        self._who = ", ".join(name for role, name in run.evolving.items() if run.game.roles[role].team == team)

    def _answer(self, what: str, key: Iterable[object], find: Callable[[], Team]) -> Team:
        """Return the trees that a search finds, or found before."""
        name = f"answer-{what}-{digest(self._team, self._met, *key)}"
        kept, game = self._run.result(name), self._run.game
        if kept is None:
            found = find()
            kept = {f"tree_{role}": np.frombuffer(str(tree).encode(), np.uint8) for role, tree in found.items()}
            self._run.save_result(name, kept)
        texts = {int(key.removeprefix("tree_")): bytes(text).decode() for key, text in kept.items()}
        return {role: parse(text, game.function_set(role)) for role, text in sorted(texts.items())}

    def _entrant(self, kind: str, name: str, team: Team, *, chosen: bool = True) -> _Entrant:
        text = "; ".join(f"{robot}: {tree}" for robot, tree in in_text(self._run.game, team).items())
        return _Entrant(kind, name, text, chosen, team_line_up(self._run.game, team))

    def single_skills(self, games: int) -> _Entrant:
        """Return the best team of single skills."""

        def find() -> Team:
            self._tell(f"{self._who}: choosing among single skills ...")
            seed = self._run.config.seed
            return best_single_skills(*self._arguments, games=games, seed=seed, number=_SINGLES).trees

        return self._entrant("single skills", "best single skills", self._answer("single", [games], find))

    def small_trees(self, games: int, depth: int) -> _Entrant:
        """Return the best team of small trees."""

        def find() -> Team:
            self._tell(f"{self._who}: searching among small trees, by about {games:,} games ...")
            seed = self._run.config.seed
            return best_answer(*self._arguments, games=games, seed=seed, number=_SMALL, depth=depth).trees

        return self._entrant("small trees", "best small trees", self._answer("small", [games, depth], find))

    def hand_typed(self, teams: Sequence[HandTyped], games: int) -> list[_Entrant]:
        """Return all hand-typed teams, the best of them marked."""
        if not teams:
            return []

        def find() -> Team:
            self._tell(f"{self._who}: choosing among hand-typed teams ...")
            seed, trees = self._run.config.seed, [one.trees for one in teams]
            return best_of(*self._arguments, trees, games=games, seed=seed, number=_HAND).trees

        texts = [in_text(self._run.game, one.trees) for one in teams]
        best = self._answer("hand", [games, texts], find)
        at = next(k for k, one in enumerate(teams) if one.trees == best)
        return [
            self._entrant("hand-typed", one.name, one.trees, chosen=number == at) for number, one in enumerate(teams)
        ]

    def measured(self, entrants: Sequence[_Entrant], games: int) -> list[Measured]:
        """Return the same fresh games of all."""
        name = f"baselines-team{self._team}-{games}-{digest(self._met)}"
        kept: dict[str, NDArray[Any]] = self._run.result(name) or {}
        digests = [digest(identity(one.line_up)) for one in entrants]
        missing = {d: one.line_up for d, one in zip(digests, entrants, strict=True) if f"won_{d}" not in kept}
        if missing:
            self._tell(f"{self._who}: {games} fresh games of each team ...")
            seed = self._run.config.seed
            found = measure(*self._arguments[:3], list(missing.values()), self._others, games=games, seed=seed)
            for key, of in zip(missing, found, strict=True):
                kept |= {f"{what}_{key}": getattr(of, what) for what in ("won", "lost", "passes", "steps")}
            self._run.save_result(name, kept)
        return [Measured(*(kept[f"{what}_{d}"] for what in ("won", "lost", "passes", "steps"))) for d in digests]


def over_runs(tables: pd.DataFrame, groups: Mapping[str, str] | None = None) -> pd.DataFrame:
    """Return the champions of several runs beside their baselines: the unit is a run, not a game.

    Args:
        tables: of ``table``, of one run or of several, one under the other.
        groups: the group of each run, by its ``run`` in the tables; by default all are one, which has no name.

    Returns:
        A row a group, side and kind of baseline: ``group``, ``robots``, ``kind``, ``runs``, ``champions`` and ``share``
        (mean shares of games won, of the champions and of the baseline), ``over``, ``low``, ``high`` (mean of the
        differences with its interval over runs), ``better`` (in how many runs the champions were ahead). Then the same
        of games lost, as some are nobody's: ``champions_lost`` and ``lost`` (mean shares), ``less``, ``less_low``,
        ``less_high`` (by how much less the champions lose), ``safer`` (in how many runs they lose less). One run alone
        has no interval: it is NaN.
    """
    rows = []
    chosen = tables[tables["chosen"]]
    evolved = chosen[chosen["kind"] == "champions"]
    ours_lost = {(row["run"], row["robots"]): float(row["lost"]) for row in evolved.to_dict("records")}
    of_group = chosen["run"].map(groups) if groups is not None else pd.Series("", index=chosen.index)
    simpler = chosen.assign(group=of_group)[chosen["kind"] != "champions"]
    for (group, robots, kind), of in simpler.groupby(["group", "robots", "kind"], sort=False):
        over, lost = of["over"].to_numpy(np.float64), of["lost"].to_numpy(np.float64)
        ours = np.array([ours_lost[run, robots] for run in of["run"]])
        shares = (float((of["share"] + of["over"]).mean()), float(of["share"].mean()))
        won = (*shares, *_interval(over), int((over > 0.0).sum()))
        rows.append((group, robots, kind, len(of), *won, *_of_lost(ours, lost)))
    columns = ["group", "robots", "kind", "runs", "champions", "share", "over", "low", "high", "better"]
    columns += ["champions_lost", "lost", "less", "less_low", "less_high", "safer"]
    return pd.DataFrame(rows, columns=columns)


def _of_lost(ours: NDArray[np.float64], lost: NDArray[np.float64]) -> tuple[float, float, float, float, float, int]:
    less = lost - ours
    return float(ours.mean()), float(lost.mean()), *_interval(less), int((less > 0.0).sum())


def _interval(of_runs: NDArray[np.float64]) -> tuple[float, float, float]:
    if len(of_runs) == 1:
        return float(of_runs[0]), np.nan, np.nan
    mean, low, high = (float(value) for value in bootstrap_interval(of_runs))
    return mean, low, high
