"""The two robots of chapter 3, their duties in each period (Uchibe 1999, Table 3.1), and how their trials went."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from behaviors.trials.solo import blind_models
from behaviors.trials.task import COLLISION, SUCCESS
from behaviors.lpm import LocalPredictionModel
from behaviors.schedule.data import FIXED, LEARNING, STATIONARY, Store, make_store
from behaviors.schedule.recipe import LearnerSettings, Schedule
from coevo.errors import InputError
from coevo.skill import ObjectModel, Skill
from coevo.skill.model import MOST_STATES
from coevo.soccer.drive import action_set

__all__ = ["NAMES", "PERIODS", "Agent", "Duty", "Outcomes", "Period", "joined", "new_agents", "no_outcomes"]

NAMES = ("passer", "shooter")


class Duty(NamedTuple):
    """What a robot does in a period: its role, whether it stores, and what its models are made of at the beginning."""

    role: int
    stores: bool
    models: Literal["kept", "random", "stored"]


class Period(NamedTuple):
    """A period, for the passer and the shooter."""

    name: str
    duties: tuple[Duty, Duty]


# Table 3.1. A model is first made of random actions, and later of what was stored while the other robot learned.
PERIODS = {
    "scheduled": (
        Period("A", (Duty(LEARNING, True, "random"), Duty(STATIONARY, False, "kept"))),
        Period("B", (Duty(FIXED, True, "kept"), Duty(LEARNING, True, "random"))),
        Period("C", (Duty(LEARNING, False, "stored"), Duty(FIXED, True, "kept"))),
        Period("D", (Duty(FIXED, True, "kept"), Duty(LEARNING, False, "stored"))),
    ),
    "simultaneous": (Period("S", (Duty(LEARNING, True, "random"), Duty(LEARNING, True, "random"))),),
}


@dataclass
class Agent:
    """One of the two robots, and all that it has learned.

    Attributes:
        number: PASSER or SHOOTER. settings: of the recipe.
        models: of its state. predictors: the local prediction models that these, and ``also``, were made from.
        chosen: models of the same experience with the orders that 3.2.3 and (3.6) choose; only reported.
        values: (states, actions) float32; None as long as it has learned nothing.
        store: its latest experience.
        old: models and values of before the last renewal.
    """

    number: int
    settings: LearnerSettings
    models: tuple[ObjectModel, ...]
    store: Store
    predictors: dict[str, LocalPredictionModel] = field(default_factory=dict)
    chosen: dict[str, LocalPredictionModel] = field(default_factory=dict)
    values: NDArray[np.float32] | None = None
    old: tuple[tuple[ObjectModel, ...], NDArray[np.float32]] | None = None

    @property
    def name(self) -> str:
        """``passer`` or ``shooter``."""
        return NAMES[self.number]

    def skill(self, schedule: Schedule, *, old: bool = False) -> Skill:
        """Return what it has learned, or what it had before; zeros as long as there is nothing."""
        models, values = self.old if old and self.old is not None else (self.models, self.values)
        states = math.prod(model.states for model in models)
        if states > MOST_STATES:
            sizes = " x ".join(str(model.states) for model in models)
            raise InputError(
                f"the {self.name} has {sizes} = {states} states, and {MOST_STATES} is the most; give smaller orders"
            )
        drive = schedule.world.robot
        if values is None:
            values = np.zeros((states, len(action_set(drive).codes)), np.float32)
        action = self.settings.action
        return Skill(self.name, drive.drive, models, values, action.min_steps, action.max_steps)


class Outcomes(NamedTuple):
    """How trials went: (trials,) int64 each; see ``run_pair``."""

    ends: NDArray[np.int64]
    passes: NDArray[np.int64]
    steps: NDArray[np.int64]
    nearer: NDArray[np.int64]

    def rates(self) -> dict[str, float]:
        """Return the shares of trials with a pass, the shooter's goal and a collision, and the mean length."""
        return {
            "passing": float((self.passes > 0).mean()),
            "shooting": float((self.ends == SUCCESS).mean()),
            "collisions": float((self.ends == COLLISION).mean()),
            "steps": float(self.steps.mean()),
        }

    def where_nearer(self, robot: int) -> Outcomes:
        """Return the trials in which a robot started nearer to the ball than the other."""
        return Outcomes(*(column[self.nearer == robot] for column in self))


def no_outcomes(trials: int) -> Outcomes:
    """Return room for so many outcomes."""
    return Outcomes(*(np.zeros(trials, np.int64) for _ in Outcomes._fields))


def new_agents(schedule: Schedule) -> tuple[Agent, Agent]:
    """Return two robots that know nothing."""
    passer, shooter = (
        Agent(n, settings, blind_models(settings.objects), make_store(schedule.store.steps))
        for n, settings in enumerate((schedule.passer, schedule.shooter))
    )
    return passer, shooter


def joined(found: Sequence[Outcomes]) -> Outcomes:
    """Return the outcomes of trials one after the other."""
    return Outcomes(*(np.concatenate(columns) for columns in zip(*found, strict=True)))
