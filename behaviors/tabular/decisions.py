"""The decisions of one robot in one trial, and what its table learns of them; compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from behaviors.tabular.qlearning import Learner, greedy, lambda_returns, one_step
from behaviors.tabular.table import Table, row_of
from coevo.compiled import helper
from coevo.soccer.rng import below, uniform

__all__ = ["Decisions", "decide", "end_decisions", "most_decisions"]


class Decisions(NamedTuple):
    """The decisions of one robot in one trial, filled anew in each.

    rows: (room,) int64, row of the table. actions: (room,) int64. rewards: (room,) float64, what came while the action
        lasted. lengths: (room,) int64, how long it lasted in steps.
    made: (1,) int64, how many there are.
    """

    rows: NDArray[np.int64]
    actions: NDArray[np.int64]
    rewards: NDArray[np.float64]
    lengths: NDArray[np.int64]
    made: NDArray[np.int64]


def most_decisions(time_limit: int, min_steps: int) -> int:
    """Return how many states a trial may visit: one each decision, and the one that time runs out in."""
    return -(-time_limit // min_steps) + 1


@helper
def _update_last(learner: Learner, table: Table, decisions: Decisions, following: int) -> None:
    """Update the value of the newest decision, which led to the row ``following``."""
    k = decisions.made[0] - 1
    row, action, reward = decisions.rows[k], decisions.actions[k], decisions.rewards[k]
    if table.fixed[row]:
        return
    one_step(learner, table.values, table.visits, row, action, reward, decisions.lengths[k], following)


@helper
def decide(
    learner: Learner,
    table: Table,
    decisions: Decisions,
    state: int,
    known: int,
    old: int,
    epsilon: float,
    share_of_new: float,
    rng: NDArray[np.uint64],
) -> int:
    """Return the action of a robot that learns, and add it to its decisions.

    Args:
        learner: numbers of learning.
        table: the values; gets a row for the state if it has none.
        decisions: those of the trial so far.
        state: discrete, to decide in.
        known: action of the policy that the robot had when the trial began; taken where the table's row is fixed.
        old: action of the policy that is reused (3.10), -1 for none.
        epsilon: probability of a random action.
        share_of_new: beta of (3.10), the probability of not reusing it.
        rng: the trial's stream.
    """
    row = row_of(table, state)
    if learner.one_step and not learner.actor_critic and decisions.made[0] > 0:
        _update_last(learner, table, decisions, row)
    if learner.follows or table.fixed[row]:
        action = known
    elif uniform(rng) < epsilon:
        action = below(rng, table.values.shape[1])
    elif old >= 0 and uniform(rng) >= share_of_new:
        action = old
    else:
        action = greedy(table.values, row, rng)
    count = decisions.made[0]
    decisions.rows[count], decisions.actions[count] = row, action
    decisions.rewards[count], decisions.lengths[count] = 0.0, 0
    decisions.made[0] = count + 1
    return int(action)


@helper
def end_decisions(learner: Learner, table: Table, decisions: Decisions, last: int, failed: bool) -> None:
    """Let the table learn of a trial that is over.

    Args:
        learner, table, decisions: of the robot.
        last: row of the state where time ran out, -1 for a real end.
        failed: it ended, and not in success.
    """
    count, rows, actions, lengths = decisions.made[0], decisions.rows, decisions.actions, decisions.lengths
    rewards, fixed = decisions.rewards, table.fixed
    if count == 0:
        return
    if learner.one_step:
        _update_last(learner, table, decisions, last)
        return
    if learner.follows:  # the value of a state is the number of steps to the goal
        for k in range(count):
            rewards[k], actions[k] = float(lengths[k]), 0
        if failed:
            rewards[count - 1] += learner.never
    lambda_returns(learner, table.values, table.visits, fixed, rows, actions, rewards, lengths, count, last)
