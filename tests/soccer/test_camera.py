"""The analytic camera against an exact ray cast of every pixel, and what must hold of any camera."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from coevo.config import CameraSettings, WorldSettings
from coevo.soccer.camera import (
    BALL,
    FEATURES,
    OPPONENT_GOAL,
    OWN_GOAL,
    ROBOTS,
    camera_params,
    make_retina,
    object_count,
    see,
)

WORLD = WorldSettings()
LENGTH, WIDTH = WORLD.field.length_m, WORLD.field.width_m
CAMERAS = {
    "standard": WORLD.camera,
    "low": CameraSettings(height_m=0.35, tilt_deg=-10.0, width_px=40, height_px=30),
    "above the robots": CameraSettings(height_m=0.8, tilt_deg=-35.0),
    "full height": CameraSettings(height_px=64, vertical_view_deg=70.0, tilt_deg=-20.0),
    "wide": CameraSettings(width_px=100, horizontal_view_deg=110.0),
    "upwards": CameraSettings(tilt_deg=10.0),
}


def with_camera(camera):
    return msgspec.structs.replace(WORLD, camera=camera)


def look(world, state, robot=0, side=0):
    """Return features (objects, 11) and areas (objects,)."""
    robots = len(state) - 1
    features, areas = np.zeros((object_count(robots), FEATURES)), np.zeros(object_count(robots))
    see(camera_params(world), state, robot, side, make_retina(world, robots), features, areas)
    return features, areas


def state_of(*poses):
    """Return a state of robots (x, y, heading in degrees) and in the end the ball (x, y)."""
    state = np.zeros((len(poses), 6))
    for row, (x, y, *heading) in zip(state, poses, strict=True):
        row[:3] = x, y, math.radians(heading[0]) if heading else 0.0
    return state


def random_state(rng, robots):
    """Return a state without overlaps; every second one is crowded around robot 0."""
    crowded = rng.random() < 0.5
    radii = np.array([WORLD.robot.radius_m] * robots + [WORLD.ball.radius_m])
    state = np.zeros((robots + 1, 6))
    for body, radius in enumerate(radii):
        while True:
            place = rng.uniform((radius, radius), (LENGTH - radius, WIDTH - radius))
            if body > 0 and crowded:
                place = state[0, :2] + rng.normal(0.0, 0.6, 2)
            inside = np.all((place >= radius) & (place <= (LENGTH - radius, WIDTH - radius)))
            gaps = np.hypot(*(state[:body, :2] - place).T) - radii[:body] - radius
            if inside and np.all(gaps > 0.0):
                break
        state[body, :2], state[body, 2] = place, rng.uniform(-math.pi, math.pi)
    return state


def cast(world, state, robot, side):
    """Return (rows, columns): the object that the ray through each pixel's centre hits first, -1 for none.

    Pinhole optics, written from the settings alone: world coordinates, one ray a pixel, nearest hit wins.
    """
    camera, field = world.camera, world.field
    tilt, heading = math.radians(camera.tilt_deg), state[robot, 2]
    x = (np.arange(camera.width_px) + 0.5) / camera.width_px * 2.0 - 1.0
    y = (np.arange(camera.height_px) + 0.5) / camera.height_px * 2.0 - 1.0
    right, down = np.meshgrid(
        x * math.tan(math.radians(camera.horizontal_view_deg) / 2.0),
        y * math.tan(math.radians(camera.vertical_view_deg) / 2.0),
    )
    forward = math.cos(tilt) + down * math.sin(tilt)
    dz = math.sin(tilt) - down * math.cos(tilt)
    dx = forward * math.cos(heading) + right * math.sin(heading)
    dy = forward * math.sin(heading) - right * math.cos(heading)
    hit, best = np.full(dx.shape, -1), np.full(dx.shape, np.inf)

    def offer(thing, distance, where):
        nearer = where & (distance > 0.0) & (distance < best)
        hit[nearer], best[nearer] = thing, distance[nearer]

    goals = {0.0: OWN_GOAL, field.length_m: OPPONENT_GOAL}
    if side == 1:
        goals = {0.0: OPPONENT_GOAL, field.length_m: OWN_GOAL}
    for line, thing in goals.items():
        distance = (line - state[robot, 0]) / dx
        across = state[robot, 1] + distance * dy - field.width_m / 2.0
        height = camera.height_m + distance * dz
        mouth = (np.abs(across) <= field.goal_width_m / 2.0) & (height >= 0.0) & (height <= field.goal_height_m)
        offer(thing, distance, mouth)
    best[:] = np.inf  # whatever stands on the field, or in a goal, is before its mouth
    for body in range(len(state)):
        ox, oy = state[body, :2] - state[robot, :2]
        if body == len(state) - 1:
            radius = world.ball.radius_m
            oz = radius - camera.height_m
            square, along = dx * dx + dy * dy + dz * dz, dx * ox + dy * oy + dz * oz
            under = along**2 - square * (ox * ox + oy * oy + oz * oz - radius**2)
            offer(BALL, (along - np.sqrt(np.maximum(under, 0.0))) / square, under >= 0.0)
        elif body != robot:
            thing = ROBOTS + body - (body > robot)
            radius, top = world.robot.radius_m, world.robot.height_m
            square, along = dx * dx + dy * dy, dx * ox + dy * oy
            under = along**2 - square * (ox * ox + oy * oy - radius**2)
            distance = (along - np.sqrt(np.maximum(under, 0.0))) / square
            height = camera.height_m + distance * dz
            offer(thing, distance, (under >= 0.0) & (height >= 0.0) & (height <= top))
            distance = (top - camera.height_m) / dz
            offer(thing, distance, np.hypot(distance * dx - ox, distance * dy - oy) <= radius)
    return hit


def measure(pixels, thing):
    """Return the features of a set of pixels (rows, columns) bool, pixel by pixel."""
    places = [(c + 0.5, r + 0.5) for c in range(pixels.shape[1]) for r in range(pixels.shape[0]) if pixels[r, c]]
    x, y = np.array(places).T
    centre, area = [x.mean(), y.mean()], float(len(places))
    width, height = x.max() - x.min() + 1.0, y.max() - y.min() + 1.0
    if thing == BALL:
        return [*centre, (width + height) / 4.0, area]
    if thing >= ROBOTS:
        return [*centre, width, height, area]
    # `min` keeps the first of equals, which is the leftmost.
    corners = [
        min(places, key=lambda p, a=a, b=b: a * p[0] + b * p[1]) for a, b in ((1, 1), (-1, 1), (1, -1), (-1, -1))
    ]
    return [*centre, *np.ravel(corners), area]


def compare(world, state, robot, side):
    """Return for each object that either camera sees: whether area and all features are the same."""
    features, areas = look(world, state, robot, side)
    hit = cast(world, state, robot, side)
    same = []
    for thing in range(len(areas)):
        pixels = hit == thing
        if pixels.any() and areas[thing] == pixels.sum():
            expected = measure(pixels, thing)
            same.append(np.allclose(features[thing, : len(expected)], expected, rtol=0.0, atol=1e-9))
        elif pixels.any() or areas[thing] > 0.0:
            same.append(False)
    return same
