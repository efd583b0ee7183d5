"""Numbers of the on-board camera, and room for one image."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import inlined
from coevo.config import WorldSettings

__all__ = ["CameraParams", "Retina", "camera_params", "make_retina", "whole_blocks"]

_BLOCK = 8


class CameraParams(NamedTuple):
    """Numbers of the camera and of what it can see; lengths in metres."""

    columns: int
    rows: int
    fx: float
    fy: float
    sin_tilt: float
    cos_tilt: float
    height: float
    ball_radius: float
    robot_radius: float
    robot_height: float
    goal_height: float
    mouth_low: float
    mouth_high: float
    length: float
    noise: float


def camera_params(world: WorldSettings) -> CameraParams:
    """Return what the camera kernels need of the settings; two focal lengths, as pixels are not square."""
    camera, field = world.camera, world.field
    tilt = -math.radians(camera.tilt_deg)  # the kernels count downwards
    return CameraParams(
        columns=camera.width_px,
        rows=camera.height_px,
        fx=0.5 * camera.width_px / math.tan(0.5 * math.radians(camera.horizontal_view_deg)),
        fy=0.5 * camera.height_px / math.tan(0.5 * math.radians(camera.vertical_view_deg)),
        sin_tilt=math.sin(tilt),
        cos_tilt=math.cos(tilt),
        height=camera.height_m,
        ball_radius=world.ball.radius_m,
        robot_radius=world.robot.radius_m,
        robot_height=world.robot.height_m,
        goal_height=field.goal_height_m,
        mouth_low=0.5 * (field.width_m - field.goal_width_m),
        mouth_high=0.5 * (field.width_m + field.goal_width_m),
        length=field.length_m,
        noise=camera.noise_px,
    )


class Retina(NamedTuple):
    """Room for one image, and for as many columns more as the last block may have.

    words: uint64, the rows that the object under way covers, from its first column on.
    occupied: uint64, all that is covered.
    shown: (objects, columns) uint64, the rows where each object is visible; kept only where there is room for it.
    """

    words: NDArray[np.uint64]
    occupied: NDArray[np.uint64]
    shown: NDArray[np.uint64]


def make_retina(world: WorldSettings, *, shown: int = 0) -> Retina:
    """Make room for the images of a camera; ``shown``: number of objects whose part of the image is kept."""
    columns = world.camera.width_px + _BLOCK
    words, occupied = np.zeros(columns, np.uint64), np.zeros(columns, np.uint64)
    return Retina(words, occupied, np.zeros((shown, columns), np.uint64))


@inlined
def whole_blocks(columns: int) -> int:
    """Return the number of columns rounded up to whole blocks.

    Most objects cover a few columns only. LLVM computes several at once, and the rest one by one, which costs more:
    with whole blocks there is no rest.
    """
    return (columns + _BLOCK - 1) & -_BLOCK
