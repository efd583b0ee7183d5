"""The decisions of one trial: when a new action is chosen, which, and what the table learns of them; compiled.

An action repeats a primitive until the state changes (Uchibe 1999, 3.3.1), within the limits of the skill.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from behaviors.tabular.qlearning import Learner, greedy, lambda_returns, one_step
from behaviors.tabular.table import Table, row_of
from coevo.compiled import helper, inlined
from coevo.skill import SkillBank
from coevo.skill.estimate import Memory, discrete_state
from coevo.soccer.rng import below, uniform

__all__ = ["Decisions", "end_decisions", "forget_decisions", "make_decisions", "most_decisions", "next_action"]


class Decisions(NamedTuple):
    """The decisions of one robot in one trial, filled anew in each.

    rows: (room,) int64, row of the table. actions: (room,) int64. rewards: (room,) float64, what came while the action
        lasted. lengths: (room,) int64, how long it lasted in steps.
    made: (1,) int64, how many there are.
    last: (1,) int64, row of the state that time ran out in, -1 if the trial ended.
    doing: (3,) int64, the action under way (-1 for none yet), for how many steps, and the state it was chosen in.
    """

    rows: NDArray[np.int64]
    actions: NDArray[np.int64]
    rewards: NDArray[np.float64]
    lengths: NDArray[np.int64]
    made: NDArray[np.int64]
    last: NDArray[np.int64]
    doing: NDArray[np.int64]


def make_decisions(time_limit: int) -> Decisions:
    """Make room for the decisions of a trial of ``time_limit`` steps."""
    rows, actions, lengths = (np.zeros(time_limit, np.int64) for _ in range(3))
    made, last, doing = np.zeros(1, np.int64), np.zeros(1, np.int64), np.zeros(3, np.int64)
    return Decisions(rows, actions, np.zeros(time_limit), lengths, made, last, doing)


def most_decisions(time_limit: int, min_steps: int) -> int:
    """Return how many states a trial may visit: one each decision, and the one that time runs out in."""
    return -(-time_limit // min_steps) + 1


@helper
def forget_decisions(decisions: Decisions) -> None:
    """Start a trial with no decision made."""
    decisions.made[0], decisions.last[0] = 0, -1
    decisions.doing[0], decisions.doing[1], decisions.doing[2] = -1, 0, -1


@helper
def _update_last(learner: Learner, table: Table, decisions: Decisions, following: int) -> None:
    """Update the value of the newest decision, which led to the row ``following``."""
    k = decisions.made[0] - 1
    row, action, reward = decisions.rows[k], decisions.actions[k], decisions.rewards[k]
    if table.fixed[row]:
        return
    one_step(learner, table.values, table.visits, row, action, reward, decisions.lengths[k], following)


@inlined
def next_action(
    memory: Memory,
    bank: SkillBank,
    skill: int,
    robot: int,
    time: int,
    learner: Learner,
    table: Table,
    decisions: Decisions,
    learning: bool,
    at_random: bool,
    epsilon: float,
    old: int,
    share_of_new: float,
    rng: NDArray[np.uint64],
) -> int:
    """Return the action of the step that begins: the one under way, or a new one.

    Args:
        memory, bank, skill, robot, time: what the state is estimated from.
        learner: numbers of Q learning.
        table: the values that are learned; gets a row for the state if it has none.
        decisions: those of the trial so far; the step is counted.
        learning: choose by ``table``, and learn; else, and where a row is fixed, follow the bank's policy of ``skill``.
        at_random: choose at random all the same.
        epsilon: probability of a random action.
        old: skill of the bank whose policy is reused (3.10), -1 for none.
        share_of_new: beta of (3.10), the probability of not reusing it.
        rng: the trial's stream.
    """
    doing = decisions.doing
    if doing[0] < 0 or doing[1] >= bank.min_steps[skill]:
        now = discrete_state(memory, bank, skill, robot, time)
        if doing[0] < 0 or doing[1] >= bank.max_steps[skill] or now != doing[2]:
            row = row_of(table, now) if learning else 0
            if learning and learner.one_step and decisions.made[0] > 0:
                _update_last(learner, table, decisions, row)
            fixed = learning and table.fixed[row]
            if at_random or (not fixed and (learning or epsilon > 0.0) and uniform(rng) < epsilon):
                action = below(rng, table.values.shape[1])
            elif fixed or not learning:
                action = bank.policy[bank.first[skill] + now]
            elif old >= 0 and uniform(rng) >= share_of_new:
                action = bank.policy[bank.first[old] + discrete_state(memory, bank, old, robot, time)]
            else:
                action = greedy(table.values, row, rng)
            count = decisions.made[0]
            decisions.rows[count], decisions.actions[count] = row, action
            decisions.rewards[count], decisions.lengths[count] = 0.0, 0
            decisions.made[0] = count + 1
            doing[0], doing[1], doing[2] = action, 0, now
    doing[1] += 1
    decisions.lengths[decisions.made[0] - 1] += 1
    return int(doing[0])


@helper
def end_decisions(learner: Learner, table: Table, decisions: Decisions, last: int) -> None:
    """Let the table learn of a trial that is over; ``last``: row of the state where time ran out, -1 for a real end."""
    decisions.last[0] = last
    if learner.one_step:
        _update_last(learner, table, decisions, last)
    else:
        lambda_returns(
            learner,
            table.values,
            table.visits,
            table.fixed,
            decisions.rows,
            decisions.actions,
            decisions.rewards,
            decisions.lengths,
            decisions.made[0],
            last,
        )
