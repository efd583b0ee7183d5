"""Events: kick, pass, goal, collision, out of field."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import inlined
from coevo.config import WorldSettings
from coevo.soccer.physics import PhysicsParams

__all__ = [
    "EventParams",
    "Events",
    "clear_events",
    "event_params",
    "goal_scored",
    "in_contact",
    "make_events",
    "out_of_field",
    "record_contacts",
    "record_goal",
]

_ROUNDING = 1e-9  # a time of whole steps is so many steps, though 1/30 s is no exact number


class EventParams(NamedTuple):
    """Distances [m] and times [steps] that decide what counts; ``stuck_after`` 0: a ball is never stuck."""

    contact_gap: float
    release_gap: float
    pass_window: int
    stuck_after: int
    stuck_within: float
    stuck_off_goals: float


class Events(NamedTuple):
    """What has happened in a game so far.

    kicks, collisions, passes, own_goals: (robots,) int64 counts.
    touching: (robots, robots) bool, pairs of robots that have collided and not parted since; on the diagonal, whether
        the robot touched the ball in the last step.
    last_touch: (1,) int64, who touched the ball last, -1 for nobody; touched_at: (1,) int64, when.
    spot: (2,) float64, where the ball was [m] when it was last seen to move on; spot_at: (1,) int64, when.
    """

    kicks: NDArray[np.int64]
    collisions: NDArray[np.int64]
    passes: NDArray[np.int64]
    own_goals: NDArray[np.int64]
    touching: NDArray[np.bool_]
    last_touch: NDArray[np.int64]
    touched_at: NDArray[np.int64]
    spot: NDArray[np.float64]
    spot_at: NDArray[np.int64]


def event_params(world: WorldSettings) -> EventParams:
    """Return what the kernels need of the settings."""
    return EventParams(
        contact_gap=world.physics.contact_gap_m,
        release_gap=world.rules.collision_release_m,
        pass_window=round(world.rules.pass_window_s / world.physics.step_s),
        stuck_after=math.ceil(world.rules.stuck_after_s / world.physics.step_s - _ROUNDING),
        stuck_within=world.rules.stuck_within_m,
        stuck_off_goals=world.rules.stuck_off_goals_m,
    )


def make_events(robots: int) -> Events:
    """Make room for the events of a game of ``robots``."""
    return Events(
        kicks=np.zeros(robots, np.int64),
        collisions=np.zeros(robots, np.int64),
        passes=np.zeros(robots, np.int64),
        own_goals=np.zeros(robots, np.int64),
        touching=np.zeros((robots, robots), np.bool_),
        last_touch=np.full(1, -1, np.int64),
        touched_at=np.zeros(1, np.int64),
        spot=np.full(2, np.inf),
        spot_at=np.zeros(1, np.int64),
    )


@inlined
def clear_events(events: Events) -> None:
    """Start a game with nothing having happened."""
    events.kicks.fill(0)
    events.collisions.fill(0)
    events.passes.fill(0)
    events.own_goals.fill(0)
    events.touching.fill(False)
    events.last_touch[0] = -1
    events.touched_at[0] = 0
    events.spot.fill(math.inf)
    events.spot_at[0] = 0


@inlined
def in_contact(params: EventParams, gap: float) -> bool:
    """Tell whether bodies whose smallest gap in a step was ``gap`` [m] touched."""
    return bool(gap <= params.contact_gap)


@inlined
def record_contacts(
    params: EventParams,
    teams: NDArray[np.int64],
    time: int,
    ball_gap: NDArray[np.float64],
    robot_gap: NDArray[np.float64],
    events: Events,
) -> None:
    """Count what the smallest gaps of one step (see ``advance``) mean.

    A kick is a step of contact with the ball. A pass is credited to A, the last toucher, when a team mate B comes to
    touch the ball within the window after A let it go. A collision is counted once, for both, until they part.
    """
    robots = teams.shape[0]
    for r in range(robots):
        touches = in_contact(params, ball_gap[r])
        if touches:
            events.kicks[r] += 1
            last, ago = events.last_touch[0], time - events.touched_at[0]
            received = last >= 0 and last != r and teams[last] == teams[r] and not events.touching[r, r]
            if received and not in_contact(params, ball_gap[last]) and ago <= params.pass_window:
                events.passes[last] += 1
            events.last_touch[0] = r
            events.touched_at[0] = time
        events.touching[r, r] = touches
        for other in range(r):
            gap = robot_gap[r, other]
            if in_contact(params, gap):
                if not events.touching[r, other]:
                    events.touching[r, other] = True
                    events.collisions[r] += 1
                    events.collisions[other] += 1
            elif gap > params.release_gap:
                events.touching[r, other] = False


@inlined
def goal_scored(physics: PhysicsParams, state: NDArray[np.float64]) -> int:
    """Return the team in whose favour the ball's centre is behind a goal line, -1 if it is in play."""
    x = state[state.shape[0] - 1, 0]
    if x > physics.length:
        return 0
    if x < 0.0:
        return 1
    return -1


@inlined
def record_goal(teams: NDArray[np.int64], scored: int, events: Events) -> None:
    """Count a goal of team ``scored`` (-1: none) as an own goal of who touched the ball last, if it is one."""
    last = events.last_touch[0]
    if scored >= 0 and last >= 0 and teams[last] != scored:
        events.own_goals[last] += 1


@inlined
def out_of_field(physics: PhysicsParams, state: NDArray[np.float64], robot: int) -> bool:
    """Tell whether a robot's centre is behind a goal line; elsewhere the walls hold it."""
    return bool(state[robot, 0] < 0.0 or state[robot, 0] > physics.length)
