"""The field's walls, goal boxes and corner panels as line segments."""

from __future__ import annotations

import math
from typing import NamedTuple

from coevo.config import FieldSettings

__all__ = ["Wall", "walls"]


class Wall(NamedTuple):
    """A straight wall: its centre line from start to end [m]; half the thickness lies on either side."""

    start: tuple[float, float]
    end: tuple[float, float]


def walls(field: FieldSettings) -> list[Wall]:
    """Return the centre lines of all walls, moved outwards so that their inner faces bound the field.

    The ends of the walls beside a goal are round posts that reach exactly to the mouth.
    """
    length, width, half = field.length_m, field.width_m, 0.5 * field.wall_thickness_m
    low, high = 0.5 * (width - field.goal_width_m), 0.5 * (width + field.goal_width_m)
    found = [
        Wall((-half, -half), (length + half, -half)),
        Wall((-half, width + half), (length + half, width + half)),
    ]
    for line, outwards in ((0.0, -1.0), (length, 1.0)):
        face, back = line + outwards * half, line + outwards * (field.goal_depth_m + half)
        found += [
            Wall((face, -half), (face, low - half)),
            Wall((face, high + half), (face, width + half)),
            Wall((face, low - half), (back, low - half)),
            Wall((face, high + half), (back, high + half)),
            Wall((back, low - half), (back, high + half)),
        ]
    if field.corner_panels:
        cut, out = field.corner_panel_m, half / math.sqrt(2.0)
        for x, towards_x in ((0.0, 1.0), (length, -1.0)):
            for y, towards_y in ((0.0, 1.0), (width, -1.0)):
                shift_x, shift_y = x - towards_x * out, y - towards_y * out
                found.append(Wall((shift_x + towards_x * cut, shift_y), (shift_x, shift_y + towards_y * cut)))
    return found
