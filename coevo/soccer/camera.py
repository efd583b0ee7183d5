"""The on-board camera, computed analytically: what each object covers of the image, and its features.

Sixty rows fit a 64-bit word, so an object is one word a column (``coevo.soccer.silhouette``), and occlusion
is ``word & ~occupied``, nearest object first.

Coordinates of the image are pixels from its upper left corner, x to the right, y down; the centre of the first
pixel is (0.5, 0.5). A pixel belongs to what the ray through its centre hits.

Features (Uchibe 1999, 3.5.2), each row of a (objects, 11) array:
    ball: x, y, radius, area
    goal: x, y, four corners (upper left, upper right, lower left, lower right, x and y each), area
    other robot: x, y, width, height, area
where (x, y) is the centroid of what is visible.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import entry, inlined
from coevo.soccer.bits import ones, sum_of_places, zeros_above, zeros_below
from coevo.soccer.optics import CameraParams, Retina, camera_params, make_retina, whole_blocks
from coevo.soccer.silhouette import ball_words, goal_words, robot_words

__all__ = [
    "BALL",
    "BALL_FEATURES",
    "FEATURES",
    "GOAL_FEATURES",
    "OPPONENT_GOAL",
    "OWN_GOAL",
    "ROBOTS",
    "ROBOT_FEATURES",
    "CameraParams",
    "Retina",
    "camera_params",
    "look",
    "make_retina",
    "object_count",
    "see",
]

BALL, OWN_GOAL, OPPONENT_GOAL, ROBOTS = 0, 1, 2, 3  # order of objects; the other robots follow in their order
BALL_FEATURES, GOAL_FEATURES, ROBOT_FEATURES, FEATURES = 4, 11, 5, 11
_NEAR = 1e-6
_FAR = 1 << 40
_SHIFT = 20  # bits of a column's number
_COLUMN = (1 << _SHIFT) - 1


def object_count(robots: int) -> int:
    """Return how many objects each robot may see: the ball, two goals and every other robot."""
    return ROBOTS + robots - 1


@inlined
def _collect(
    words: NDArray[np.uint64],
    occupied: NDArray[np.uint64],
    first: int,
    columns: int,
    corners: bool,
    out: NDArray[np.float64],
) -> float:
    """Take the visible part of an object, mark it occupied, measure it; return its area (0: not visible).

    ``out``: (11,) features; for a goal as documented, else x, y, width, height. Everything is summed up in integers,
    and without branches, so that LLVM computes several columns at once.
    """
    area, sum_c, sum_row = 0, 0, 0
    left, right, top, bottom = _FAR, -1, 64, -1
    # A corner is where column + row or column - row is least or greatest, the leftmost place of several. So this number
    # and, below it, the column are put into one integer.
    upper_left, upper_right, lower_left, lower_right = _FAR, -_FAR, _FAR, -_FAR
    for k in range(whole_blocks(columns)):
        c = first + k
        word = words[np.uint64(k)] & ~occupied[np.uint64(c)]
        occupied[np.uint64(c)] |= word
        count, lowest, highest = ones(word), zeros_below(word), 63 - zeros_above(word)
        area += count
        sum_c += count * c
        sum_row += sum_of_places(word)
        seen = count > 0
        if corners:
            upper_left = min(upper_left, ((c + lowest) << _SHIFT) + c if seen else _FAR)
            upper_right = max(upper_right, ((c - lowest) << _SHIFT) - c if seen else -_FAR)
            lower_left = min(lower_left, ((c - highest) << _SHIFT) + c if seen else _FAR)
            lower_right = max(lower_right, ((c + highest) << _SHIFT) - c if seen else -_FAR)
        else:
            left, right = min(left, c if seen else _FAR), max(right, c if seen else -1)
            top, bottom = min(top, lowest), max(bottom, highest)
    if area > 0:
        out[0], out[1] = (sum_c + 0.5 * area) / area, (sum_row + 0.5 * area) / area
        if corners:
            c = upper_left & _COLUMN
            out[2], out[3] = c + 0.5, (upper_left >> _SHIFT) - c + 0.5
            c = -upper_right & _COLUMN
            out[4], out[5] = c + 0.5, c - ((upper_right + c) >> _SHIFT) + 0.5
            c = lower_left & _COLUMN
            out[6], out[7] = c + 0.5, c - (lower_left >> _SHIFT) + 0.5
            c = -lower_right & _COLUMN
            out[8], out[9] = c + 0.5, ((lower_right + c) >> _SHIFT) - c + 0.5
        else:
            out[2], out[3] = right - left + 1.0, bottom - top + 1.0
    return float(area)


@inlined
def _show(retina: Retina, thing: int, first: int, columns: int) -> None:
    """Keep the visible part of an object for those who want the image, before it is marked occupied."""
    if retina.shown.shape[0] > 0:
        for k in range(whole_blocks(columns)):
            c = np.uint64(first + k)
            retina.shown[thing, c] = retina.words[np.uint64(k)] & ~retina.occupied[c]


@inlined
def look(
    camera: CameraParams,
    state: NDArray[np.float64],
    robot: int,
    side: int,
    retina: Retina,
    features: NDArray[np.float64],
    areas: NDArray[np.float64],
) -> None:
    """Measure everything that one robot sees.

    Args:
        camera: numbers of the camera.
        state: (robots + 1, 6) state of the world.
        robot: whose camera.
        side: 0 if the robot attacks the goal at x = length, 1 if the one at x = 0.
        retina: room for the image.
        features: (objects or more, 11), rows of visible objects are replaced.
        areas: (objects or more,), area in pixels, 0 where the object is not visible.
    """
    words, occupied = retina.words, retina.occupied
    ball = state.shape[0] - 1
    x, y = state[robot, 0], state[robot, 1]
    cosine, sine = math.cos(state[robot, 2]), math.sin(state[robot, 2])
    for c in range(camera.columns):
        occupied[c] = np.uint64(0)
    for o in range(ROBOTS + ball - 1):
        areas[o] = -1.0
    for o in range(retina.shown.shape[0]):
        for c in range(retina.shown.shape[1]):
            retina.shown[o, c] = np.uint64(0)
    edge = 0.5 * camera.columns / camera.fx
    # How much deeper than on the level of the camera a point can be: on the floor, or upwards on the top of things.
    tallest = max(camera.robot_height, camera.goal_height, 2.0 * camera.ball_radius)
    deepest = max(camera.height * camera.sin_tilt, (camera.height - tallest) * camera.sin_tilt)
    # Balls and robots, nearest first. Discs that do not overlap hide each other in the order of d^2 - r^2.
    for _ in range(ball):
        nearest, power = -1, math.inf
        for body in range(ball + 1):
            if body == robot:
                continue
            thing = _object_of(body, robot, ball)
            if areas[thing] >= 0.0:
                continue
            dx, dy = state[body, 0] - x, state[body, 1] - y
            radius = camera.ball_radius if body == ball else camera.robot_radius
            this = dx * dx + dy * dy - radius * radius
            if this < power:
                nearest, power = body, this
        thing = _object_of(nearest, robot, ball)
        dx, dy = state[nearest, 0] - x, state[nearest, 1] - y
        forward, right = dx * cosine + dy * sine, dx * sine - dy * cosine
        areas[thing] = 0.0
        # The widest column of the image lies at |right| = edge * depth.
        size = camera.ball_radius if nearest == ball else camera.robot_radius
        reach = edge * ((forward + size) * camera.cos_tilt + deepest)
        if forward <= -size or right - size > reach or right + size < -reach:
            continue
        if nearest == ball:
            first, count = ball_words(camera, forward, right, words)
        else:
            first, count = robot_words(camera, forward, right, words)
        if count > 0:
            _show(retina, thing, first, count)
            areas[thing] = _collect(words, occupied, first, count, False, features[thing])
            row = features[thing]
            if nearest == ball:
                row[2] = 0.25 * (row[2] + row[3])
                row[3] = areas[thing]
            else:
                row[4] = areas[thing]
    for goal in range(2):
        at_far_end = (goal == 1) == (side == 0)  # the opponent's goal of side 0 stands at x = length
        thing = OPPONENT_GOAL if goal == 1 else OWN_GOAL
        line = camera.length if at_far_end else 0.0
        areas[thing] = 0.0
        if (line - x) * (1.0 if at_far_end else -1.0) <= _NEAR:
            continue  # from inside the goal its mouth is not seen
        # Seen from the field, the left post of the far goal has the larger y.
        left_y, right_y = camera.mouth_low, camera.mouth_high
        if at_far_end:
            left_y, right_y = camera.mouth_high, camera.mouth_low
        dx, left, right = line - x, left_y - y, right_y - y
        left_f, left_r = dx * cosine + left * sine, dx * sine - left * cosine
        right_f, right_r = dx * cosine + right * sine, dx * sine - right * cosine
        left_reach = edge * (left_f * camera.cos_tilt + deepest)
        right_reach = edge * (right_f * camera.cos_tilt + deepest)
        if (left_r > left_reach and right_r > right_reach) or (left_r < -left_reach and right_r < -right_reach):
            continue  # both posts lie beyond the same edge of the image
        first, count = goal_words(camera, left_f, left_r, right_f, right_r, words)
        if count > 0:
            _show(retina, thing, first, count)
            areas[thing] = _collect(words, occupied, first, count, True, features[thing])
            features[thing, 10] = areas[thing]


@inlined
def _object_of(body: int, robot: int, ball: int) -> int:
    """Return the object number of a body, as ``robot`` counts them."""
    if body == ball:
        return BALL
    return ROBOTS + body - (1 if body > robot else 0)


@entry
def see(
    camera: CameraParams,
    state: NDArray[np.float64],
    robot: int,
    side: int,
    retina: Retina,
    features: NDArray[np.float64],
    areas: NDArray[np.float64],
) -> None:
    """Call ``look`` from Python."""
    look(camera, state, robot, side, retina, features, areas)
