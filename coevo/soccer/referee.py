"""The referee of the league: what happens to a ball that is stuck.

The rules of RoboCup's middle size league (Uchibe 1999 played in its first years) let the referee restart a game in
which nothing moves on: the ball is taken from where it is wedged and dropped at a mark inside the field. Here it is
dropped at the middle of the width, as far along the field as it was, but not before a goal.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import helper
from coevo.soccer.events import EventParams, Events
from coevo.soccer.physics import Handles, PhysicsParams, put_ball

__all__ = ["drop_place", "free_ball"]

_CLEAR_M = 0.05  # a dropped ball is at least this far from every robot
_ASIDE_M = 0.1  # by so much farther it is tried to each side of the middle


@helper
def drop_place(physics: PhysicsParams, limits: EventParams, state: NDArray[np.float64]) -> tuple[float, float]:
    """Return where a stuck ball is dropped: mid-width, or the next place beside it that is free of robots.

    Where robots leave no place at all, it is the middle of the width all the same.

    Args:
        physics, limits: numbers of the world and of the rule.
        state: (bodies, 6) float64, the ball last.
    """
    ball = state.shape[0] - 1
    off = min(limits.stuck_off_goals, 0.5 * physics.length)
    x = min(max(state[ball, 0], off), physics.length - off)
    apart = physics.robot_radius + physics.ball_radius + _CLEAR_M
    middle = 0.5 * physics.width
    tries = int((middle - physics.ball_radius) / _ASIDE_M)
    for k in range(2 * tries + 1):
        y = middle + (_ASIDE_M * ((k + 1) // 2) if k % 2 == 1 else -_ASIDE_M * (k // 2))
        free = True
        for robot in range(ball):
            if math.hypot(state[robot, 0] - x, state[robot, 1] - y) < apart:
                free = False
        if free:
            return x, y
    return x, middle


@helper
def free_ball(
    limits: EventParams,
    physics: PhysicsParams,
    handles: Handles,
    state: NDArray[np.float64],
    time: int,
    events: Events,
) -> bool:
    """Drop a ball that is stuck; return whether it was.

    It is stuck if for ``limits.stuck_after`` steps it has not been farther than ``limits.stuck_within`` from where it
    was when they began. Who touched it before has not touched it after: a drop is no pass.

    Args:
        limits: numbers of the rule.
        physics, handles: the world.
        state: (bodies, 6) float64, at the end of the step; the ball's row is replaced if it is dropped.
        time: number of the step, from 0.
        events: where it was last seen to move on.
    """
    ball = state.shape[0] - 1
    if math.hypot(state[ball, 0] - events.spot[0], state[ball, 1] - events.spot[1]) > limits.stuck_within:
        events.spot[0], events.spot[1], events.spot_at[0] = state[ball, 0], state[ball, 1], time
        return False
    if time - events.spot_at[0] < limits.stuck_after:
        return False
    x, y = drop_place(physics, limits, state)
    state[ball].fill(0.0)
    state[ball, 0], state[ball, 1] = x, y
    put_ball(handles, state)
    events.spot[0], events.spot[1], events.spot_at[0] = x, y, time
    events.last_touch[0] = -1
    for robot in range(ball):
        events.touching[robot, robot] = False
    return True
