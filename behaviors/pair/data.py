"""What trials of two robots work on: the robots and their roles, what they store, the world around them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from behaviors.tabular.decisions import Decisions
from behaviors.tabular.qlearning import Learner
from behaviors.tabular.table import Table
from coevo.skill import SkillBank
from coevo.skill.estimate import Memory
from coevo.soccer.camera import FEATURES, ROBOTS, CameraParams, Retina
from coevo.soccer.events import EventParams, Events
from coevo.soccer.physics import Handles, PhysicsParams

__all__ = [
    "FIXED",
    "LEARNING",
    "PASSER",
    "RANDOM",
    "SHOOTER",
    "STATIONARY",
    "Pair",
    "Player",
    "Rules",
    "Stage",
    "Store",
    "make_stage",
    "make_store",
]

PASSER, SHOOTER = 0, 1
STATIONARY, FIXED, LEARNING, RANDOM = 0, 1, 2, 3  # roles; random: primitives held at random, to gather experience


class Rules(NamedTuple):
    """What a trial is about. Rewards, and of a random robot for how long it holds a primitive [steps]."""

    in_view: bool
    passer_nearer: float
    goal_reward: float
    pass_reward: float
    every_pass: bool
    collision_reward: float
    hold_min: int
    hold_max: int


class Store(NamedTuple):
    """A ring of the latest experience: N_all rows, one a step.

    trial: (N_all,) int64 number of the trial. inputs: (N_all, 2) code of the action that led to the row's image.
    features: (N_all, objects, 11), areas: (N_all, objects), as in the camera; the shooter is the passer's object 3.
    written: (1,) int64, how many rows were ever written; the newest is row (written - 1) % N_all.
    """

    trial: NDArray[np.int64]
    inputs: NDArray[np.float64]
    features: NDArray[np.float64]
    areas: NDArray[np.float64]
    written: NDArray[np.int64]


class Player(NamedTuple):
    """A robot that learns, or not.

    stores: keep what it sees. old: skill of the bank that is reused (3.10), -1 for none.
    fixed_epsilon: share of random actions in the role FIXED.
    """

    role: int
    stores: bool
    old: int
    fixed_epsilon: float
    learner: Learner
    table: Table
    decisions: Decisions
    store: Store


class Stage(NamedTuple):
    """What changes in each step.

    state: (3, 6). commands: (2, 2). ball_gap: (2,). robot_gap: (2, 2). teams: (2,).
    codes: (2, 2), of the actions under way. held: (2, 2) int64, of a random robot the action and the steps left.
    trial: (1,) int64 number of the trial for the stores. passes: (1,) int64, of the trial.
    nearer: (1,) int64, the robot that started nearer to the ball.
    """

    state: NDArray[np.float64]
    commands: NDArray[np.float64]
    ball_gap: NDArray[np.float64]
    robot_gap: NDArray[np.float64]
    teams: NDArray[np.int64]
    codes: NDArray[np.float64]
    held: NDArray[np.int64]
    trial: NDArray[np.int64]
    passes: NDArray[np.int64]
    nearer: NDArray[np.int64]


class Pair(NamedTuple):
    """Everything a trial happens in; the bank holds new and old skill of the passer, then of the shooter."""

    handles: Handles
    physics: PhysicsParams
    camera: CameraParams
    retina: Retina
    limits: EventParams
    events: Events
    rules: Rules
    bank: SkillBank
    memory: Memory
    codes: NDArray[np.float64]
    commands: NDArray[np.float64]
    regions: NDArray[np.float64]
    stage: Stage
    players: tuple[Player, Player]


def make_stage() -> Stage:
    """Make room for what changes in each step."""
    return Stage(
        state=np.zeros((3, 6)),
        commands=np.zeros((2, 2)),
        ball_gap=np.zeros(2),
        robot_gap=np.zeros((2, 2)),
        teams=np.zeros(2, np.int64),
        codes=np.zeros((2, 2)),
        held=np.zeros((2, 2), np.int64),
        trial=np.zeros(1, np.int64),
        passes=np.zeros(1, np.int64),
        nearer=np.zeros(1, np.int64),
    )


def make_store(rows: int) -> Store:
    """Make room for the latest ``rows`` steps of a robot."""
    objects = ROBOTS + 1
    features, areas = np.zeros((rows, objects, FEATURES)), np.zeros((rows, objects))
    return Store(np.zeros(rows, np.int64), np.zeros((rows, 2)), features, areas, np.zeros(1, np.int64))
