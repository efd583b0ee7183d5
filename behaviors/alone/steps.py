"""How many steps a behaviour takes to its goal, counted in trials, compiled (B.2.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from behaviors.alone.task import GOING, SUCCESS
from behaviors.alone.trials import LEARNED, Scene, play_trial
from behaviors.tabular.decisions import Decisions
from behaviors.tabular.qlearning import Learner, lambda_returns
from behaviors.tabular.table import Table
from coevo.compiled import borrowed, entry, helper

__all__ = ["count_steps"]


@entry
def count_steps(
    scene: Scene,
    learner: Learner,
    never: float,
    seeds: NDArray[np.uint64],
    table: Table,
    decisions: Decisions,
    expected: NDArray[np.float64],
    visits: NDArray[np.int64],
) -> bool:
    """Estimate the expected physical steps to the goal under the bank's policy; return False if no start was found.

    The rule is that of the values, with steps as rewards.

    Args:
        scene: world, task and models of the behaviour.
        learner: numbers of the rule; gamma must be 1.
        never: steps that a trial counts which ends without the goal.
        seeds: (trials,) uint64.
        table: dense, all rows fixed: says which states there are.
        decisions: room for those of one trial.
        expected: (states, 1) float64, updated. visits: likewise, how often each was updated.
    """
    scene = borrowed(scene)
    rng = np.zeros(1, np.uint64)
    for n in range(seeds.shape[0]):
        rng[0] = seeds[n]
        outcome, t = play_trial(scene, learner, True, LEARNED, 0.0, 0.0, scene.task.in_view, table, decisions, rng)
        if t < 0:
            return False
        _expect(learner, never, expected, visits, decisions, outcome)
    return True


@helper
def _expect(
    learner: Learner,
    never: float,
    expected: NDArray[np.float64],
    visits: NDArray[np.int64],
    decisions: Decisions,
    outcome: int,
) -> None:
    """Update the expected steps backwards through one trial."""
    count, rows, lengths = decisions.made[0], decisions.rows, decisions.lengths
    steps = lengths[:count].astype(np.float64)
    if outcome not in (SUCCESS, GOING):
        steps[count - 1] += never
    only, fixed = np.zeros(count, np.int64), np.zeros(expected.shape[0], np.bool_)
    lambda_returns(learner, expected, visits, fixed, rows, only, steps, lengths, count, decisions.last[0])
