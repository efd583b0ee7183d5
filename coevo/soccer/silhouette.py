"""What one object covers of the image where nothing hides it: a word of rows for each column, in closed form.

For the ball (a sphere) from the cone that touches it, for a robot (an upright cylinder) as the hull of the images of
its two rims and the two upright lines that touch both, for a goal (the rectangle of its mouth) from the planes through
its edges. Each function fills ``words`` from the object's first column on, and returns that column and their number.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import inlined
from coevo.soccer.optics import CameraParams, whole_blocks

__all__ = ["ball_words", "goal_words", "robot_words"]

_NEAR = 1e-6
_NOWHERE = (0, 0)  # an empty range of columns
_LEVEL = 1e-4  # metres: a rim nearer than this to the height of the camera is moved by as much


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


class _Side(NamedTuple):
    """An upright line in the image: lowest and highest column, and its row as height + slope * column."""

    low: float
    high: float
    height: float
    slope: float


@inlined
def _rows_between(camera: CameraParams, low: float, high: float) -> np.uint64:
    """Return the word of the rows whose centres lie in [low, high] (in focal lengths, downwards)."""
    half, bottom = 0.5 * camera.rows - 0.5, camera.rows - 1.0
    top = math.ceil(min(max(low * camera.fy + half, 0.0), 64.0))
    foot = math.floor(min(max(high * camera.fy + half, -1.0), bottom))
    rows = max(foot - top + 1.0, 0.0)
    # Two shifts, since a shift by 64 is undefined.
    ones = np.uint64(0xFFFFFFFFFFFFFFFF)
    word = (ones >> np.uint64(np.int32(63.0 - max(rows - 1.0, 0.0)))) << np.uint64(np.int32(min(top, 63.0)))
    return word if rows > 0.0 else np.uint64(0)


@inlined
def _column_range(camera: CameraParams, low: float, high: float) -> tuple[int, int]:
    """Return the first column whose centre lies in [low, high] (focal lengths, rightwards), and how many do."""
    half = 0.5 * camera.columns - 0.5
    first = max(math.ceil(max(low, -9.0) * camera.fx + half), 0.0)
    last = min(math.floor(min(high, 9.0) * camera.fx + half), camera.columns - 1.0)
    return int(first), max(int(last) - int(first) + 1, 0)


@inlined
def ball_words(
    camera: CameraParams,
    forward: float,
    right: float,
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
    for k in range(whole_blocks(count)):
        a = (start + k) * per_column
        ahead = a * x + z
        linear = y * ahead
        under = linear * linear - quadratic * (ahead * ahead - cone * (a * a + 1.0))
        root = math.sqrt(max(under, 0.0))
        low = (linear - root) * scale if under >= 0.0 else 9.0
        word = _rows_between(camera, low, (linear + root) * scale)
        words[k] = word if k < count else np.uint64(0)
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
def robot_words(
    camera: CameraParams,
    forward: float,
    right: float,
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
    tangent = math.sqrt(distance2 - square)
    ahead, aside = tangent * tangent / distance2, tangent * radius / distance2
    f, r, df, dr = ahead * forward, ahead * right, aside * right, aside * forward
    one = _make_side(camera, f + df, r - dr, floor.drop, top.drop)
    other = _make_side(camera, f - df, r + dr, floor.drop, top.drop)
    floor_scale, top_scale = 1.0 / floor.leading, 1.0 / top.leading
    start, per_column = first - 0.5 * camera.columns + 0.5, 1.0 / camera.fx
    for k in range(whole_blocks(count)):
        a = (start + k) * per_column
        low, high = _rows_of_rim(camera, floor, floor_scale, a, 9.0, -9.0)
        low, high = _rows_of_rim(camera, top, top_scale, a, low, high)
        low, high = _row_of_side(one, a, low, high)
        low, high = _row_of_side(other, a, low, high)
        word = _rows_between(camera, low, high)
        words[k] = word if k < count else np.uint64(0)
    return first, count


@inlined
def _rows_of_rim(
    camera: CameraParams, rim: _Rim, scale: float, a: float, low: float, high: float
) -> tuple[float, float]:
    """Widen the interval of column ``a`` by what a rim covers of it; ``scale``: 1 / rim.leading."""
    b0 = a * rim.drop - rim.shift
    linear = rim.k1 + b0 * rim.b1
    under = linear * linear - rim.leading * (rim.k2 + b0 * b0)
    root = math.sqrt(max(under, 0.0))
    from_b, to_b = (-root - linear) * scale, (root - linear) * scale
    if rim.leading < 0.0:  # the rim reaches behind the camera, and its image to infinity
        from_b, to_b = (from_b, 9.0) if rim.drop > 0.0 else (-9.0, to_b)
    # The other half of the double cone of rays through the rim lies behind the camera.
    seen = under >= 0.0 and rim.drop * (camera.sin_tilt + (from_b if rim.drop > 0.0 else to_b) * camera.cos_tilt) > 0.0
    return min(low, from_b if seen else 9.0), max(high, to_b if seen else -9.0)


@inlined
def _make_side(camera: CameraParams, forward: float, right: float, floor_drop: float, top_drop: float) -> _Side:
    """Return the image of the upright line at (forward, right)."""
    lean = right * camera.sin_tilt
    depth_floor = forward * camera.cos_tilt + floor_drop * camera.sin_tilt
    depth_top = forward * camera.cos_tilt + top_drop * camera.sin_tilt
    if max(depth_floor, depth_top) <= _NEAR or abs(lean) < _NEAR:
        return _Side(math.inf, -math.inf, 0.0, 0.0)
    one, two = right / max(depth_floor, depth_top), right / max(min(depth_floor, depth_top), _NEAR)
    return _Side(min(one, two), max(one, two), right * camera.cos_tilt / lean, -forward / lean)


@inlined
def _row_of_side(side: _Side, a: float, low: float, high: float) -> tuple[float, float]:
    """Widen the interval of column ``a`` by an upright line."""
    b = side.height + side.slope * a
    seen = side.low <= a <= side.high
    return min(low, b if seen else 9.0), max(high, b if seen else -9.0)


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
def goal_words(
    camera: CameraParams,
    forward_a: float,
    right_a: float,
    forward_b: float,
    right_b: float,
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
    for k in range(whole_blocks(count)):
        a = (start + k) * per_column
        low = max(left[0] + left[1] * a, right[0] + right[1] * a)
        high = min(left[2] + left[3] * a, right[2] + right[3] * a)
        low = max(low, over[0] + over[1] * a, under[0] + under[1] * a)
        high = min(high, over[2] + over[3] * a, under[2] + under[3] * a)
        word = _rows_between(camera, low, high)
        words[k] = word if k < count else np.uint64(0)
    return first, count


@inlined
def _level_bounds(
    fa: float, ra: float, fb: float, rb: float, drop: float, sine: float, cosine: float, side: float
) -> tuple[float, float, float, float]:
    """Return the half-plane below (side 1) or above (side -1) the image of a level edge, as ``_bounds``."""
    # Normal = a x b of the edge's ends (f, r, drop); its downward part is the positive fa rb - ra fb.
    nf, nr, nd = (ra - rb) * drop, (fb - fa) * drop, fa * rb - ra * fb
    return _bounds(side * (nf * cosine + nd * sine), side * nr, side * (nd * cosine - nf * sine))
