"""How games between the last champions end: the patterns of section 6.4.3, and when one side takes over.

The dissertation names two typical settlements of its three-robot game: r0 passes to r1, which shoots, and r2 intercepts
the ball and shoots; it gives them as about 25 % : 75 %. Here each game is classified by a rule, from what was counted
in it. The first side is the first team that evolves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.baselines.identity import digest, identity
from analysis.baselines.search import play_parts
from coevo.contest import champions, evolving_teams
from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator
from coevo.game import Game
from coevo.run import Run
from coevo.seeds import RunStream, game_seeds
from coevo.statistics import bootstrap_interval, share_interval

__all__ = [
    "PATTERNS",
    "RATIO",
    "Settled",
    "check_settled",
    "classify",
    "over_runs",
    "settle",
    "settlement_columns",
    "taken_over",
]

PATTERNS = ("pass and shoot", "alone", "interception", "unopposed", "own goal", "time-out")
"""How a game ends; the first that is true, from the last:

- time-out: nobody scored.
- own goal: a robot of the side that lost touched the ball last.
- unopposed: another side won, and the first never touched the ball.
- interception: another side won, and the first had touched the ball.
- alone: the first side won without a pass.
- pass and shoot: the first side won, and a robot of it had passed to a mate in the game.
"""
RATIO = "pass and shoot : interception"
_NEEDED = ("kicks", "passes", "own_goals")
_NUMBER = 3000  # of these fresh games


@dataclass(frozen=True)
class Settled:
    """How games between the last champions of a run ended.

    Attributes:
        run: its folder.
        first, others: names of the robots of the first side, and of all others that evolve.
        patterns: (games,) int64, places in ``PATTERNS``.
        take_over: first generation from which the best of the others had more goals than the best of the first side,
            for good; None if there is none.
    """

    run: str
    first: tuple[str, ...]
    others: tuple[str, ...]
    patterns: NDArray[np.int64]
    take_over: int | None

    def share(self, pattern: str) -> float:
        """Return the share of games that ended so."""
        return float((self.patterns == PATTERNS.index(pattern)).mean())

    def ratio(self) -> float:
        """Return the share of "pass and shoot" among these and interceptions; NaN if there are none of either."""
        passed, taken = self.share("pass and shoot"), self.share("interception")
        return passed / (passed + taken) if passed + taken else float("nan")

    @property
    def most(self) -> str:
        """The most frequent pattern of the games that were decided; "time-out" if none was."""
        counts = np.bincount(self.patterns, minlength=len(PATTERNS))[:-1]
        return PATTERNS[int(counts.argmax())] if counts.any() else PATTERNS[-1]


def classify(
    game: Game, counts: Mapping[str, NDArray[np.int64]], winner: NDArray[np.int64], first: int
) -> NDArray[np.int64]:
    """Return (games,) places in ``PATTERNS``.

    Args:
        game: whose roles they are.
        counts: for each name (games, roles): ``kicks``, ``passes`` and ``own_goals`` are looked at.
        winner: (games,) the team that won, -1 if none did.
        first: number of the first side.
    """
    ours = np.array([role.team == first for role in game.roles])
    won = winner == first
    touched, passed = (counts[name][:, ours].sum(axis=1) > 0 for name in ("kicks", "passes"))
    own = (counts["own_goals"] * (np.array([role.team for role in game.roles]) != winner[:, None])).sum(axis=1) > 0
    names = [
        (winner < 0, "time-out"),
        (own, "own goal"),
        (~won & ~touched, "unopposed"),
        (~won, "interception"),
        (~passed, "alone"),
    ]
    found = np.full(len(winner), PATTERNS.index("pass and shoot"))
    for holds, name in reversed(names):
        found[holds] = PATTERNS.index(name)
    return found


def settle(run: Run, evaluator: Evaluator, *, games: int = 400) -> Settled:
    """Let the last champions of a run play fresh games and say how they end; what was played is kept in its folder.

    Args:
        run: with a finished generation.
        evaluator: plays its games.
        games: how many.

    Raises:
        InputError: no generation is finished, or the game does not count what is needed.
    """
    check_settled(run)
    game, last = run.game, champions(run, run.finished - 1)
    first = evolving_teams(game)[0]
    parts = [last[team] for team in last]
    name = f"settlements-{games}-{digest([identity(part) for part in parts])}"
    kept = run.result(name)
    if kept is None:
        everybody = {role: program for part in parts for role, program in part.items()}
        seeds = game_seeds(run.config.seed, RunStream.ANSWERED, _NUMBER, count=games)
        (lots,) = play_parts(game, evaluator, [everybody], [{}], seeds)
        found = [classify(game, played.counts, played.winner, first) for played in lots]
        kept = {"patterns": np.concatenate(found)}
        run.save_result(name, kept)
    ours = tuple(name for role, name in run.evolving.items() if game.roles[role].team == first)
    others = tuple(name for name in run.evolving.values() if name not in ours)
    return Settled(str(run.path), ours, others, kept["patterns"], taken_over(run.generations, ours, others))


def check_settled(run: Run) -> None:
    """Refuse a run whose games cannot be classified.

    Raises:
        InputError: says what was expected.
    """
    if run.finished < 1:
        raise InputError(f"{run.path} has no finished generation yet; go on with 'coevo resume {run.path}'")
    missing = [name for name in _NEEDED if name not in run.game.counts]
    if missing:
        raise InputError(
            f"{run.path}: patterns are told by {', '.join(_NEEDED)}, but this game counts {', '.join(run.game.counts)}"
        )


def taken_over(generations: pd.DataFrame, first: Sequence[str], others: Sequence[str]) -> int | None:
    """Return the first generation from which the best of the others had more goals than the best of the first side.

    Args:
        generations: of a run (``Run.generations``); ``goals`` are those of each robot's best individual.
        first, others: names of the robots of the two sides.

    Returns:
        the generation from which this holds in all that follow; None if not in the last, or if nobody else evolves.

    Example:
        >>> import pandas as pd
        >>> from analysis.settlements import taken_over
        >>> goals = {"r0": [5, 2, 6, 1, 0], "r1": [4, 4, 3, 2, 1], "r2": [3, 6, 5, 7, 8]}
        >>> rows = [(g, robot, of[g]) for g in range(5) for robot, of in goals.items()]
        >>> taken_over(pd.DataFrame(rows, columns=["generation", "robot", "goals"]), ["r0", "r1"], ["r2"])
        3
    """
    if not others or generations.empty:
        return None
    goals = generations.pivot_table(index="generation", columns="robot", values="goals")
    ahead = (goals[list(others)].max(axis=1) > goals[list(first)].max(axis=1)).to_numpy()
    behind = np.flatnonzero(~ahead)
    at = int(behind[-1]) + 1 if len(behind) else 0
    return int(goals.index[at]) if at < len(ahead) else None


def settlement_columns(settled: Settled) -> dict[str, float]:
    """Return what a table with a row a run tells of it: shares by pattern, the ratio of 6.4.3, and the take-over.

    ``take_over`` is NaN where nobody took over.
    """
    shares = {f"settled_{name.replace(' ', '_').replace('-', '_')}": settled.share(name) for name in PATTERNS}
    late = float("nan") if settled.take_over is None else float(settled.take_over)
    return {**shares, "settled_ratio": settled.ratio(), "take_over": late}


def over_runs(settled: Sequence[Settled]) -> pd.DataFrame:
    """Return what runs of one kind settled in; the unit is a run.

    Args:
        settled: of each run, at least one.

    Returns:
        A row a pattern, and one (``RATIO``) for the ratio of 6.4.3: ``pattern``, ``runs`` (in
        which it can be said), ``share``, ``low``, ``high`` (mean share of games with its interval over runs), ``most``
        (number of runs in which it is the most frequent of the decided), ``most_low``, ``most_high`` (the interval of
        their share; of the ratio: among runs of which most games end by either).
    """
    rows: list[tuple[object, ...]] = []
    most = [one.most for one in settled]
    for name in PATTERNS:
        count = most.count(name)
        shares = _over_runs([one.share(name) for one in settled])
        rows.append((name, len(settled), *shares, count, *share_interval(count, len(settled))))
    ratios = [one.ratio() for one in settled if np.isfinite(one.ratio())]
    passed, taken = most.count("pass and shoot"), most.count("interception")
    interval = share_interval(passed, passed + taken) if passed + taken else (np.nan, np.nan)
    rows.append((RATIO, len(ratios), *_over_runs(ratios), passed, *interval))
    return pd.DataFrame(rows, columns=["pattern", "runs", "share", "low", "high", "most", "most_low", "most_high"])


def _over_runs(shares: Sequence[float]) -> list[float]:
    """Return the mean of shares and its interval, cut at 0 and 1; NaN if there are none."""
    if not shares:
        return [float("nan")] * 3
    return [float(value) for value in np.clip(bootstrap_interval(shares), 0.0, 1.0)]
