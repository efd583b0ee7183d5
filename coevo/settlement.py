"""How games between the last champions end: the patterns of section 6.4.3, and when one side takes over.

The dissertation names two typical settlements of its three-robot game: r0 passes to r1, which shoots, and r2 intercepts
the ball and shoots; it gives them as about 25 % : 75 %. Here each game is classified by a rule, from what was counted
in it. The first side is the first team that evolves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coevo.contest import champions, evolving_teams, line_up, play_lots
from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator
from coevo.game import Game
from coevo.run import Run
from coevo.seeds import RunStream, game_seeds

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "PATTERNS",
    "Settled",
    "can_settle",
    "check_settled",
    "classify",
    "settle",
    "settled_name",
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
        """Return the share of "pass and shoot" among these and interceptions; NaN if none is, or nobody else plays."""
        passed, taken = self.share("pass and shoot"), self.share("interception")
        return passed / (passed + taken) if self.others and passed + taken else float("nan")

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
    game, generation = run.game, run.finished - 1
    first = evolving_teams(game)[0]
    name = f"settlements-{games}-of{generation}"
    kept = run.result(name)
    if kept is None:
        everybody = line_up(game, *champions(run, generation).values())
        seeds = game_seeds(run.config.seed, RunStream.ANSWERED, _NUMBER, count=games)
        found = [classify(game, one.counts, one.winner, first) for one in play_lots(evaluator, [everybody], seeds)]
        kept = {"patterns": np.concatenate(found)}
        run.save_result(name, kept)
    ours = tuple(name for role, name in run.evolving.items() if game.roles[role].team == first)
    others = tuple(name for name in run.evolving.values() if name not in ours)
    return Settled(str(run.path), ours, others, kept["patterns"], taken_over(run.generations, ours, others))


def can_settle(game: Game) -> bool:
    """Tell whether a game counts what its patterns are told by."""
    return set(_NEEDED) <= set(game.counts)


def check_settled(run: Run) -> None:
    """Refuse a run whose games cannot be classified.

    Raises:
        InputError: says what was expected.
    """
    if run.finished < 1:
        raise InputError(f"{run.path} has no finished generation yet; go on with 'coevo resume {run.path}'")
    if not can_settle(run.game):
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
        >>> from coevo.settlement import taken_over
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


def settled_name(pattern: str) -> str:
    """Return the column of a pattern's share in a table with a row a run."""
    return f"settled_{pattern.replace(' ', '_').replace('-', '_')}"


def settlement_columns(settled: Settled) -> dict[str, float]:
    """Return what a table with a row a run tells of it: shares by pattern, the ratio of 6.4.3, and the take-over.

    ``take_over`` is NaN where nobody took over.
    """
    shares = {settled_name(name): settled.share(name) for name in PATTERNS}
    late = float("nan") if settled.take_over is None else float(settled.take_over)
    return {**shares, "settled_ratio": settled.ratio(), "take_over": late}
