"""How much of a champion's fitness is left when it plays again.

The best of a generation is good, and lucky too: its advantage over the mean of its population was measured in the same
games that it was chosen by. Played again, from other starts and with other partners and opponents of the same
generation, an advantage that was luck is gone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.tournament.play import kept_name
from coevo.evolution.evaluation import Evaluator, Match
from coevo.evolution.grouping import groups_again, line_ups
from coevo.evolution.opponents import frozen_codes
from coevo.fitness import Scorer
from coevo.records import GenerationRecord
from coevo.run import Run
from coevo.seeds import RunStream, game_seeds, generator
from coevo.statistics import LEVEL
from coevo.tree import compile_program

__all__ = ["Left", "left_over", "play_again"]

_RESAMPLES = 2000


def play_again(
    run: Run,
    evaluator: Evaluator,
    *,
    generations: Sequence[int],
    repeats: int,
    report: Callable[[int, int], None] | None = None,
) -> pd.DataFrame:
    """Let the champions of generations play again, or read what they did from the run folder.

    Args:
        run: with these generations finished.
        evaluator: plays.
        generations: which.
        repeats: how often; each time as many games as in evolution, with partners, opponents and guests drawn anew.
        report: called after each generation with how many are done, and of how many.

    Returns:
        a row a generation and robot: ``generation``, ``robot``, ``fitness`` (as evolution saw it), ``mean`` (of its
        population), ``again`` (mean of the repeats), ``spread`` (standard deviation of one repeat).
    """
    name = kept_name("again", repeats, generations)
    kept = run.result(name)
    robots = list(run.evolving.values())
    if kept is None:
        rows = []
        for done, generation in enumerate(generations):
            rows.append(_of_generation(run, evaluator, generation, repeats))
            if report is not None:
                report(done + 1, len(generations))
        kept = {"fitness": np.array(rows)}  # (generations, robots, 4)
        run.save_result(name, kept)
    values = kept["fitness"].reshape(-1, 4)
    table = pd.DataFrame(values, columns=["fitness", "mean", "again", "spread"])
    table.insert(0, "generation", np.repeat(list(generations), len(robots)))
    table.insert(1, "robot", robots * len(generations))
    return table


def _of_generation(run: Run, evaluator: Evaluator, generation: int, repeats: int) -> list[list[float]]:
    config, game = run.config, run.game
    scorer = Scorer(config, game.counts, run.folders)
    records = run.records(generation)
    matches = [
        match for record in records for k in range(repeats) for match in _matches(run, records, record, generation, k)
    ]
    outcomes = evaluator.play(matches, run.config_of(generation))
    found = []
    for record in records:
        played = [next(outcomes) for _ in range(repeats * config.evaluation.rounds)]
        sums = {
            name: np.array([one.counts[name][:, record.role].sum() for one in played], np.int64) for name in game.counts
        }
        counts = {name: values.reshape(repeats, -1).sum(axis=1) for name, values in sums.items()}
        again = np.asarray(scorer(counts, generation), np.float64)
        spread = float(again.std(ddof=1)) if repeats > 1 else 0.0
        best = float(record.fitness[record.order[0]])
        found.append([best, float(record.fitness.mean()), float(again.mean()), spread])
    return found


def _matches(
    run: Run, records: Sequence[GenerationRecord], record: GenerationRecord, generation: int, repeat: int
) -> list[Match]:
    """Return the games of the champion of a role among others of its generation, and guests, drawn at random."""
    config, roles, role = run.config, run.game.roles, record.role
    draw = generator(config.seed, RunStream.PARTNERS, generation, role, repeat)
    groups = groups_again(config, roles, generation, (role, int(record.order[0])), draw)
    seeds = game_seeds(config.seed, RunStream.AGAIN, generation, role, repeat, count=config.evaluation.games)
    codes = {of.role: of.codes for of in records}

    def best_of(other: int, earlier: int) -> NDArray[np.uint8]:
        return np.asarray(run.record(earlier, run.evolving[other])["tree"].iloc[0], np.uint8)

    frozen = frozen_codes(config, run.game)
    lots = np.split(seeds, len(groups))
    return [
        Match(
            [None if one is None else compile_program(one, run.game.function_set(k)) for k, one in enumerate(team)], lot
        )
        for team, lot in zip(line_ups(groups, codes, best_of, frozen), lots, strict=True)
    ]


@dataclass(frozen=True)
class Left:
    """The share of champions' advantage over the mean that is left when they play again.

    Attributes:
        robot: whose champions.
        share: 1 if all of it is left, 0 if none.
        low, high: its 95 % interval over generations; None if there are fewer than three.
        generations: how many.
    """

    robot: str
    share: float
    low: float | None
    high: float | None
    generations: int

    @property
    def text(self) -> str:
        """The share with its interval, if there is one."""
        if self.low is None or self.high is None:
            return f"{self.share:.0%}"
        return f"{self.share:.0%} [{self.low:.0%}, {self.high:.0%}]"


def left_over(table: pd.DataFrame) -> list[Left]:
    """Return for each robot how much of its champions' advantage is left; nothing for one whose champions had none.

    The share is that of sums over generations, as single advantages may be small. The interval is a bootstrap over
    generations, which are alike in a run; what another run would give, only other runs tell.

    Args:
        table: of ``play_again``.
    """
    found = []
    for robot, rows in table.groupby("robot", sort=False):
        first = (rows["mean"] - rows["fitness"]).to_numpy()
        again = (rows["mean"] - rows["again"]).to_numpy()
        total = float(first.sum())
        if total <= 0.0:
            continue
        share = float(again.sum()) / total
        low = high = None
        if len(rows) > 2:
            drawn = np.random.default_rng(0).integers(len(rows), size=(_RESAMPLES, len(rows)))
            advantage = first[drawn].sum(axis=1)
            some = advantage > 0.0  # a draw of generations without any says nothing
            ratios = again[drawn].sum(axis=1)[some] / advantage[some]
            low, high = (float(q) for q in np.quantile(ratios, [0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL]))
        found.append(Left(str(robot), share, low, high, len(rows)))
    return found
