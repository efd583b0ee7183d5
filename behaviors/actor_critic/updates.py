"""How critic and actor change, compiled: (5.7) to (5.9), and the recipe that learns (Uchibe 1999, 5.2.2 and 5.3.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from behaviors.actor_critic.choice import score
from behaviors.tabular.decisions import Decisions
from behaviors.tabular.qlearning import Learner
from behaviors.tabular.table import Table
from coevo.compiled import helper

__all__ = ["Outlook", "earn", "earn_nothing", "learn_backwards"]


class Outlook(NamedTuple):
    """What one robot earns by several rewards, and how it looks ahead.

    credits: (channels, events) float64, what each channel earns for each event of the task. once: (events,) bool,
        whether an event counts once an action; paid: (events,) bool, whether it was counted in the one under way.
    earned: (room, channels) float64, of each decision of a trial. discounts: (lengths, channels, channels) float64,
        Gamma to the power that an action of each length [steps] has.
    tolerances: (channels,) float64, see ``behaviors.reward``. scratch: (2, channels) float64.
    """

    credits: NDArray[np.float64]
    once: NDArray[np.bool_]
    paid: NDArray[np.bool_]
    earned: NDArray[np.float64]
    discounts: NDArray[np.float64]
    tolerances: NDArray[np.float64]
    scratch: NDArray[np.float64]


@helper
def earn(outlook: Outlook, robot: int, decision: int, event: int, amount: float) -> None:
    """Add what an event brings to what a decision of a robot has earned, ``outlook`` being that of all robots."""
    if not (outlook.once[robot, event] and outlook.paid[robot, event]):
        outlook.paid[robot, event] = True
        for n in range(outlook.earned.shape[2]):
            outlook.earned[robot, decision, n] += outlook.credits[robot, n, event] * amount


@helper
def earn_nothing(outlook: Outlook, robot: int, decision: int) -> None:
    """Begin a decision of a robot, ``outlook`` being that of all robots."""
    for event in range(outlook.paid.shape[1]):
        outlook.paid[robot, event] = False
    for n in range(outlook.earned.shape[2]):
        outlook.earned[robot, decision, n] = 0.0


@helper
def _rate(learner: Learner, start: float, visits: int) -> float:
    """Return a learning rate that falls with visits, or stays."""
    if learner.alpha_visits <= 0.0:
        return start
    return max(learner.alpha_min, start / (1.0 + visits / learner.alpha_visits))


@helper
def _take_in(
    learner: Learner,
    table: Table,
    tolerances: NDArray[np.float64],
    row: int,
    action: int,
    target: NDArray[np.float64],
) -> None:
    """Move the critic of a row, and the actor of a row and action, by how far the critic is from its target."""
    visits = 0
    for a in range(table.visits.shape[1]):
        visits += table.visits[row, a]
    alpha = _rate(learner, learner.alpha, visits)
    beta = _rate(learner, learner.beta, table.visits[row, action])
    for n in range(target.shape[0]):
        error = target[n] - table.critic[row, n]  # (5.7), or the advantage of a lambda-return
        table.critic[row, n] += alpha * error  # (5.8)
        if learner.literal:
            table.actor[row, action, n] += beta * error  # (5.9)
        else:
            table.actor[row, action, n] += beta * (error - table.actor[row, action, n])
    table.visits[row, action] += 1
    score(learner.choice, table.actor[row], tolerances, table.values[row])


@helper
def learn_backwards(
    learner: Learner,
    table: Table,
    outlook: Outlook,
    decisions: Decisions,
    first: int,
    last: int,
) -> None:
    """Learn from the decisions of a trial from number ``first`` on, the last first, with lambda-returns.

    With a single one, delta = r + Gamma v(next) - v (5.7), that is to learn after each step.

    The return of a decision is r + Gamma ((1 - lambda) v(next) + lambda * return of the next), Gamma to the power of
    the action's length. What the last of them led to goes on in the value of the row ``last``; where that was the end
    of the trial, and not for lack of time, there is none (-1).
    """
    ahead, target, channels = outlook.scratch[0], outlook.scratch[1], outlook.scratch.shape[1]
    rows, actions, lengths, count = decisions.rows, decisions.actions, decisions.lengths, decisions.made[0]
    for k in range(count - 1, first - 1, -1):
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
        _take_in(learner, table, outlook.tolerances, rows[k], actions[k], target)
