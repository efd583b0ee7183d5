"""The on-board camera, computed analytically: what each object covers of the image, and its features.

Sixty rows of the image fit a 64-bit word, so an object is one word a column. A ray of the column either hits the
object's convex silhouette in one interval of rows or not at all, and the interval has a closed form: for the ball
(a sphere) from the cone that touches it, for a robot (an upright cylinder) from the two vertical planes that touch
it and the images of its two rims, for a goal (the rectangle of its mouth) from the planes through its edges.
Occlusion is ``mask & ~occupied``, nearest object first.

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
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from coevo.compiled import entry, inlined
from coevo.config import WorldSettings

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
_NOWHERE = (0, 0)  # an empty range of columns
_LEVEL = 1e-4  # metres: a rim nearer than this to the height of the camera is moved by as much


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


class _Rim(NamedTuple):
    """A horizontal circle in the image: lowest and highest column, and numbers of the quadratics in column and row."""

    low: float
    high: float
    leading: float
    drop: float
    shift: float
    b1: float
    k1: float
    k2: float


class Retina(NamedTuple):
    """Room for one image.

    words: (columns,) uint64, the rows that the object under way covers, from its first column on.
    occupied: (columns,) uint64, all that is covered. lows, highs: (columns,) float64, scratch.
    """

    words: NDArray[np.uint64]
    occupied: NDArray[np.uint64]
    lows: NDArray[np.float64]
    highs: NDArray[np.float64]


def make_retina(world: WorldSettings) -> Retina:
    """Make room for the images of a camera."""
    columns = world.camera.width_px
    return Retina(
        words=np.zeros(columns, np.uint64),
        occupied=np.zeros(columns, np.uint64),
        lows=np.zeros(columns),
        highs=np.zeros(columns),
    )


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


def object_count(robots: int) -> int:
    """Return how many objects each robot may see: the ball, two goals and every other robot."""
    return ROBOTS + robots - 1


@intrinsic
def _trailing_zeros(_typing: Any, _word: Any) -> Any:
    """Count the zeros below the lowest set bit of a non-zero 64-bit word."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.uint64(types.uint64), generate


@inlined
def _fill_rows(camera: CameraParams, retina: Retina, count: int, words: NDArray[np.uint64]) -> None:
    """Set the words of columns to the rows whose centres lie in [low, high] (in focal lengths, downwards).

    Written without branches, so that LLVM computes several columns at once.
    """
    half, bottom = 0.5 * camera.rows - 0.5, camera.rows - 1.0
    ones = np.uint64(0xFFFFFFFFFFFFFFFF)
    for k in range(count):
        top = math.ceil(min(max(retina.lows[k] * camera.fy + half, 0.0), 64.0))
        foot = math.floor(min(max(retina.highs[k] * camera.fy + half, -1.0), bottom))
        rows = max(foot - top + 1.0, 0.0)
        # Two shifts, since a shift by 64 is undefined.
        word = (ones >> np.uint64(np.int32(63.0 - max(rows - 1.0, 0.0)))) << np.uint64(np.int32(min(top, 63.0)))
        words[k] = word if rows > 0.0 else np.uint64(0)


