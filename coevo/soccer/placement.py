"""Where bodies start: uniform in given rectangles, never touching."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import helper
from coevo.config import StartSettings
from coevo.soccer.physics import PhysicsParams
from coevo.soccer.rng import uniform

__all__ = ["place", "regions"]

_FACING = ("ball", "opponent_goal", "own_goal", "random")
_GAP_M = 0.01  # bodies start at least this far apart
_TRIES = 1000


def regions(robots: Sequence[StartSettings], ball: StartSettings) -> NDArray[np.float64]:
    """Return (bodies, 6): x low, high, y low, high [m], number of what is faced, spread [rad]; robots, then ball."""
    rows = [
        (*start.x_m, *start.y_m, _FACING.index(start.facing), math.radians(start.spread_deg))
        for start in [*robots, ball]
    ]
    return np.array(rows, np.float64)


@helper
def place(
    physics: PhysicsParams,
    where: NDArray[np.float64],
    teams: NDArray[np.int64],
    state: NDArray[np.float64],
    rng: NDArray[np.uint64],
) -> bool:
    """Draw a start: fill ``state`` (bodies, 6), at rest; return False if the bodies find no room.

    The ball is placed first, then the robots in their order.
    """
    bodies = state.shape[0]
    ball = bodies - 1
    state.fill(0.0)
    for k in range(bodies):
        body = ball if k == 0 else k - 1
        radius = physics.ball_radius if body == ball else physics.robot_radius
        free = False
        for _ in range(_TRIES):
            state[body, 0] = where[body, 0] + (where[body, 1] - where[body, 0]) * uniform(rng)
            state[body, 1] = where[body, 2] + (where[body, 3] - where[body, 2]) * uniform(rng)
            free = True
            for m in range(k):
                other = ball if m == 0 else m - 1
                apart = radius + (physics.ball_radius if other == ball else physics.robot_radius) + _GAP_M
                dx, dy = state[body, 0] - state[other, 0], state[body, 1] - state[other, 1]
                if dx * dx + dy * dy < apart * apart:
                    free = False
            if free:
                break
        if not free:
            return False
        if body == ball:
            continue
        facing = int(where[body, 4])
        if facing == 3:
            state[body, 2] = math.pi * (2.0 * uniform(rng) - 1.0)
            continue
        to_x, to_y = state[ball, 0], state[ball, 1]
        if facing != 0:
            to_x = physics.length if (facing == 1) == (teams[body] == 0) else 0.0
            to_y = 0.5 * physics.width
        towards = math.atan2(to_y - state[body, 1], to_x - state[body, 0])
        state[body, 2] = towards + where[body, 5] * (2.0 * uniform(rng) - 1.0)
    return True
