"""Tabular Q learning, compiled: which action, and how the values change (Uchibe 1999, appendix B.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from behaviors.actor_critic.choice import CHOICES
from behaviors.settings import LearningSettings
from coevo.compiled import helper
from coevo.soccer.rng import below

__all__ = ["Learner", "greedy", "lambda_returns", "make_learner", "one_step"]


class Learner(NamedTuple):
    """Numbers of Q learning, and of actor and critic; see behaviors.settings.LearningSettings.

    actor_critic: learn by an actor and a critic (behaviors.actor_critic). literal: (5.9) as it is printed. choice:
        number of one of behaviors.actor_critic.choice.CHOICES.
    follows: act by the policy that is there, and learn how many steps it takes to the goal, ``never`` if it fails.
    """

    one_step: bool
    per_action: bool
    gamma: float
    return_lambda: float
    alpha: float
    alpha_visits: float
    alpha_min: float
    epsilon_start: float
    epsilon_end: float
    easy_share: float
    anywhere_share: float
    follows: bool = False
    never: float = 0.0
    actor_critic: bool = False
    literal: bool = False
    beta: float = 0.0
    choice: int = 0


def make_learner(settings: LearningSettings) -> Learner:
    """Return what the kernels need of a recipe's settings of learning."""
    return Learner(
        one_step=settings.update == "one-step",
        per_action=settings.discount_per == "action",
        gamma=settings.gamma,
        return_lambda=settings.return_lambda,
        alpha=settings.alpha,
        alpha_visits=settings.alpha_visits,
        alpha_min=settings.alpha_min,
        epsilon_start=settings.epsilon_start,
        epsilon_end=settings.epsilon_end,
        easy_share=settings.easy_share,
        anywhere_share=settings.anywhere_share,
        actor_critic=settings.method == "actor-critic",
        literal=settings.actor == "literal",
        beta=settings.beta,
        choice=CHOICES.index(settings.choice),
    )


@helper
def greedy(values: NDArray[np.float64], row: int, rng: NDArray[np.uint64]) -> int:
    """Return the best action of a row; equals are drawn at random."""
    best, count = 0, 1
    for a in range(1, values.shape[1]):
        if values[row, a] > values[row, best]:
            best, count = a, 1
        elif values[row, a] == values[row, best]:
            count += 1
            if below(rng, count) == 0:
                best = a
    return best


@helper
def _discount(learner: Learner, length: int) -> float:
    return float(learner.gamma ** (1 if learner.per_action else length))


@helper
def _approach(
    learner: Learner, values: NDArray[np.float64], visits: NDArray[np.int64], row: int, action: int, target: float
) -> None:
    """Move a value towards a target, by a share that falls with its visits or stays."""
    alpha = learner.alpha
    if learner.alpha_visits > 0.0:
        alpha = max(learner.alpha_min, learner.alpha / (1.0 + visits[row, action] / learner.alpha_visits))
    values[row, action] += alpha * (target - values[row, action])
    visits[row, action] += 1


@helper
def one_step(
    learner: Learner,
    values: NDArray[np.float64],
    visits: NDArray[np.int64],
    row: int,
    action: int,
    reward: float,
    length: int,
    following: int,
) -> None:
    """Update one value by (B.2): Q += alpha (r + gamma max Q(next) - Q).

    ``following``: row of the state after the action, -1 after the end of the trial. Running out of time is no end, as
    with lambda-returns: the two differ in nothing but the returns and the moment of the update.
    """
    target = reward
    if following >= 0:
        target += _discount(learner, length) * values[following].max()
    _approach(learner, values, visits, row, action, target)


@helper
def lambda_returns(
    learner: Learner,
    values: NDArray[np.float64],
    visits: NDArray[np.int64],
    fixed: NDArray[np.bool_],
    rows: NDArray[np.int64],
    actions: NDArray[np.int64],
    rewards: NDArray[np.float64],
    lengths: NDArray[np.int64],
    count: int,
    last: int,
) -> None:
    """Update the values backwards through one trial with lambda-returns.

    The return of a decision is r + gamma^steps ((1 - lambda) max Q(next) + lambda * return of the next). A trial that
    ran out of time goes on in the value of the state it reached (row ``last``); one that ended has none (-1). A row
    that is ``fixed`` (rows,) stays as it is, and no return reaches across it: a trial that enters it goes on in its
    value, as if time had run out there (B.6).
    """
    ahead = 0.0
    for k in range(count - 1, -1, -1):
        if fixed[rows[k]]:
            continue
        following = last if k == count - 1 else rows[k + 1]
        target = rewards[k]
        if following >= 0:
            best = values[following].max()
            mixed = best
            if k < count - 1 and not fixed[following]:
                mixed = (1.0 - learner.return_lambda) * best + learner.return_lambda * ahead
            target += _discount(learner, lengths[k]) * mixed
        ahead = target
        _approach(learner, values, visits, rows[k], actions[k], target)
