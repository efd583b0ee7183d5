"""The field from above, drawn by OpenCV."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from coevo.replay import scene
from coevo.soccer.field import walls

if TYPE_CHECKING:
    from collections.abc import Sequence

    from coevo.config import WorldSettings
    from coevo.replay.recording import Recording

__all__ = ["Painter", "draw_frame", "frame_size"]

Colour = tuple[int, int, int]
Image = NDArray[np.uint8]

_SHIFT = 4  # OpenCV takes coordinates in 1/16 of a pixel
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_SIGHT_OPACITY = 0.13
_LIGHT = 140.0


def frame_size(world: WorldSettings, width: int) -> tuple[int, int]:
    """Return (width, height) [px] of a frame that the field fills, both even as video codecs want them."""
    field = world.field
    height = width * (field.width_m + 2.0 * field.wall_thickness_m) / _length_over_all(world) + _header(width)
    return width - width % 2, 2 * math.ceil(0.5 * height)


def draw_frame(
    recording: Recording,
    state: ArrayLike,
    chosen: ArrayLike,
    size: tuple[int, int],
    *,
    caption: tuple[str, str] = ("", ""),
) -> Image:
    """Draw one moment of a game or trial from above; the blue goal, at x = 0, is on the left.

    Args:
        recording: that it is of.
        state: (bodies, 6) float64, robots then the ball, as in a Trace.
        chosen: (robots,), the number of what each robot is labelled with, -1 for nothing.
        size: width and height of the picture [px]; ``frame_size`` gives those that fit.
        caption: what is written at the top, left and right.

    Returns:
        (height, width, 3) uint8, BGR.
    """
    return Painter(recording, size).draw(state, chosen, caption)


class Painter:
    """Draws many frames of one size; what never moves is drawn once.

    Args:
        recording: what is shown.
        size: width and height of the pictures [px].
    """

    def __init__(self, recording: Recording, size: tuple[int, int]) -> None:
        self._actors, self._world = recording.actors, recording.world
        width, height = size
        field = self._world.field
        self._header = _header(width)
        over_all = field.width_m + 2.0 * field.wall_thickness_m
        self._scale = min(width / _length_over_all(self._world), (height - self._header) / over_all)
        self._left = 0.5 * (width - self._scale * field.length_m)
        self._bottom = self._header + 0.5 * (height - self._header + self._scale * field.width_m)
        self._text_scale = max(0.32, width / 1600.0)
        self._sight = np.array(scene.seen_floor(self._world.camera))
        self._labels = scene.labels(recording)
        self._background = np.empty((height, width, 3), np.uint8)
        self._draw_background()

    def _px(self, points: ArrayLike) -> NDArray[np.int32]:
        """Return pixel coordinates, in units of 1/16, of points (..., 2) on the field [m]."""
        x, y = np.moveaxis(np.asarray(points, np.float64), -1, 0)
        pixels = np.stack([self._left + self._scale * x, self._bottom - self._scale * y], -1)
        return np.round((pixels - 0.5) * (1 << _SHIFT)).astype(np.int32)  # OpenCV counts from the pixel's centre

    def _draw_background(self) -> None:
        field, image = self._world.field, self._background
        image[:] = _bgr(scene.SURROUND)
        length, depth = field.length_m, field.goal_depth_m
        low, high = 0.5 * (field.width_m - field.goal_width_m), 0.5 * (field.width_m + field.goal_width_m)
        lap = 0.5 * field.wall_thickness_m  # under the floor, so that no seam shows
        self._rectangle((-depth, low), (lap, high), scene.TEAM_COLOURS[0])
        self._rectangle((length - lap, low), (length + depth, high), scene.TEAM_COLOURS[1])
        self._rectangle((0.0, 0.0), (length, field.width_m), scene.FLOOR)
        if field.corner_panels:
            cut = field.corner_panel_m
            for x, inwards_x in ((0.0, cut), (length, -cut)):
                for y, inwards_y in ((0.0, cut), (field.width_m, -cut)):
                    corner = [(x, y), (x + inwards_x, y), (x, y + inwards_y)]
                    cv2.fillPoly(image, [self._px(corner)], _bgr(scene.WALL), cv2.LINE_AA, _SHIFT)
        radius = round(0.5 * field.wall_thickness_m * self._scale * (1 << _SHIFT))
        for start, end in walls(field):
            self._draw_wall(np.array(start), np.array(end), 0.5 * field.wall_thickness_m, radius)

    def _rectangle(self, low: tuple[float, float], high: tuple[float, float], colour: str) -> None:
        corners = [low, (high[0], low[1]), high, (low[0], high[1])]
        cv2.fillPoly(self._background, [self._px(corners)], _bgr(colour), cv2.LINE_AA, _SHIFT)

    def _draw_wall(self, start: NDArray[np.float64], end: NDArray[np.float64], half: float, radius: int) -> None:
        along = (end - start) / np.linalg.norm(end - start)
        across = half * np.array([-along[1], along[0]])
        corners = np.array([start + across, end + across, end - across, start - across])
        cv2.fillPoly(self._background, [self._px(corners)], _bgr(scene.WALL), cv2.LINE_AA, _SHIFT)
        for post in self._px([start, end]).tolist():
            cv2.circle(self._background, post, radius, _bgr(scene.WALL), cv2.FILLED, cv2.LINE_AA, _SHIFT)

    def draw(self, state: ArrayLike, choices: ArrayLike, caption: tuple[str, str]) -> Image:
        """Draw one moment; arguments as of ``draw_frame``."""
        image = self._background.copy()
        poses = np.asarray(state, np.float64)[:, :3]
        self._draw_sight(image, poses[:-1])
        robots = poses[:-1].tolist()
        for chosen, (x, y, _) in zip(np.asarray(choices).tolist(), robots, strict=True):
            if chosen >= 0:
                name, colour = self._labels[chosen]
                self._draw_label(image, name, colour, x, y)
        for number, (x, y, heading) in enumerate(robots):  # on top: a label never hides where a body is
            self._draw_robot(image, number, x, y, heading)
        self._disc(image, poses[-1, :2], self._world.ball.radius_m, scene.BALL)
        self._write_caption(image, caption)
        return image

    def _draw_sight(self, image: Image, robots: NDArray[np.float64]) -> None:
        if not len(self._sight):
            return
        field = self._world.field
        (left, bottom), (right, top) = self._px([(0.0, 0.0), (field.length_m, field.width_m)]) >> _SHIFT
        floor = image[top:bottom, left:right]
        seen = floor.copy()
        for (x, y, heading), actor in zip(robots.tolist(), self._actors, strict=True):
            if actor.sees:
                cosine, sine = math.cos(heading), math.sin(heading)
                corners = self._sight @ np.array([[cosine, sine], [-sine, cosine]]) + (x, y)
                inside = self._px(corners) - (np.array([left, top]) << _SHIFT)
                cv2.fillConvexPoly(seen, inside, (255, 255, 255), cv2.LINE_AA, _SHIFT)
        cv2.addWeighted(seen, _SIGHT_OPACITY, floor, 1.0 - _SIGHT_OPACITY, 0.0, dst=floor)

    def _disc(self, image: Image, at: ArrayLike, radius_m: float, colour: str) -> None:
        radius = round(radius_m * self._scale * (1 << _SHIFT))
        cv2.circle(image, self._px(at).tolist(), radius, _bgr(colour), cv2.FILLED, cv2.LINE_AA, _SHIFT)

    def _draw_robot(self, image: Image, number: int, x: float, y: float, heading: float) -> None:
        radius, colour = self._world.robot.radius_m, scene.ROBOT_COLOURS[number]
        turned = np.array([heading - 0.45, heading, heading + 0.45])
        nose = np.array([0.95, 1.45, 0.95]) * radius
        corners = np.stack([x + nose * np.cos(turned), y + nose * np.sin(turned)], -1)
        cv2.fillConvexPoly(image, self._px(corners), _bgr(scene.PAPER), cv2.LINE_AA, _SHIFT)
        self._disc(image, (x, y), radius, scene.TEAM_COLOURS[self._actors[number].team])
        self._disc(image, (x, y), 0.8 * radius, colour)
        scale = max(0.3, 0.9 * self._text_scale)
        self._write(image, self._actors[number].name, self._centre(x, y), scale, _ink_on(colour))

    def _draw_label(self, image: Image, text: str, colour: str, x: float, y: float) -> None:
        scale = 0.85 * self._text_scale
        (width, height), _ = cv2.getTextSize(text, _FONT, scale, 1)
        below = self._world.robot.radius_m * self._scale + 0.9 * height
        centre_x, centre_y = self._centre(x, y)
        pad = 0.4 * height
        lowest = image.shape[0] - height - pad
        down = centre_y + below if centre_y + below < lowest else centre_y - below
        low, high = (
            (centre_x - 0.5 * width - pad, down - 0.5 * height - pad),
            (centre_x + 0.5 * width + pad, down + 0.5 * height + pad),
        )
        cv2.rectangle(image, _whole(low), _whole(high), _bgr(colour), cv2.FILLED)
        self._write(image, text, (centre_x, down), scale, scene.INK)

    def _centre(self, x: float, y: float) -> tuple[float, float]:
        return self._left + self._scale * x, self._bottom - self._scale * y

    @staticmethod
    def _write(image: Image, text: str, centre: tuple[float, float], scale: float, colour: str) -> None:
        (width, height), _ = cv2.getTextSize(text, _FONT, scale, 1)
        corner = _whole((centre[0] - 0.5 * width, centre[1] + 0.5 * height))
        cv2.putText(image, text, corner, _FONT, scale, _bgr(colour), 1, cv2.LINE_AA)

    def _write_caption(self, image: Image, caption: tuple[str, str]) -> None:
        margin = 0.5 * self._header
        for text, at_right in zip(caption, (False, True), strict=True):
            (width, _), _ = cv2.getTextSize(text, _FONT, self._text_scale, 1)
            x = image.shape[1] - margin - 0.5 * width if at_right else margin + 0.5 * width
            self._write(image, text, (x, 0.5 * self._header), self._text_scale, scene.PAPER)


def _length_over_all(world: WorldSettings) -> float:
    field = world.field
    return field.length_m + 2.0 * (field.goal_depth_m + field.wall_thickness_m)


def _header(width: int) -> int:
    return round(max(18.0, 0.036 * width))


def _bgr(colour: str) -> Colour:
    red, green, blue = bytes.fromhex(colour[1:])
    return blue, green, red


def _ink_on(colour: str) -> str:
    """Return dark or light ink, whichever reads better on a colour."""
    blue, green, red = _bgr(colour)
    return scene.INK if 0.3 * red + 0.59 * green + 0.11 * blue > _LIGHT else scene.PAPER


def _whole(point: Sequence[float]) -> tuple[int, int]:
    return round(point[0]), round(point[1])
