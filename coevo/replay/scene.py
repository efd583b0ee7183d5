"""What every picture shows: colours, words for actions, what a robot sees of the floor."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from coevo.soccer.drive import action_set
from coevo.tree.draw import terminal_colours

if TYPE_CHECKING:
    from coevo.config import CameraSettings, RobotSettings
    from coevo.replay.recording import Recording

__all__ = [
    "BACKDROP",
    "BALL",
    "FLOOR",
    "INK",
    "PAPER",
    "ROBOT_COLOURS",
    "SURROUND",
    "TEAM_COLOURS",
    "WALL",
    "action_labels",
    "labels",
    "seen_floor",
    "skill_labels",
]

Label = tuple[str, str]  # a name and its colour

TEAM_COLOURS = ("#1d5fe0", "#f7c800")
ROBOT_COLOURS = ("#8b5cf6", "#f472b6", "#f1f5f9", "#8a4b14", "#1f2937", "#22d3ee")
BALL, FLOOR, WALL, SURROUND, INK, PAPER = "#e01b24", "#2f7148", "#f4f4f0", "#20262b", "#101418", "#f2f4f5"
BACKDROP = "#9aa1a6"  # walls through a camera: robots of any colour, a white one too, stand out

# By the code of an action, speed and turn: the hue says where to, the lightness how fast.
_ACTIONS: dict[tuple[int, int], Label] = {
    (1, 1): ("ahead left", "#f28e2b"),
    (1, 0): ("ahead", "#59c08a"),
    (1, -1): ("ahead right", "#56a3e8"),
    (0, 1): ("turn left", "#ffc88a"),
    (0, 0): ("stand", "#d9d9d9"),
    (0, -1): ("turn right", "#a9d3f7"),
    (-1, 1): ("back left", "#c9783a"),
    (-1, 0): ("back", "#9a9a9a"),
    (-1, -1): ("back right", "#7f95c9"),
}

_SIGHT_M = 2.0  # the robot sees farther; a longer wedge would hide the game


def skill_labels(recording: Recording) -> list[Label]:
    """Return name and colour of each skill."""
    return list(terminal_colours(recording.skills).items())


def action_labels(robot: RobotSettings) -> list[Label]:
    """Return words and a colour for each action of a drive; with 4-wheel steering left and right are the wheels'."""
    return [_ACTIONS[int(speed), int(turn)] for speed, turn in action_set(robot).codes.tolist()]


def labels(recording: Recording) -> list[Label]:
    """Return name and colour of what robots are labelled with."""
    return skill_labels(recording) if recording.shows == "skills" else action_labels(recording.world.robot)


def seen_floor(camera: CameraSettings) -> list[tuple[float, float]]:
    """Return the corners of the floor that the camera sees, nearest 2 m: forward and to the left of it [m].

    The sides of the image are planes, so the floor seen is a trapezium; it is empty if the camera looks up.
    """
    down, half = math.radians(-camera.tilt_deg), math.radians(0.5 * camera.vertical_view_deg)
    lowest, highest = down + half, down - half
    if lowest <= 0.0:
        return []
    near = camera.height_m / math.tan(lowest) if lowest < 0.5 * math.pi else 0.0
    far = min(_SIGHT_M, camera.height_m / math.tan(highest)) if highest > 0.0 else _SIGHT_M
    if near >= far:
        return []
    spread = math.tan(math.radians(0.5 * camera.horizontal_view_deg))
    sides = [spread * (x * math.cos(down) + camera.height_m * math.sin(down)) for x in (near, far)]
    return [(near, sides[0]), (far, sides[1]), (far, -sides[1]), (near, -sides[0])]
