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

from coevo.compiled import entry, helper
from coevo.config import WorldSettings

__all__ = [
    "BALL",
    "BALL_FEATURES",
    "FEATURES",
    "GOAL_FEATURES",
    "OPPONENT_GOAL",
    "OWN_GOAL",
    "ROBOT_FEATURES",
    "ROBOTS",
    "CameraParams",
    "camera_params",
    "look",
    "object_count",
    "see",
]

BALL, OWN_GOAL, OPPONENT_GOAL, ROBOTS = 0, 1, 2, 3  # order of objects; the other robots follow in their order
BALL_FEATURES, GOAL_FEATURES, ROBOT_FEATURES, FEATURES = 4, 11, 5, 11
_NEAR = 1e-6


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


def object_count(robots: int) -> int:
    """Return how many objects each robot may see: the ball, two goals and every other robot."""
    return ROBOTS + robots - 1


@intrinsic  # type: ignore[misc]  # numba's decorators carry no types
def _trailing_zeros(_typing: Any, word: Any) -> Any:
    """Count the zeros below the lowest set bit of a non-zero 64-bit word."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.uint64(types.uint64), generate


@helper
def _rows(camera: CameraParams, low: float, high: float) -> np.uint64:
    """Return the word of the rows whose centres lie in [low, high] (in units of the focal length, downwards)."""
    half = 0.5 * camera.rows - 0.5
    top = max(math.ceil(max(low, -4.0) * camera.fy + half), 0.0)
    bottom = min(math.floor(min(high, 4.0) * camera.fy + half), camera.rows - 1.0)
    if top > bottom:
        return np.uint64(0)
    ones = np.uint64(0xFFFFFFFFFFFFFFFF)
    return (ones >> np.uint64(63 - int(bottom - top))) << np.uint64(int(top))


@helper
def _column_range(camera: CameraParams, low: float, high: float) -> tuple[int, int]:
    """Return first and last-plus-one of the columns whose centres lie in [low, high] (focal lengths, rightwards)."""
    half = 0.5 * camera.columns - 0.5
    first = max(math.ceil(max(low, -9.0) * camera.fx + half), 0.0)
    last = min(math.floor(min(high, 9.0) * camera.fx + half), camera.columns - 1.0)
    return int(first), int(last) + 1


@helper
def _collect(
    masks: NDArray[np.uint64],
    occupied: NDArray[np.uint64],
    first: int,
    last: int,
    corners: bool,
    out: NDArray[np.float64],
) -> float:
    """Take the visible part of an object, mark it occupied, measure it; return its area (0: not visible).

    ``out``: (11,) features; for a goal as documented, else x, y, width, height.
    """
    area, sum_x, sum_y = 0, 0.0, 0.0
    left, right, top, bottom = last, -1, 64, -1
    upper_left, upper_right, lower_left, lower_right = 999, -999, 999, -999
    for c in range(first, last):
        word = masks[c] & ~occupied[c]
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


@helper
def _ball_masks(camera: CameraParams, forward: float, right: float, masks: NDArray[np.uint64]) -> tuple[int, int]:
    """Fill the column words of the ball; return the range of columns (empty if it is out of view)."""
    down = camera.height - camera.ball_radius
    x = right
    y = down * camera.cos_tilt - forward * camera.sin_tilt
    z = forward * camera.cos_tilt + down * camera.sin_tilt
    square = camera.ball_radius * camera.ball_radius
    if z <= camera.ball_radius:
        return 0, 0
    # The planes of image columns that touch the sphere.
    spread = camera.ball_radius * math.sqrt(x * x + z * z - square)
    first, last = _column_range(camera, (x * z - spread) / (z * z - square), (x * z + spread) / (z * z - square))
    # A ray (a, b, 1) hits where (p.d)^2 >= |d|^2 (|p|^2 - R^2): a quadratic in b for each column a.
    cone = x * x + y * y + z * z - square
    quadratic = y * y - cone
    for c in range(first, last):
        a = (c + 0.5 - 0.5 * camera.columns) / camera.fx
        ahead = a * x + z
        linear = y * ahead
        under = linear * linear - quadratic * (ahead * ahead - cone * (a * a + 1.0))
        if under < 0.0:
            masks[c] = np.uint64(0)
            continue
        root = math.sqrt(under)
        masks[c] = _rows(camera, (linear - root) / -quadratic, (linear + root) / -quadratic)
    return first, last


@helper
def _rim_range(
    camera: CameraParams, forward: float, right: float, drop: float, square: float
) -> tuple[float, float, float]:
    """Return the lowest and highest column position of a rim (a horizontal circle), and its leading coefficient."""
    sine, cosine = camera.sin_tilt, camera.cos_tilt
    a0, a1 = cosine * drop - forward * sine, -sine * drop - forward * cosine
    b1 = -right * cosine
    leading = a1 * a1 + b1 * b1 - square * cosine * cosine
    k1 = a0 * a1 - square * sine * cosine
    k2 = a0 * a0 - square * sine * sine
    # The discriminant of the rim's quadratic is itself a quadratic in b0 = drop * a - right * sine.
    q2, q1, q0 = b1 * b1 - leading, k1 * b1, k1 * k1 - leading * k2
    under = q1 * q1 - q2 * q0
    if under < 0.0 or abs(q2) < _NEAR or abs(drop) < _NEAR:
        return math.inf, -math.inf, leading
    root = math.sqrt(under)
    one = ((-q1 - root) / q2 + right * sine) / drop
    two = ((-q1 + root) / q2 + right * sine) / drop
    return min(one, two), max(one, two), leading


@helper
def _rim_roots(
    camera: CameraParams, forward: float, right: float, drop: float, square: float, leading: float, a: float
) -> tuple[bool, float, float]:
    """Return whether column ``a`` crosses a rim, and between which heights in the image."""
    sine, cosine = camera.sin_tilt, camera.cos_tilt
    a0, a1 = cosine * drop - forward * sine, -sine * drop - forward * cosine
    b0, b1 = a * drop - right * sine, -right * cosine
    linear = a0 * a1 + b0 * b1 - square * sine * cosine
    constant = a0 * a0 + b0 * b0 - square * sine * sine
    under = linear * linear - leading * constant
    if under < 0.0:
        return False, 0.0, 0.0
    root = math.sqrt(under)
    return True, (-linear - root) / leading, (-linear + root) / leading


@helper
def _robot_masks(camera: CameraParams, forward: float, right: float, masks: NDArray[np.uint64]) -> tuple[int, int]:
    """Fill the column words of another robot; return the range of columns (empty if it is out of view)."""
    radius, sine, cosine = camera.robot_radius, camera.sin_tilt, camera.cos_tilt
    square = radius * radius
    distance2 = forward * forward + right * right
    if forward <= -radius or distance2 <= square:
        return 0, 0
    floor_drop, top_drop = camera.height, camera.height - camera.robot_height
    low_a, low_b, floor_leading = _rim_range(camera, forward, right, floor_drop, square)
    top_a, top_b, top_leading = _rim_range(camera, forward, right, top_drop, square)
    if floor_leading <= _NEAR or top_leading <= _NEAR:
        return 0, 0
    first, last = _column_range(camera, min(low_a, top_a), max(low_b, top_b))
    if first >= last:
        return 0, 0
    # Directions (forward, right) of the vertical planes that touch the cylinder left and right.
    tangent = math.sqrt(distance2 - square)
    left_f, left_r = (forward * tangent + right * radius) / distance2, (right * tangent - forward * radius) / distance2
    right_f, right_r = (forward * tangent - right * radius) / distance2, (right * tangent + forward * radius) / distance2
    for c in range(first, last):
        a = (c + 0.5 - 0.5 * camera.columns) / camera.fx
        low, high = -4.0, 4.0
        slope, offset = left_r * sine, left_r * cosine - left_f * a  # slope * b >= offset
        if slope > _NEAR:
            low = max(low, offset / slope)
        elif slope < -_NEAR:
            high = min(high, offset / slope)
        elif offset > 0.0:
            high = -5.0
        slope, offset = -right_r * sine, right_f * a - right_r * cosine
        if slope > _NEAR:
            low = max(low, offset / slope)
        elif slope < -_NEAR:
            high = min(high, offset / slope)
        elif offset > 0.0:
            high = -5.0
        on_floor, _, floor_near = _rim_roots(camera, forward, right, floor_drop, square, floor_leading, a)
        on_top, top_far, _ = _rim_roots(camera, forward, right, top_drop, square, top_leading, a)
        if on_floor:
            high = min(high, floor_near)
        if on_top:
            low = max(low, top_far)
        if low <= high and not (on_floor and on_top):
            # The column misses a rim: its rays pass the cylinder on one side of it, all or none.
            b = 0.5 * (low + high)
            if not _hits_cylinder(camera, forward, right, a, b):
                high = low - 1.0
        masks[c] = _rows(camera, low, high)
    return first, last


@helper
def _hits_cylinder(camera: CameraParams, forward: float, right: float, a: float, b: float) -> bool:
    """Tell whether the ray (a, b) meets the cylinder between floor and top."""
    ray_f, ray_d = camera.cos_tilt - b * camera.sin_tilt, camera.sin_tilt + b * camera.cos_tilt
    square = ray_f * ray_f + a * a
    along = ray_f * forward + a * right
    under = along * along - square * (forward * forward + right * right - camera.robot_radius * camera.robot_radius)
    if under < 0.0 or along <= 0.0:
        return False
    root = math.sqrt(under)
    near = camera.height - ray_d * (along - root) / square
    far = camera.height - ray_d * (along + root) / square
    return min(near, far) <= camera.robot_height and max(near, far) >= 0.0 and near >= 0.0


@helper
def _goal_masks(
    camera: CameraParams,
    forward_a: float,
    right_a: float,
    forward_b: float,
    right_b: float,
    masks: NDArray[np.uint64],
) -> tuple[int, int]:
    """Fill the column words of a goal mouth whose left post is a and right post is b, as the camera sees them."""
    sine, cosine = camera.sin_tilt, camera.cos_tilt
    floor, top = camera.height, camera.height - camera.goal_height
    low, high = math.inf, -math.inf
    behind = 0
    for k in range(4):
        f, r, d = (forward_a if k < 2 else forward_b), (right_a if k < 2 else right_b), (floor if k % 2 == 0 else top)
        z = f * cosine + d * sine
        if z <= _NEAR:
            behind += 1
        else:
            low, high = min(low, r / z), max(high, r / z)
    if behind == 4:
        return 0, 0
    if behind > 0:
        low, high = -9.0, 9.0
    first, last = _column_range(camera, low, high)
    if first >= last:
        return 0, 0
    # Planes through the camera and the edges: left post, top, right post, foot. e0 + e1 a + e2 b >= 0 inside.
    left0, left1, left2 = _post_plane(forward_a, right_a, sine, cosine, 1.0)
    right0, right1, right2 = _post_plane(forward_b, right_b, sine, cosine, -1.0)
    top0, top1, top2 = _level_plane(forward_a, right_a, forward_b, right_b, top, sine, cosine, 1.0)
    foot0, foot1, foot2 = _level_plane(forward_a, right_a, forward_b, right_b, floor, sine, cosine, -1.0)
    for c in range(first, last):
        a = (c + 0.5 - 0.5 * camera.columns) / camera.fx
        lo, hi = -4.0, 4.0
        lo, hi = _clip(left0 + left1 * a, left2, lo, hi)
        lo, hi = _clip(right0 + right1 * a, right2, lo, hi)
        lo, hi = _clip(top0 + top1 * a, top2, lo, hi)
        lo, hi = _clip(foot0 + foot1 * a, foot2, lo, hi)
        masks[c] = _rows(camera, lo, hi)
    return first, last


@helper
def _post_plane(f: float, r: float, sine: float, cosine: float, side: float) -> tuple[float, float, float]:
    """Return the half-space right (side 1) or left (side -1) of the vertical plane through a post."""
    return -side * r * cosine, side * f, side * r * sine


@helper
def _level_plane(
    fa: float, ra: float, fb: float, rb: float, drop: float, sine: float, cosine: float, side: float
) -> tuple[float, float, float]:
    """Return the half-space below (side 1) or above (side -1) the plane through a level edge."""
    # Normal = a x b of the edge's ends (f, r, drop); its downward part is the positive fa rb - ra fb.
    nf, nr, nd = (ra - rb) * drop, (fb - fa) * drop, fa * rb - ra * fb
    return side * (nf * cosine + nd * sine), side * nr, side * (nd * cosine - nf * sine)


@helper
def _clip(constant: float, slope: float, low: float, high: float) -> tuple[float, float]:
    """Cut the interval [low, high] to where constant + slope * b >= 0."""
    if slope > _NEAR:
        return max(low, -constant / slope), high
    if slope < -_NEAR:
        return low, min(high, -constant / slope)
    if constant < 0.0:
        return low, low - 1.0
    return low, high


@helper
def look(
    camera: CameraParams,
    state: NDArray[np.float64],
    robot: int,
    side: int,
    masks: NDArray[np.uint64],
    occupied: NDArray[np.uint64],
    features: NDArray[np.float64],
    areas: NDArray[np.float64],
) -> None:
    """Measure everything that one robot sees.

    Args:
        camera: numbers of the camera.
        state: (robots + 1, 6) state of the world.
        robot: whose camera.
        side: 0 if the robot attacks the goal at x = length, 1 if the one at x = 0.
        masks: (objects, columns) uint64, filled with what each object covers where nothing hides it; only
            the columns of visible objects are written.
        occupied: (columns,) uint64, scratch; in the end all that is covered.
        features: (objects, 11), rows of visible objects are replaced.
        areas: (objects,), area in pixels, 0 where the object is not visible.
    """
    ball = state.shape[0] - 1
    x, y = state[robot, 0], state[robot, 1]
    cosine, sine = math.cos(state[robot, 2]), math.sin(state[robot, 2])
    for c in range(camera.columns):
        occupied[c] = np.uint64(0)
    for o in range(areas.shape[0]):
        areas[o] = -1.0
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
        if forward <= -camera.robot_radius:
            continue
        if nearest == ball:
            first, last = _ball_masks(camera, forward, right, masks[thing])
        else:
            first, last = _robot_masks(camera, forward, right, masks[thing])
        if first < last:
            areas[thing] = _collect(masks[thing], occupied, first, last, False, features[thing])
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
        first, last = _goal_masks(
            camera,
            dx * cosine + left * sine,
            dx * sine - left * cosine,
            dx * cosine + right * sine,
            dx * sine - right * cosine,
            masks[thing],
        )
        if first < last:
            areas[thing] = _collect(masks[thing], occupied, first, last, True, features[thing])
            features[thing, 10] = areas[thing]


@helper
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
    masks: NDArray[np.uint64],
    features: NDArray[np.float64],
    areas: NDArray[np.float64],
) -> None:
    """Call ``look`` from Python, with ``masks`` zeroed and in the end what is visible of each object."""
    occupied = np.zeros(camera.columns, np.uint64)
    masks[:] = np.uint64(0)
    look(camera, state, robot, side, masks, occupied, features, areas)
