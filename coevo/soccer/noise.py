"""Noise of the sensors and of the actuators, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import helper
from coevo.soccer.camera import BALL, BALL_FEATURES, GOAL_FEATURES, ROBOT_FEATURES, ROBOTS, CameraParams
from coevo.soccer.physics import PhysicsParams
from coevo.soccer.rng import normal

__all__ = ["blur_sight", "shake_drive"]


@helper
def blur_sight(
    camera: CameraParams,
    objects: int,
    features: NDArray[np.float64],
    areas: NDArray[np.float64],
    rng: NDArray[np.uint64],
) -> None:
    """Add sensor noise to the features of what is visible of the camera's ``objects``.

    Each coordinate and extent gets the camera's noise; the area, a sum over an outline, that times its square root.
    """
    for o in range(objects):
        if areas[o] > 0.0:
            last = (BALL_FEATURES if o == BALL else GOAL_FEATURES if o < ROBOTS else ROBOT_FEATURES) - 1
            for k in range(last):
                features[o, k] += camera.noise * normal(rng)
            areas[o] = max(1.0, areas[o] + camera.noise * np.sqrt(areas[o]) * normal(rng))
            features[o, last] = areas[o]


@helper
def shake_drive(physics: PhysicsParams, commands: NDArray[np.float64], robot: int, rng: NDArray[np.uint64]) -> None:
    """Scale a robot's commanded speed and turn rate by the noise of its actuators."""
    commands[robot, 0] *= 1.0 + physics.actuator_noise * normal(rng)
    commands[robot, 1] *= 1.0 + physics.actuator_noise * normal(rng)
