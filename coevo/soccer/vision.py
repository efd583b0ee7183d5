"""The on-board camera through OpenCV: paint what a robot sees, and find objects by their colour.

``coevo.soccer.camera`` computes the same features without an image, and is what games use. This path shows a
person what a robot sees, at any size, and is the way in for camera frames: ``extract`` needs only an image.

A pixel shows what the ray through its centre hits. OpenCV's fills paint the outline of a polygon too, and so
make everything half a pixel larger all round. ``render`` shrinks each polygon by that much, paints an image
``supersample`` times finer, where corners and roundings matter less, and keeps the middle of each block.

Colours are told apart by hue alone (OpenCV's, 0 to 179, steps of 2 degrees), within ``HUE_TOLERANCE`` of:
    ball: red, 0
    goals: blue, 120, at x = 0, and yellow, 30, at x = length
    robots r0 to r5: cyan 90, magenta 150, orange 15, violet 135, azure 105, rose 165
The floor is green, 60; walls and what lies behind them are too pale to have a hue (``_MIN_SATURATION``).
"""

from __future__ import annotations

import colorsys
import math
from typing import TYPE_CHECKING, cast

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from coevo.errors import InputError
from coevo.soccer import camera as analytic

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from coevo.config import WorldSettings

__all__ = ["BALL_HUE", "GOAL_HUES", "HUE_TOLERANCE", "ROBOT_HUES", "colour_regions", "extract", "render"]

BALL_HUE = 0
GOAL_HUES = (120, 30)  # at x = 0, at x = length
ROBOT_HUES = (90, 150, 15, 135, 105, 165)  # of r0, r1, ...
HUE_TOLERANCE = 7  # neighbouring hues are 15 apart
_MIN_SATURATION, _MIN_VALUE = 100, 80  # of 255: paler or darker pixels belong to no object

Image = NDArray[np.uint8]
_Colour = tuple[float, float, float]  # blue, green, red
_HALF_TURN = 90  # of OpenCV's hue
_SATURATION, _BRIGHT, _SHADED = 225, 235, 200
_BACKGROUND: _Colour = (205, 190, 180)
_ALONG, _ACROSS, _PANEL = (250, 250, 250), (235, 235, 235), (242, 242, 242)  # walls differ where they meet
_WALL_HEIGHT_M = 0.5  # no setting, as walls have no features
_HALF_OUTLINE = 48  # points of half a circle
_SHIFT = 6  # bits after the point of OpenCV's coordinates
_TINY = 1e-3  # pixels, or radians: two points or two directions that are one


def _paint(hue: int, value: int) -> _Colour:
    red, green, blue = colorsys.hsv_to_rgb(0.5 * hue / _HALF_TURN, _SATURATION / 255.0, value)
    return round(blue), round(green), round(red)


