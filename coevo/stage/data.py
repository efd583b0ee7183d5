"""What a stage is made of: one bundle of arrays for compiled code, and the world that it lives in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.config import WorldSettings
from coevo.skill import SkillBank
from coevo.skill.estimate import Memory, make_memory
from coevo.soccer.camera import CameraParams, Retina, camera_params, make_retina
from coevo.soccer.drive import ActionSet, action_set
from coevo.soccer.events import EventParams, Events, make_events
from coevo.soccer.physics import Handles, PhysicsParams, physics_params
from coevo.soccer.world import World

__all__ = ["Body", "Doing", "Roles", "Stage", "Venue", "make_venue"]


class Body(NamedTuple):
    """The bodies, and what the drives were told; R robots.

    state: (R + 1, 6) float64, robots, then the ball: x, y [m], heading [rad, CCW], vx, vy [m/s], turn rate [rad/s].
    commands: (R, 2) float64, forward speed [m/s] and turn rate [rad/s] that each drive is asked for.
    codes: (R, 2) float64, code of the action under way: the input u that the models know; zeros before the first.
    ball_gap: (R,), robot_gap: (R, R) float64, smallest gaps in the last step [m].
    """

    state: NDArray[np.float64]
    commands: NDArray[np.float64]
    codes: NDArray[np.float64]
    ball_gap: NDArray[np.float64]
    robot_gap: NDArray[np.float64]


class Doing(NamedTuple):
    """The action that each of R robots is at, (R,) int64 each.

    skill: whose it is, action: its number; -1 before the first. held: for how many steps. start: discrete state in
    which it was chosen.
    """

    skill: NDArray[np.int64]
    action: NDArray[np.int64]
    held: NDArray[np.int64]
    start: NDArray[np.int64]


class Roles(NamedTuple):
    """What each of R robots is, and the numbers of those that follow a script.

    role: (R,) int64, see coevo.stage.roles. team: (R,) int64, 0 attacks the goal at x = length.
    sees: (R,) bool, whether it looks and remembers.
    guesses: (R,) bool, whether it begins with a random belief about where it saw each object last.
    skill: (R,) int64, which skill of the bank one that has a single one uses.
    target: (R,) int64, the body that a chaser drives at. share: (R,) float64, of the speeds and turn rates that the
        drives can do, what each robot's does.
    hold: (2,) int64, least and most steps for which a random action is held.
    left: (R, 2) int64, of a random robot the action and for how many steps more.
    top: (2,) float64, maximum speed [m/s] and turn rate [rad/s].
    """

    role: NDArray[np.int64]
    team: NDArray[np.int64]
    sees: NDArray[np.bool_]
    guesses: NDArray[np.bool_]
    skill: NDArray[np.int64]
    target: NDArray[np.int64]
    share: NDArray[np.float64]
    hold: NDArray[np.int64]
    left: NDArray[np.int64]
    top: NDArray[np.float64]


class Stage(NamedTuple):
    """Everything that sense, decide, drive and step work on.

    It holds only addresses of its world: keep the Venue that it came from.
    """

    handles: Handles
    physics: PhysicsParams
    camera: CameraParams
    retina: Retina
    limits: EventParams
    events: Events
    bank: SkillBank
    memory: Memory
    drive: ActionSet
    body: Body
    doing: Doing
    roles: Roles


@dataclass(frozen=True)
class Venue:
    """A stage with the world that its addresses point to."""

    world: World
    stage: Stage


def make_venue(
    settings: WorldSettings,
    bank: SkillBank,
    limits: EventParams,
    *,
    roles: Sequence[int],
    teams: Sequence[int],
    mates: Sequence[int],
    world: World | None = None,
) -> Venue:
    """Make a stage, in a world of its own or in one that is there.

    Args:
        settings: the world.
        bank: skills that robots use, and whose models say what they remember.
        limits: what counts as contact, as parting and as a pass.
        roles: what each robot is, see coevo.stage.roles; all see and none guesses unless the arrays say otherwise.
        teams: 0 or 1 for each robot.
        mates: number of each robot's team mate, -1 for none.
        world: of the same settings and number of robots.
    """
    robots = len(roles)
    world = World(settings, robots) if world is None else world
    physics = physics_params(settings)
    stage = Stage(
        handles=world.handles,
        physics=physics,
        camera=camera_params(settings),
        retina=make_retina(settings),
        limits=limits,
        events=make_events(robots),
        bank=bank,
        memory=make_memory(bank, list(mates)),
        drive=action_set(settings.robot),
        body=Body(
            state=np.zeros((robots + 1, 6)),
            commands=np.zeros((robots, 2)),
            codes=np.zeros((robots, 2)),
            ball_gap=np.zeros(robots),
            robot_gap=np.zeros((robots, robots)),
        ),
        doing=Doing(*(np.zeros(robots, np.int64) for _ in Doing._fields)),
        roles=Roles(
            role=np.array(roles, np.int64),
            team=np.array(teams, np.int64),
            sees=np.ones(robots, np.bool_),
            guesses=np.zeros(robots, np.bool_),
            skill=np.zeros(robots, np.int64),
            target=np.zeros(robots, np.int64),
            share=np.ones(robots),
            hold=np.ones(2, np.int64),
            left=np.zeros((robots, 2), np.int64),
            top=np.array([settings.robot.max_speed_mps, math.radians(settings.robot.max_turn_rate_dps)]),
        ),
    )
    return Venue(world, stage)
