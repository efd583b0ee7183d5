"""The two robots of chapter 3, their duties in each period (Uchibe 1999, Table 3.1), and how their trials went."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from behaviors.lpm import LocalPredictionModel
from behaviors.schedule.recipe import LearnerSettings, Schedule
from behaviors.trials.kernels import Results
from behaviors.trials.minds import Store, make_store
from behaviors.trials.solo import blind_models
from behaviors.trials.task import COLLISION, SUCCESS
from coevo.errors import InputError
from coevo.skill import ObjectModel, Skill
from coevo.skill.model import MOST_STATES
from coevo.soccer.camera import ROBOTS
from coevo.soccer.drive import action_set
from coevo.stage import LEARNER, SKILL, STANDING

__all__ = ["NAMES", "PERIODS", "Agent", "Duty", "Period", "new_agents", "rates", "where_nearer"]

NAMES = ("passer", "shooter")
_OBJECTS = ROBOTS + 2  # of a robot's memory: the other robot is there as the mate and as the nearest


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
        Period("A", (Duty(LEARNER, True, "random"), Duty(STANDING, False, "kept"))),
        Period("B", (Duty(SKILL, True, "kept"), Duty(LEARNER, True, "random"))),
        Period("C", (Duty(LEARNER, False, "stored"), Duty(SKILL, True, "kept"))),
        Period("D", (Duty(SKILL, True, "kept"), Duty(LEARNER, False, "stored"))),
    ),
    "simultaneous": (Period("S", (Duty(LEARNER, True, "random"), Duty(LEARNER, True, "random"))),),
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

    @property
    def states(self) -> int:
        """Number of discrete states that its models tell apart."""
        return math.prod(model.states for model in self.models)

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


def rates(found: Results) -> dict[str, float]:
    """Return the shares of trials with a pass, the shooter's goal and a collision, and the mean length."""
    return {
        "passing": float((found.passes > 0).mean()),
        "shooting": float((found.ends == SUCCESS).mean()),
        "collisions": float((found.ends == COLLISION).mean()),
        "steps": float(found.steps.mean()),
    }


def where_nearer(found: Results, robot: int) -> Results:
    """Return the trials in which a robot started nearer to the ball than the other."""
    return Results(*(column[found.nearer == robot] for column in found))


def new_agents(schedule: Schedule) -> tuple[Agent, Agent]:
    """Return two robots that know nothing."""
    passer, shooter = (
        Agent(n, settings, blind_models(settings.objects), make_store(schedule.store.steps, _OBJECTS))
        for n, settings in enumerate((schedule.passer, schedule.shooter))
    )
    return passer, shooter