class _Canvas:
    """An image, and the way to its pixels from places on the field."""

    def __init__(self, camera: analytic.CameraParams, width: int, height: int, pose: Sequence[float]) -> None:
        self.image = np.full((height, width, 3), _BACKGROUND, np.uint8)
        self.camera = camera
        self.x, self.y, self._heading = pose
        self._focal = np.array([camera.fx * width / camera.columns, camera.fy * height / camera.rows])
        self._centre = 0.5 * np.array([width - 1, height - 1])  # OpenCV counts from pixel centres
        # The four planes through the camera that bound the view, with some margin. Inside all, ahead > 0.
        right, down = (self._centre + 4.0) / self._focal
        self._bounds = np.array([[1, 0, right], [-1, 0, right], [0, 1, down], [0, -1, down]])

    def rays(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (points, 3) right, down and ahead of the camera; ``points``: (points, 3) x, y, height."""
        x, y, z = np.asarray(points, np.float64).T
        cosine, sine = math.cos(self._heading), math.sin(self._heading)
        forward = (x - self.x) * cosine + (y - self.y) * sine
        right = (x - self.x) * sine - (y - self.y) * cosine
        below = self.camera.height - z
        down = below * self.camera.cos_tilt - forward * self.camera.sin_tilt
        ahead = forward * self.camera.cos_tilt + below * self.camera.sin_tilt
        return np.stack([right, down, ahead], axis=1)

    def fill(self, rays: NDArray[np.float64], colour: _Colour) -> None:
        """Paint what lies within a convex outline, given in order."""
        for bound in self._bounds:
            inside = rays @ bound
            if (inside < 0.0).all():
                return
            if (inside < 0.0).any():
                rays = _cut(rays, inside)
        points = _shrink(rays[:, :2] / rays[:, 2:] * self._focal + self._centre)
        if len(points) > 0:
            fixed = np.rint(points * (1 << _SHIFT)).astype(np.int32)
            cv2.fillConvexPoly(self.image, fixed, colour, cv2.LINE_8, _SHIFT)


def _cut(rays: NDArray[np.float64], inside: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cut an outline off where ``inside``, linear in the rays, is negative (Sutherland and Hodgman)."""
    kept = inside >= 0.0
    before, inside_before = np.roll(rays, 1, axis=0), np.roll(inside, 1)
    crossed = kept != np.roll(kept, 1)
    share = inside_before / np.where(crossed, inside_before - inside, 1.0)
    pairs = np.stack([before + share[:, None] * (rays - before), rays], axis=1)
    return cast("NDArray[np.float64]", pairs[np.stack([crossed, kept], axis=1)])


def _shrink(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Move each side of a convex polygon inwards by what OpenCV's outline adds: half a pixel along x or y."""
    place = points[:, 0] + 1j * points[:, 1]
    place = place[np.abs(np.roll(place, -1) - place) > _TINY]
    if len(place) < 2:
        return np.empty((0, 2))  # all of it lies in one point
    following = np.roll(place, -1)
    area, sides = np.vdot(place, following).imag, following - place
    inwards = 1j * np.sign(area) * sides / np.abs(sides)
    step = 0.5 * np.maximum(np.abs(inwards.real), np.abs(inwards.imag))
    inwards_before, step_before = np.roll(inwards, 1), np.roll(step, 1)
    # A corner moves to where its two sides, moved, meet.
    sine = (inwards_before.conj() * inwards).imag
    straight = np.abs(sine) < _TINY
    corner = 1j * (step * inwards_before - step_before * inwards) / np.where(straight, 1.0, sine)
    moved = place + np.where(straight, step * inwards, corner)
    if np.vdot(moved, np.roll(moved, -1)).imag * area <= 0.0:
        moved = place  # too small to shrink
    return np.stack([moved.real, moved.imag], axis=1)


def _paint_field(canvas: _Canvas, world: WorldSettings) -> None:
    """Paint the floor, then walls and goals; from inside, none of them hides another."""
    field, camera = world.field, canvas.camera
    length, width, low, high = field.length_m, field.width_m, camera.mouth_low, camera.mouth_high
    out, cut = field.goal_depth_m, field.corner_panel_m if field.corner_panels else 0.0
    floor = [(-out, 0, 0), (length + out, 0, 0), (length + out, width, 0), (-out, width, 0)]
    canvas.fill(canvas.rays(floor), _paint(60, 150))
    blue, yellow = (_paint(hue, _BRIGHT) for hue in GOAL_HUES)
    plan: list[tuple[float, float, _Colour]] = [  # counter-clockwise, each from where the one before ends
        (length - cut, 0.0, _ALONG),
        (length, cut, _PANEL),
        (length, low, _ACROSS),
        (length, high, yellow),
        (length, width - cut, _ACROSS),
        (length - cut, width, _PANEL),
    ]
    plan += [(length - x, width - y, blue if colour == yellow else colour) for x, y, colour in plan]
    for k, (x, y, colour) in enumerate(plan):
        from_x, from_y, _ = plan[k - 1]
        if (x - from_x) * (canvas.y - from_y) > (y - from_y) * (canvas.x - from_x):  # seen from inside
            top = camera.goal_height if colour in (blue, yellow) else _WALL_HEIGHT_M
            corners = [(from_x, from_y, 0.0), (x, y, 0.0), (x, y, top), (from_x, from_y, top)]
            canvas.fill(canvas.rays(corners), colour)


def _paint_ball(canvas: _Canvas, x: float, y: float) -> None:
    """Paint a sphere: the outline of what one sees is the circle where rays touch it."""
    radius = canvas.camera.ball_radius
    (centre,) = canvas.rays([(x, y, radius)])
    share = 1.0 - radius**2 / (centre @ centre)
    if share > 0.0:
        across, over = np.linalg.svd(centre[None])[2][1:]  # at right angles to it and to each other
        angles = np.linspace(0.0, 2.0 * math.pi, 2 * _HALF_OUTLINE, endpoint=False)[:, None]
        around = np.cos(angles) * across + np.sin(angles) * over
        canvas.fill(share * centre + radius * math.sqrt(share) * around, _paint(BALL_HUE, _BRIGHT))


def _paint_robot(canvas: _Canvas, hue: int, x: float, y: float) -> None:
    """Paint a cylinder: its outline, then its top if that can be seen."""
    camera = canvas.camera
    distance = math.hypot(x - canvas.x, y - canvas.y)
    if distance <= camera.robot_radius:
        return
    facing, half = math.atan2(canvas.y - y, canvas.x - x), math.acos(camera.robot_radius / distance)
    top, above = camera.robot_height, camera.height > camera.robot_height

    def rim(start: float, end: float, height: float) -> NDArray[np.float64]:
        angles = facing + np.linspace(start, end, _HALF_OUTLINE)
        across, along = x + camera.robot_radius * np.cos(angles), y + camera.robot_radius * np.sin(angles)
        return canvas.rays(np.stack([across, along, np.full(_HALF_OUTLINE, height)], axis=1))

    back = rim(half, 2.0 * math.pi - half if above else -half, top)
    canvas.fill(np.concatenate([rim(-half, half, 0.0), back]), _paint(hue, _SHADED))
    if above:
        canvas.fill(rim(0.0, 2.0 * math.pi, top), _paint(hue, _BRIGHT))


def _check(robots: int, robot: int) -> None:
    if not 0 <= robot < robots <= len(ROBOT_HUES):
        raise InputError(f"expected a robot of 1 to {len(ROBOT_HUES)}, got number {robot} of {robots}")


def render(
    world: WorldSettings,
    state: ArrayLike,
    robot: int,
    *,
    size_px: tuple[int, int] | None = None,
    supersample: int = 5,
    smooth: bool = False,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
) -> Image:
    """Paint what a robot sees, whichever side it is on: (height, width, 3) uint8, blue, green, red.

    Args:
        world: sizes, and the camera.
        state: (robots + 1, 6) state of the world, robots in order, then the ball.
        robot: whose camera.
        size_px: width and height of the image, if not the camera's; the view stays the same.
        supersample: odd; how many times finer the image is painted.
        smooth: average each block, for a person to look at; mixed colours mislead ``extract``.
        noise: standard deviation of each channel [grey levels of 255].
        rng: where the noise comes from.

    Raises:
        InputError: a shape, a size or the number of a robot makes no sense.
    """
    bodies, camera = np.asarray(state, np.float64), analytic.camera_params(world)
    if bodies.shape[1:] != (6,):
        raise InputError(f"expected a state (robots + 1, 6), got shape {bodies.shape}")
    robots = len(bodies) - 1
    _check(robots, robot)
    width, height = size_px or (camera.columns, camera.rows)
    if min(width, height, supersample) < 1 or supersample % 2 == 0:
        raise InputError(f"expected positive sizes, supersample odd; got {size_px} and {supersample}")
    canvas = _Canvas(camera, supersample * width, supersample * height, bodies[robot, :3].tolist())
    _paint_field(canvas, world)
    radii = np.append(np.full(robots, camera.robot_radius), camera.ball_radius)
    power = (bodies[:, 0] - canvas.x) ** 2 + (bodies[:, 1] - canvas.y) ** 2 - radii**2
    for body in np.argsort(-power).tolist():  # discs that do not overlap hide each other in this order
        if body == robots:
            _paint_ball(canvas, *bodies[body, :2])
        elif body != robot:
            _paint_robot(canvas, ROBOT_HUES[body], *bodies[body, :2])
    choice = cv2.INTER_AREA if smooth else cv2.INTER_NEAREST_EXACT  # all of a block, or the middle one
    image = cast("Image", cv2.resize(canvas.image, (width, height), interpolation=choice))
    if noise > 0.0:
        shaken = image + (rng or np.random.default_rng()).normal(0.0, noise, image.shape)
        image = np.clip(np.rint(shaken), 0, 255).astype(np.uint8)
    return image


def colour_regions(image: Image, hues: Iterable[int], *, min_region_px: float = 1.0) -> NDArray[np.bool_]:
    """Return (hues, height, width) bool: where an image (height, width, 3) BGR has each hue.

    Connected regions of fewer than ``min_region_px`` pixels are taken for noise and left out.
    """
    if image.shape[2:] != (3,) or image.dtype != np.uint8:
        raise InputError(f"expected a BGR image (height, width, 3) uint8, got {image.shape} {image.dtype}")
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    least = (_HALF_TURN - HUE_TOLERANCE, _MIN_SATURATION, _MIN_VALUE)
    most = (_HALF_TURN + HUE_TOLERANCE, 255, 255)
    found = []
    for hue in hues:
        turned = hsv.copy()  # hue is a circle: turn this one to the middle of its range
        turned[..., 0] = (hsv[..., 0].astype(np.int16) + _HALF_TURN - hue) % (2 * _HALF_TURN)
        mask = cv2.inRange(turned, least, most)
        region = mask > 0
        if min_region_px > 1.0:
            _, labels, statistics, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
            region &= (statistics[:, cv2.CC_STAT_AREA] >= min_region_px)[labels]
        found.append(region)
    return np.array(found)


def extract(
    image: Image, world: WorldSettings, robots: int, robot: int, side: int, *, min_region_px: float = 1.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Measure objects by their colour; objects and features are those of ``coevo.soccer.camera``.

    No pixel is mistaken at 5 grey levels of noise; at 10 single ones are, and at 15 many: ``min_region_px``
    of 3 or 5 leaves hardly a phantom, and loses objects smaller than that.

    Args:
        image: (height, width, 3) uint8 BGR, of any size.
        world: its camera's pixels are the units of features, areas and ``min_region_px``.
        robots: how many there are.
        robot: whose camera it is; it does not see itself.
        side: 0 if the robot attacks the yellow goal at x = length, 1 if the blue one at x = 0.
        min_region_px: connected regions smaller than this are noise.

    Returns:
        features (objects, 11) and areas (objects,), both zero where an object is not visible.
    """
    _check(robots, robot)
    goals = GOAL_HUES if side == 0 else GOAL_HUES[::-1]
    hues = [BALL_HUE, *goals, *(ROBOT_HUES[body] for body in range(robots) if body != robot)]
    unit_x, unit_y = world.camera.width_px / image.shape[1], world.camera.height_px / image.shape[0]
    regions = colour_regions(image, hues, min_region_px=min_region_px / (unit_x * unit_y))
    features, areas = np.zeros((len(hues), analytic.FEATURES)), np.zeros(len(hues))
    for thing in np.flatnonzero(regions.any(axis=(1, 2))):
        column, row = np.nonzero(regions[thing].T)  # from left to right
        x, y, out = (column + 0.5) * unit_x, (row + 0.5) * unit_y, features[thing]
        areas[thing] = area = len(x) * unit_x * unit_y
        across, upright = np.ptp(x) + unit_x, np.ptp(y) + unit_y
        out[:2] = x.mean(), y.mean()
        if thing == analytic.BALL:
            out[2:4] = 0.25 * (across + upright), area
        elif thing >= analytic.ROBOTS:
            out[2:5] = across, upright, area
        else:
            for k, distance in enumerate((x + y, y - x, x - y, -x - y)):
                corner = distance.round(9).argmin()  # of equals the leftmost
                out[2 + 2 * k : 4 + 2 * k] = x[corner], y[corner]
            out[10] = area
    return features, areas
