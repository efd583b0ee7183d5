"""Conditions of trees as tables for compiled games."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import inlined
from coevo.config import CategorySettings
from coevo.soccer.camera import BALL, FEATURES, ROBOTS

__all__ = ["AREA", "ConditionTable", "holds", "standard_table"]

AREA = FEATURES  # number of the area among the features of a term


class ConditionTable(NamedTuple):
    """For each robot r and function c what must hold.

    thing: (robots, C) int64, the camera's object. wants: (robots, C) int64, 0: it is lost; 1: it is visible, and all
        terms hold.
    first, terms: (robots, C) int64, its terms among those that follow.
    feature: (T,) int64, which feature, AREA for the area, -1 for a linear combination.
    weights: (T, 11) float64, of the features in a combination.
    low, high: (T,) float64, the term holds where low <= value < high.
    """

    thing: NDArray[np.int64]
    wants: NDArray[np.int64]
    first: NDArray[np.int64]
    terms: NDArray[np.int64]
    feature: NDArray[np.int64]
    weights: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


@inlined
def holds(
    table: ConditionTable, robot: int, function: int, features: NDArray[np.float64], areas: NDArray[np.float64]
) -> bool:
    """Tell whether a condition holds for what a robot sees: (objects, 11) features and (objects,) areas."""
    thing = table.thing[robot, function]
    visible = areas[thing] > 0.0
    if table.wants[robot, function] == 0 or not visible:
        return bool(not visible and table.wants[robot, function] == 0)
    first = table.first[robot, function]
    for k in range(first, first + table.terms[robot, function]):
        feature = table.feature[k]
        if feature == AREA:
            value = areas[thing]
        elif feature >= 0:
            value = features[thing, feature]
        else:
            value = 0.0
            for j in range(FEATURES):
                value += table.weights[k, j] * features[thing, j]
        if not table.low[k] <= value < table.high[k]:
            return False
    return True


def standard_table(categories: CategorySettings, robots: int) -> ConditionTable:
    """Return the seven conditions of Table 6.1 for each object of each robot."""
    inf = np.inf
    things = ROBOTS + robots - 1
    rows: list[tuple[int, float, float]] = []
    thing, wants, first, terms = [], [], [], []
    for o in range(things):
        kind = "ball" if o == BALL else "goal" if o < ROBOTS else "robot"
        small, large = getattr(categories, f"{kind}_small_below_px"), getattr(categories, f"{kind}_large_from_px")
        left, right = categories.left_below_px, categories.right_from_px
        for feature, low, high in (
            (0, -inf, left), (0, left, right), (0, right, inf),
            (AREA, -inf, small), (AREA, small, large), (AREA, large, inf),
        ):
            thing.append(o)
            wants.append(1)
            first.append(len(rows))
            terms.append(1)
            rows.append((feature, low, high))
        thing.append(o)
        wants.append(0)
        first.append(0)
        terms.append(0)
    columns = [np.tile(np.array(column, np.int64), (robots, 1)) for column in (thing, wants, first, terms)]
    feature, low, high = (np.array(column) for column in zip(*rows, strict=True))
    return ConditionTable(
        *columns, feature.astype(np.int64), np.zeros((len(rows), FEATURES)), low.astype(np.float64), high.astype(np.float64)
    )
