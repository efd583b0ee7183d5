"""A state straight from the features of one image: the "previous method" that chapter 3 compares with.

As in Asada et al. (1996), and Uchibe's own work before the local prediction models: a ball is left, middle or right
and small, medium or large, which with two states for "out of view" makes 11; a goal is besides seen from the left,
from the front or from the right, which makes 29. Nothing is predicted and nothing remembered.

Such a state is that of an ``ObjectModel`` with a history of one step. Each row of its memory matrix takes one
component from the newest image, scaled so that the limits between its three classes become -cell and +cell.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from coevo.errors import InputError
from coevo.skill import ObjectModel
from coevo.skill.model import INPUTS, OBJECT_KINDS

__all__ = ["RAW_COMPONENTS", "raw_model", "usual_order"]

Array = NDArray[np.float64]

# Component: the features it is made of (their number in the camera's rows) and their weights. In this order they are
# taken. Of those that the camera measures some say nothing new (a goal's area is nearly its four corners), but a larger
# table to compare with may want them.
_BALL = {"x": {0: 1.0}, "area": {3: 1.0}, "y": {1: 1.0}, "radius": {2: 1.0}}
_GOAL = {
    "x": {0: 1.0},
    "area": {10: 1.0},
    # The left edge is higher than the right one where the goal is seen from the left. (y points down.)
    "orientation": {7: 1.0, 3: -1.0, 9: -1.0, 5: 1.0},
    "y": {1: 1.0},
    "upper left x": {2: 1.0},
    "upper left y": {3: 1.0},
    "upper right x": {4: 1.0},
    "upper right y": {5: 1.0},
}
_ROBOT = {"x": {0: 1.0}, "area": {4: 1.0}, "y": {1: 1.0}, "width": {2: 1.0}, "height": {3: 1.0}}
RAW_COMPONENTS = {"ball": _BALL, "own_goal": _GOAL, "opponent_goal": _GOAL, "mate": _ROBOT, "robot": _ROBOT}
_CLASSES = 3


def usual_order(kind: str) -> int:
    """Return how many components make the state of the literature: position and size, and the orientation of a goal."""
    return 3 if RAW_COMPONENTS[kind] is _GOAL else 2


def raw_model(
    kind: str,
    seen: Sequence[Array],
    *,
    order: int | None = None,
    image_width: float,
    cell: float = 1.0,
    lost_states: int = 2,
) -> ObjectModel:
    """Return the model whose discrete state is made of the first components of ``RAW_COMPONENTS``.

    x is cut into thirds of the image, every other component into terciles of what was seen; a limit lies half-way
    between two values that occurred, so that whole numbers of pixels are never on it.

    Args:
        kind: what is looked at, a key of coevo.skill.model.OBJECT_KINDS.
        seen: (T, features) each, features of images with the object in view [px].
        order: how many components; None for the usual ones.
        image_width: [px].
        cell, lost_states: of the model. The classes are the same for every cell.

    Raises:
        InputError: there are not so many components, one of them takes fewer than three values, or a feature is no
            number.
    """
    components, order = RAW_COMPONENTS[kind], usual_order(kind) if order is None else order
    if not 1 <= order <= len(components):
        raise InputError(
            f"the raw state of {kind} has 1 to {len(components)} components ({', '.join(components)}), not {order}"
        )
    rows = np.concatenate([np.empty((0, OBJECT_KINDS[kind])), *seen])
    if not np.isfinite(rows).all():
        raise InputError(f"the features of {kind} are not all finite; expected numbers wherever it is in view")
    directions, middles, scales = np.zeros((order, INPUTS + OBJECT_KINDS[kind])), np.zeros(order), np.zeros(order)
    for j, (name, weights) in enumerate(list(components.items())[:order]):
        for feature, weight in weights.items():
            directions[j, INPUTS + feature] = weight
        samples = rows @ directions[j, INPUTS:]
        low, high = (image_width / 3.0, image_width / 1.5) if name == "x" else _terciles(samples, f"{name} of {kind}")
        middles[j], scales[j] = 0.5 * (low + high), 2.0 * cell / (high - low)
    # Any mean with M mean = the middles gives these states: the shortest one.
    mean = np.asarray(np.linalg.lstsq(directions, middles, rcond=None)[0], np.float64)
    return ObjectModel(kind, 1, scales[:, None] * directions, mean, cell, lost_states)


def _terciles(samples: Array, what: str) -> tuple[float, float]:
    """Return the limits of three classes, none of them empty, that hold about a third of the samples each."""
    if not np.isfinite(samples).all():
        raise InputError(
            f"the {what} was not finite in the experience; expected numbers wherever the object is in view"
        )
    values = np.unique(samples)
    if len(values) < _CLASSES:
        raise InputError(
            f"the {what} took {len(values)} different values in the experience, but a raw state cuts it into three"
            " classes; take a smaller order, or let the recipe gather more experience"
        )
    first, second = np.searchsorted(values, np.quantile(samples, (1 / 3, 2 / 3), method="inverted_cdf"))
    below = min(max(first, 1), len(values) - 2)
    above = min(max(second, below), len(values) - 2)
    low, high = 0.5 * (values[below - 1] + values[below]), 0.5 * (values[above] + values[above + 1])
    return float(low), float(high)
