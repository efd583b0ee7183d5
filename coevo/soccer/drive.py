"""Drives: what a robot can be told to do."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.config import RobotSettings

__all__ = ["ActionSet", "action_set"]


class ActionSet(NamedTuple):
    """The discrete actions of a drive.

    codes: (actions, 2) float64 of -1, 0, 1: the input u of (3.12) or (5.13).
    commands: (actions, 2) float64: forward speed [m/s], turn rate [rad/s, CCW].
    """

    codes: NDArray[np.float64]
    commands: NDArray[np.float64]

    @property
    def standing(self) -> int:
        """Number of the action that neither drives nor turns."""
        return int(np.flatnonzero(~self.codes.any(axis=1))[0])


def action_set(robot: RobotSettings) -> ActionSet:
    """Return the actions of the robot's drive.

    Power wheeled steering sets speed and turn rate freely: 9 actions (5.13). With 4-wheel steering front and
    rear wheels steer by opposite angles, so the robot turns only while it drives; steering without driving has
    no meaning and is left out: 7 actions (3.12).

    Example:
        >>> from coevo.config import RobotSettings
        >>> from coevo.soccer.drive import action_set
        >>> len(action_set(RobotSettings(drive="pws")).codes), len(action_set(RobotSettings(drive="4ws")).codes)
        (9, 7)
    """
    levels = (-1.0, 0.0, 1.0)
    codes = [(v, s) for v in levels for s in levels if robot.drive == "pws" or v != 0.0 or s == 0.0]
    commands = []
    for v, s in codes:
        speed = v * robot.max_speed_mps
        if robot.drive == "pws":
            turn = s * math.radians(robot.max_turn_rate_dps)
        else:
            turn = speed * 2.0 * math.tan(s * math.radians(robot.max_steering_deg)) / robot.wheelbase_m
        commands.append((speed, turn))
    return ActionSet(np.array(codes, np.float64), np.array(commands, np.float64))
