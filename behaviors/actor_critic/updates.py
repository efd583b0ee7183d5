"""How critic and actor change, compiled: (5.7) to (5.9), and the recipe that learns (Uchibe 1999, 5.2.2 and 5.3.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from behaviors.actor_critic.choice import score
from behaviors.tabular.qlearning import Learner
from behaviors.tabular.table import Table
from coevo.compiled import helper

__all__ = ["Outlook", "learn_backwards", "learn_step"]


class Outlook(NamedTuple):
    """What one robot earned in a trial, and how it looks ahead.

    earned: (room, channels) float64, of each decision. discounts: (lengths, channels, channels) float64, Gamma to the
        power that an action of each length [steps] has.
    tolerances: (channels,) float64, see ``behaviors.reward``. ahead, target: (channels,) float64, scratch.
    """

    earned: NDArray[np.float64]
    discounts: NDArray[np.float64]
    tolerances: NDArray[np.float64]
    ahead: NDArray[np.float64]
    target: NDArray[np.float64]


@helper
def _rate(learner: Learner, start: float, visits: int) -> float:
    """Return a learning rate that falls with visits, or stays."""
    if learner.alpha_visits <= 0.0:
        return start
    return max(learner.alpha_min, start / (1.0 + visits / learner.alpha_visits))


@helper
def _take_in(learner: Learner, table: Table, outlook: Outlook, row: int, action: int) -> None:
    """Move the critic of a row, and the actor of a row and action, by how far ``outlook.target`` is from the critic."""
    alpha = _rate(learner, learner.alpha, table.visits[row].sum())
    beta = _rate(learner, learner.beta, table.visits[row, action])
    for n in range(outlook.target.shape[0]):
        error = outlook.target[n] - table.critic[row, n]  # (5.7), or the advantage of a lambda-return
        table.critic[row, n] += alpha * error  # (5.8)
        if learner.literal:
            table.actor[row, action, n] += beta * error  # (5.9)
        else:
            table.actor[row, action, n] += beta * (error - table.actor[row, action, n])
    table.visits[row, action] += 1
    score(learner.choice, table.actor[row], outlook.tolerances, table.values[row])


@helper
def learn_step(
    learner: Learner, table: Table, outlook: Outlook, k: int, row: int, action: int, length: int, following: int
) -> None:
    """Learn from decision ``k`` alone: delta = r + Gamma v(next) - v (5.7).

    ``following``: row of the state after the action, -1 after the end of the trial.
    """
    power, target = outlook.discounts[length], outlook.target
    for n in range(target.shape[0]):
        target[n] = outlook.earned[k, n]
        if following >= 0:
            for m in range(target.shape[0]):
                target[n] += power[n, m] * table.critic[following, m]
    _take_in(learner, table, outlook, row, action)


@helper
def learn_backwards(
    learner: Learner,
    table: Table,
    outlook: Outlook,
    rows: NDArray[np.int64],
    actions: NDArray[np.int64],
    lengths: NDArray[np.int64],
    count: int,
    last: int,
) -> None:
    """Learn from all decisions of a trial, the last first, with lambda-returns.

    The return of a decision is r + Gamma ((1 - lambda) v(next) + lambda * return of the next), Gamma to the power of
    the action's length. A trial that ran out of time goes on in the value of the row ``last``; one that ended has none
    (-1).
    """
    ahead, target, channels = outlook.ahead, outlook.target, outlook.target.shape[0]
    for k in range(count - 1, -1, -1):
        following = last if k == count - 1 else rows[k + 1]
        share = learner.return_lambda if k < count - 1 else 0.0
        power = outlook.discounts[lengths[k]]
        for n in range(channels):
            target[n] = outlook.earned[k, n]
            if following >= 0:
                for m in range(channels):
                    mixed = (1.0 - share) * table.critic[following, m] + share * ahead[m]
                    target[n] += power[n, m] * mixed
        for n in range(channels):
            ahead[n] = target[n]
        _take_in(learner, table, outlook, rows[k], actions[k])
