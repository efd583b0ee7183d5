"""The offline page that plays games in a browser."""

from __future__ import annotations

import html
import json
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from coevo.replay import scene
from coevo.soccer.field import walls

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from coevo.config import RunSettings
    from coevo.game import Trace

__all__ = ["make_page"]


def make_page(settings: RunSettings, traces: Sequence[Trace]) -> str:
    """Return an HTML page with a player and all games in it; it needs nothing from outside.

    Positions are rounded to millimetres, headings to milliradians; each number is the difference to the one
    of the step before, which keeps a page of twenty games well below a megabyte.
    """
    template = resources.files("coevo.replay").joinpath("player.html").read_text(encoding="utf-8")
    data = json.dumps(_describe(settings, traces), separators=(",", ":"), ensure_ascii=True)
    # Inside <script>, "</script>" or "<!--" in a name would end or hide what follows.
    return template.replace("{{title}}", html.escape(settings.name)).replace("{{data}}", data.replace("<", "\\u003c"))


def _describe(settings: RunSettings, traces: Sequence[Trace]) -> dict[str, Any]:
    field = settings.world.field
    colours = {"ball": scene.BALL, "floor": scene.FLOOR, "wall": scene.WALL, "surround": scene.SURROUND}
    return {
        "name": settings.name,
        "step_s": settings.world.physics.step_s,
        "field": {
            "length": _mm(field.length_m),
            "width": _mm(field.width_m),
            "goal_low": _mm(0.5 * (field.width_m - field.goal_width_m)),
            "goal_high": _mm(0.5 * (field.width_m + field.goal_width_m)),
            "goal_depth": _mm(field.goal_depth_m),
            "corner": _mm(field.corner_panel_m) if field.corner_panels else 0,
            "thickness": _mm(field.wall_thickness_m),
            "walls": [[_mm(number) for point in wall for number in point] for wall in walls(field)],
        },
        "ball_radius": _mm(settings.world.ball.radius_m),
        "robot_radius": _mm(settings.world.robot.radius_m),
        "sight": [[_mm(x), _mm(y)] for x, y in scene.seen_floor(settings.world.camera)],
        "colours": {**colours, "ink": scene.INK, "paper": scene.PAPER},
        "skills": [{"name": name, "colour": colour} for name, colour in scene.skill_colours(settings)],
        "teams": [{"name": n, "colour": c} for n, c in zip(scene.TEAMS, scene.TEAM_COLOURS, strict=True)],
        "robots": [
            {"name": name, "colour": colour, "team": player.team, "tree": player.control == "evolve"}
            for name, colour, player in zip(
                scene.robot_names(settings), scene.ROBOT_COLOURS, settings.players, strict=False
            )
        ],
        "games": [_describe_game(settings, trace) for trace in traces],
    }


def _describe_game(settings: RunSettings, trace: Trace) -> dict[str, Any]:
    units = np.round(trace.states[:, :, :3] * 1000.0).astype(np.int64)
    bodies = [[_differences(column) for column in units[:, body].T] for body in range(units.shape[1])]
    del bodies[-1][2]  # nobody sees the ball turn
    return {
        "winner": scene.winner(settings, trace),
        "steps": len(trace.skills),
        "bodies": bodies,
        "skills": [_runs(column) for column in trace.skills.T],
    }


def _mm(metres: float) -> int:
    return round(1000.0 * metres)


def _differences(column: NDArray[np.int64]) -> list[int]:
    return [int(number) for number in np.diff(column, prepend=0)]


def _runs(column: NDArray[np.int8]) -> list[int]:
    """Return skill, number of steps, skill, number of steps, ..."""
    if not len(column):
        return []
    starts = np.flatnonzero(np.diff(column, prepend=column[0] + 1))
    lengths = np.diff(starts, append=len(column))
    return [int(number) for pair in zip(column[starts], lengths, strict=True) for number in pair]