@inlined
def _column_range(camera: CameraParams, low: float, high: float) -> tuple[int, int]:
    """Return the first column whose centre lies in [low, high] (focal lengths, rightwards), and how many do."""
    half = 0.5 * camera.columns - 0.5
    first = max(math.ceil(max(low, -9.0) * camera.fx + half), 0.0)
    last = min(math.floor(min(high, 9.0) * camera.fx + half), camera.columns - 1.0)
    return int(first), max(int(last) - int(first) + 1, 0)


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

    ``out``: (11,) features; for a goal as documented, else x, y, width, height.
    """
    area, sum_x, sum_y = 0, 0.0, 0.0
    left, right, top, bottom = first + columns, -1, 64, -1
    upper_left, upper_right, lower_left, lower_right = 999, -999, 999, -999
    for k in range(columns):
        c = first + k
        word = words[k] & ~occupied[c]
        if word == np.uint64(0):
            continue
        occupied[c] |= word
        if right < 0:
            left = c
        right = c
        count, position, lowest, row_sum = 0, 0, -1, 0.0
        while word != np.uint64(0):
            gap = int(_trailing_zeros(word))
            word >>= np.uint64(gap)
            position += gap
            if lowest < 0:
                lowest = position
            run = 64
            if word != np.uint64(0xFFFFFFFFFFFFFFFF):
                run = int(_trailing_zeros(~word))
            count += run
            row_sum += run * (position + 0.5 * run)
            position += run
            word = word >> np.uint64(run) if run < 64 else np.uint64(0)
        highest = position - 1
        area += count
        sum_x += count * (c + 0.5)
        sum_y += row_sum
        top, bottom = min(top, lowest), max(bottom, highest)
        if corners:
            if c + lowest < upper_left:
                upper_left = c + lowest
                out[2], out[3] = c + 0.5, lowest + 0.5
            if c - lowest > upper_right:
                upper_right = c - lowest
                out[4], out[5] = c + 0.5, lowest + 0.5
            if c - highest < lower_left:
                lower_left = c - highest
                out[6], out[7] = c + 0.5, highest + 0.5
            if c + highest > lower_right:
                lower_right = c + highest
                out[8], out[9] = c + 0.5, highest + 0.5
    if area > 0:
        out[0], out[1] = sum_x / area, sum_y / area
        if not corners:
            out[2], out[3] = right - left + 1.0, bottom - top + 1.0
    return float(area)


@inlined
def _ball_masks(
    camera: CameraParams,
    forward: float,
    right: float,
    retina: Retina,
    words: NDArray[np.uint64],
) -> tuple[int, int]:
    """Fill the column words of the ball; return the range of columns (empty if it is out of view)."""
    down = camera.height - camera.ball_radius
    x = right
    y = down * camera.cos_tilt - forward * camera.sin_tilt
    z = forward * camera.cos_tilt + down * camera.sin_tilt
    square = camera.ball_radius * camera.ball_radius
    if z <= camera.ball_radius:
        return _NOWHERE
    # The planes of image columns that touch the sphere.
    spread = camera.ball_radius * math.sqrt(x * x + z * z - square)
    first, count = _column_range(camera, (x * z - spread) / (z * z - square), (x * z + spread) / (z * z - square))
    if count == 0:
        return _NOWHERE
    # A ray (a, b, 1) hits where (p.d)^2 >= |d|^2 (|p|^2 - R^2): a quadratic in b for each column a.
    cone = x * x + y * y + z * z - square
    quadratic = y * y - cone
    scale, per_column, start = -1.0 / quadratic, 1.0 / camera.fx, first - 0.5 * camera.columns + 0.5
    for k in range(count):
        a = (start + k) * per_column
        ahead = a * x + z
        linear = y * ahead
        under = linear * linear - quadratic * (ahead * ahead - cone * (a * a + 1.0))
        root = math.sqrt(max(under, 0.0))
        retina.lows[k] = (linear - root) * scale if under >= 0.0 else 9.0
        retina.highs[k] = (linear + root) * scale
    _fill_rows(camera, retina, count, words)
    return first, count


@inlined
def _make_rim(camera: CameraParams, forward: float, right: float, drop: float, square: float) -> _Rim:
    """Return the image of a horizontal circle as quadratics; ``drop``: how far below the camera it lies."""
    sine, cosine = camera.sin_tilt, camera.cos_tilt
    if abs(drop) < _LEVEL:
        drop = _LEVEL  # seen from its own height a rim is a line, which no quadratic describes
    a0, a1 = cosine * drop - forward * sine, -sine * drop - forward * cosine
    b1 = -right * cosine
    leading = a1 * a1 + b1 * b1 - square * cosine * cosine
    k1, k2 = a0 * a1 - square * sine * cosine, a0 * a0 - square * sine * sine
    low, high = math.inf, -math.inf
    # The discriminant in b is itself a quadratic in b0 = drop * a - shift; its roots bound the columns.
    q2, q1, q0 = b1 * b1 - leading, k1 * b1, k1 * k1 - leading * k2
    under = q1 * q1 - q2 * q0
    if under >= 0.0 and abs(q2) > _NEAR:
        root, scale = math.sqrt(under), 1.0 / (q2 * drop)
        one, two = (right * sine * q2 - q1 - root) * scale, (right * sine * q2 - q1 + root) * scale
        low, high = min(one, two), max(one, two)
    return _Rim(low, high, leading, drop, right * sine, b1, k1, k2)


@inlined
def _robot_masks(
    camera: CameraParams,
    forward: float,
    right: float,
    retina: Retina,
    words: NDArray[np.uint64],
) -> tuple[int, int]:
    """Fill the column words of another robot; return the range of columns (empty if it is out of view)."""
    radius, sine, cosine = camera.robot_radius, camera.sin_tilt, camera.cos_tilt
    square = radius * radius
    distance2 = forward * forward + right * right
    if forward <= -radius or distance2 <= square:
        return _NOWHERE
    floor = _make_rim(camera, forward, right, camera.height, square)
    top = _make_rim(camera, forward, right, camera.height - camera.robot_height, square)
    low, high = min(floor.low, top.low), max(floor.high, top.high)
    if forward * cosine + min(floor.drop * sine, top.drop * sine) <= radius * cosine:
        low, high = -9.0, 9.0  # a rim reaches behind the camera: any column may show it
    first, count = _column_range(camera, low, high)
    if count == 0:
        return _NOWHERE
    # The outline is the hull of the two rims: their arcs, and the two upright lines that touch both.
    start = first - 0.5 * camera.columns + 0.5
    for k in range(count):
        retina.lows[k], retina.highs[k] = 9.0, -9.0
    _add_rim(camera, floor, retina, start, count)
    _add_rim(camera, top, retina, start, count)
    tangent = math.sqrt(distance2 - square)
    ahead, aside = tangent * tangent / distance2, tangent * radius / distance2
    for sign in (-1.0, 1.0):
        f, r = ahead * forward - sign * aside * right, ahead * right + sign * aside * forward
        _add_side(camera, f, r, floor.drop, top.drop, retina, start, count)
    _fill_rows(camera, retina, count, words)
    return first, count


@inlined
def _add_rim(camera: CameraParams, rim: _Rim, retina: Retina, start: float, count: int) -> None:
    """Widen the interval of each column by what a rim covers of it."""
    scale, sine, cosine, per_column = 1.0 / rim.leading, camera.sin_tilt, camera.cos_tilt, 1.0 / camera.fx
    for k in range(count):
        b0 = (start + k) * per_column * rim.drop - rim.shift
        linear = rim.k1 + b0 * rim.b1
        under = linear * linear - rim.leading * (rim.k2 + b0 * b0)
        root = math.sqrt(max(under, 0.0))
        low, high = (-root - linear) * scale, (root - linear) * scale
        if rim.leading < 0.0:  # the rim reaches behind the camera, and its image to infinity
            low, high = (low, 9.0) if rim.drop > 0.0 else (-9.0, high)
        # The other half of the double cone of rays through the rim lies behind the camera.
        seen = under >= 0.0 and rim.drop * (sine + (low if rim.drop > 0.0 else high) * cosine) > 0.0
        retina.lows[k] = min(retina.lows[k], low if seen else 9.0)
        retina.highs[k] = max(retina.highs[k], high if seen else -9.0)


@inlined
def _add_side(
    camera: CameraParams,
    forward: float,
    right: float,
    floor_drop: float,
    top_drop: float,
    retina: Retina,
    start: float,
    count: int,
) -> None:
    """Widen the interval of each column by the upright line at (forward, right)."""
    lean = right * camera.sin_tilt
    depth_floor = forward * camera.cos_tilt + floor_drop * camera.sin_tilt
    depth_top = forward * camera.cos_tilt + top_drop * camera.sin_tilt
    if max(depth_floor, depth_top) <= _NEAR or abs(lean) < _NEAR:
        return
    from_a, to_a = right / max(depth_floor, depth_top), right / max(min(depth_floor, depth_top), _NEAR)
    from_a, to_a = min(from_a, to_a), max(from_a, to_a)
    height, slope, per_column = right * camera.cos_tilt / lean, -forward / lean, 1.0 / camera.fx
    for k in range(count):
        a = (start + k) * per_column
        b = height + slope * a
        seen = from_a <= a <= to_a
        retina.lows[k] = min(retina.lows[k], b if seen else 9.0)
        retina.highs[k] = max(retina.highs[k], b if seen else -9.0)


@inlined
def _bounds(constant: float, slope: float, inclination: float) -> tuple[float, float, float, float]:
    """Return the half-plane constant + slope a + inclination b >= 0 of the image as bounds of b in each column a.

    Returns low0, low1, high0, high1: low0 + low1 a <= b <= high0 + high1 a. A line that hardly leans bounds either
    nothing or all of a column.
    """
    if abs(inclination) < _NEAR:
        inclination = _NEAR
    at, lean = -constant / inclination, -slope / inclination
    if inclination > 0.0:
        return at, lean, 9.0, 0.0
    return -9.0, 0.0, at, lean


@inlined
def _goal_masks(
    camera: CameraParams,
    forward_a: float,
    right_a: float,
    forward_b: float,
    right_b: float,
    retina: Retina,
    words: NDArray[np.uint64],
) -> tuple[int, int]:
    """Fill the column words of a goal mouth whose left post is a and right post is b, as the camera sees them."""
    sine, cosine = camera.sin_tilt, camera.cos_tilt
    floor, top = camera.height, camera.height - camera.goal_height
    low, high = math.inf, -math.inf
    behind = 0
    for k in range(4):
        f, r, d = (
            (forward_a if k < 2 else forward_b),
            (right_a if k < 2 else right_b),
            (floor if k % 2 == 0 else top),
        )
        z = f * cosine + d * sine
        if z <= _NEAR:
            behind += 1
        else:
            low, high = min(low, r / z), max(high, r / z)
    if behind == 4:
        return _NOWHERE
    if behind > 0:
        low, high = -9.0, 9.0
    first, count = _column_range(camera, low, high)
    if count == 0:
        return _NOWHERE
    # Planes through the camera and the edges: left post, right post, top, foot.
    left = _bounds(-right_a * cosine, forward_a, right_a * sine)
    right = _bounds(right_b * cosine, -forward_b, -right_b * sine)
    over = _level_bounds(forward_a, right_a, forward_b, right_b, top, sine, cosine, 1.0)
    under = _level_bounds(forward_a, right_a, forward_b, right_b, floor, sine, cosine, -1.0)
    per_column, start = 1.0 / camera.fx, first - 0.5 * camera.columns + 0.5
    for k in range(count):
        a = (start + k) * per_column
        low = max(left[0] + left[1] * a, right[0] + right[1] * a)
        high = min(left[2] + left[3] * a, right[2] + right[3] * a)
        retina.lows[k] = max(low, over[0] + over[1] * a, under[0] + under[1] * a)
        retina.highs[k] = min(high, over[2] + over[3] * a, under[2] + under[3] * a)
    _fill_rows(camera, retina, count, words)
    return first, count


@inlined
def _level_bounds(
    fa: float, ra: float, fb: float, rb: float, drop: float, sine: float, cosine: float, side: float
) -> tuple[float, float, float, float]:
    """Return the half-plane below (side 1) or above (side -1) the image of a level edge, as ``_bounds``."""
    # Normal = a x b of the edge's ends (f, r, drop); its downward part is the positive fa rb - ra fb.
    nf, nr, nd = (ra - rb) * drop, (fb - fa) * drop, fa * rb - ra * fb
    return _bounds(side * (nf * cosine + nd * sine), side * nr, side * (nd * cosine - nf * sine))


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
            first, count = _ball_masks(camera, forward, right, retina, words)
        else:
            first, count = _robot_masks(camera, forward, right, retina, words)
        if count > 0:
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
        first, count = _goal_masks(camera, left_f, left_r, right_f, right_r, retina, words)
        if count > 0:
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
