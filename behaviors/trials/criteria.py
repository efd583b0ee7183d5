"""A vector-valued reward as the kernels need it: what a channel earns for each event of a task, and its discounts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from behaviors.actor_critic.discounts import discount_powers
from behaviors.reward import RewardSettings, discount_matrix
from behaviors.trials.minds import Criteria
from behaviors.trials.task import BUMPED, CHANNELS, COLLIDED, KICKED, TOUCHED

__all__ = ["contact_events", "make_criteria"]

_CONTACTS = {"action": (BUMPED, TOUCHED), "step": (BUMPED, TOUCHED), "contact": (COLLIDED, KICKED)}


def contact_events(settings: RewardSettings) -> dict[str, int]:
    """Return what is a collision and a kick: contact in a step, or that it begins."""
    collision, kick = _CONTACTS[settings.paid]
    return {"collision": collision, "kick": kick}


def make_criteria(
    settings: RewardSettings, numbers: Mapping[str, int], *, per_action: bool, most_steps: int
) -> Criteria:
    """Return what the kernels need of a vector-valued reward.

    Args:
        settings: its channels.
        numbers: by the name of an event its number in the task.
        per_action: the discounts are for an action, however long.
        most_steps: that an action may last.
    """
    earned = np.zeros((len(settings.channels), CHANNELS))
    for n, channel in enumerate(settings.channels):
        for event, amount in channel.earns.amounts.items():
            earned[n, numbers[event]] += amount
    once = np.zeros(CHANNELS, np.bool_)
    once[[BUMPED, TOUCHED]] = settings.paid == "action"
    gamma = discount_matrix(settings)
    if per_action:
        discounts = np.stack([gamma] * (most_steps + 1))
    else:
        discounts = discount_powers(gamma, 1.0 / settings.discount_steps, most_steps)
    tolerances = np.array([channel.tolerance for channel in settings.channels])
    return Criteria(earned, once, discounts, tolerances)
