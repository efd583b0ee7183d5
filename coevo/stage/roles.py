"""What a robot on the stage may be, and what those do that follow a script; compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import helper
from coevo.soccer.rng import below
from coevo.stage.data import Stage

__all__ = ["CHASER", "INFORMED", "LEARNER", "RANDOM", "ROAMER", "SKILL", "STANDING", "TREE", "follow_script"]

# Stands; a tree that evolves or not; random actions of the drive, each held for a while; random speeds and turns, not
# of the drive; drives at a body; one skill throughout; learns; is told the true state of the world.
STANDING, TREE, RANDOM, ROAMER, CHASER, SKILL, LEARNER, INFORMED = range(8)

_FACING = 0.25 * math.pi  # a chaser drives when it faces its target within this angle
_TURN_GAIN = 4.0  # [1/s] of its heading error
_ROAM_LEAST, _ROAM_SPREAD = 10, 31  # a roamer holds a command for 10 to 40 steps


@helper
def follow_script(stage: Stage, robot: int, rng: NDArray[np.uint64]) -> int:
    """Let a robot act that follows a script: return its action of the drive, or command its drive and return -1."""
    roles, commands, state = stage.roles, stage.body.commands, stage.body.state
    role, share, left = roles.role[robot], roles.share[robot], roles.left
    speed, turn = roles.top[0], roles.top[1]
    if role == RANDOM:
        if left[robot, 1] == 0:
            left[robot, 0] = below(rng, stage.drive.codes.shape[0])
            left[robot, 1] = roles.hold[0] + below(rng, roles.hold[1] - roles.hold[0] + 1)
        left[robot, 1] -= 1
        return int(left[robot, 0])
    if role == ROAMER:
        if left[robot, 1] <= 0:
            commands[robot, 0] = (below(rng, 3) - 1.0) * speed * share
            commands[robot, 1] = (below(rng, 3) - 1.0) * turn * share
            left[robot, 1] = _ROAM_LEAST + below(rng, _ROAM_SPREAD)
        left[robot, 1] -= 1
    elif role == CHASER:
        target = roles.target[robot]
        to_x, to_y = state[target, 0] - state[robot, 0], state[target, 1] - state[robot, 1]
        error = math.atan2(to_y, to_x) - state[robot, 2]
        error -= 2.0 * math.pi * math.floor(error / (2.0 * math.pi) + 0.5)
        commands[robot, 0] = speed * share if abs(error) < _FACING else 0.0
        commands[robot, 1] = min(max(_TURN_GAIN * error, -turn * share), turn * share)
    return -1
