"""What a robot's camera shows, as images of labels: for each pixel the object that it belongs to."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coevo.config import WorldSettings
from coevo.soccer.camera import FEATURES, camera_params, make_retina, object_count, see

__all__ = ["label_images"]


def label_images(world: WorldSettings, states: ArrayLike, robot: int, side: int) -> NDArray[np.uint8]:
    """Return what games compute features and conditions from: the analytic camera, without the noise of its features.

    Args:
        world: sizes, and the camera.
        states: (moments, robots + 1, 6), robots in order, then the ball.
        robot: whose camera.
        side: 0 if the robot attacks the goal at x = length, 1 if the one at x = 0.

    Returns:
        (moments, rows, columns) uint8: 0 for no object, else 1 + its number among the camera's objects.
    """
    bodies = np.ascontiguousarray(states, np.float64)
    camera, objects = camera_params(world), object_count(bodies.shape[1] - 1)
    retina = make_retina(world, shown=objects)
    features, areas = np.zeros((objects, FEATURES)), np.zeros(objects)
    rows = np.arange(camera.rows, dtype=np.uint64)[:, None]
    images = np.zeros((len(bodies), camera.rows, camera.columns), np.uint8)
    for image, state in zip(images, bodies, strict=True):
        see(camera, state, robot, side, retina, features, areas)
        for thing in np.flatnonzero(areas > 0.0):
            image[(retina.shown[thing, : camera.columns] >> rows) & np.uint64(1) == 1] = 1 + thing
    return images
