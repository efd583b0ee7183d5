"""Whether a condition holds for what a robot sees, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import inlined
from coevo.soccer.camera import FEATURES
from coevo.soccer.conditions import AREA, ConditionTable

__all__ = ["holds"]


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
