"""What every picture of a game shows: colours, names, what a robot sees of the floor, how a game ended."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from coevo.tree.draw import terminal_colours

if TYPE_CHECKING:
    from collections.abc import Sequence

    from coevo.config import CameraSettings, RunSettings
    from coevo.game import Trace

__all__ = [
    "BALL",
    "FLOOR",
    "INK",
    "PAPER",
    "ROBOT_COLOURS",
    "SURROUND",
    "TEAMS",
    "TEAM_COLOURS",
    "WALL",
    "robot_names",
    "score_before",
    "seen_floor",
    "skill_colours",
    "winner",
]

# A team is named after the goal it defends: team 0 the blue one at x = 0, team 1 the yellow one.
TEAMS = ("blue", "yellow")
TEAM_COLOURS = ("#1d5fe0", "#f7c800")
ROBOT_COLOURS = ("#8b5cf6", "#f472b6", "#f1f5f9", "#8a4b14", "#1f2937", "#22d3ee")
BALL, FLOOR, WALL, SURROUND, INK, PAPER = "#e01b24", "#2f7148", "#f4f4f0", "#20262b", "#101418", "#f2f4f5"

_SIGHT_M = 2.0  # the robot sees farther; a longer wedge would hide the game


def robot_names(settings: RunSettings) -> list[str]:
    """Return r0, r1, ... for the players."""
    return [f"r{number}" for number in range(len(settings.players))]


def skill_colours(settings: RunSettings) -> list[tuple[str, str]]:
    """Return name and colour of each terminal, in their order."""
    return list(terminal_colours(settings.terminals).items())


def winner(settings: RunSettings, trace: Trace) -> int:
    """Return the team that scored, -1 if time ran out."""
    x = float(trace.states[-1, -1, 0])
    if x > settings.world.field.length_m:
        return 0
    return 1 if x < 0.0 else -1


def score_before(settings: RunSettings, traces: Sequence[Trace]) -> list[tuple[int, int]]:
    """Return the goals of both teams before each game, and after the last one."""
    goals = [0, 0]
    scores = [(0, 0)]
    for trace in traces:
        team = winner(settings, trace)
        if team >= 0:
            goals[team] += 1
        scores.append((goals[0], goals[1]))
    return scores


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
