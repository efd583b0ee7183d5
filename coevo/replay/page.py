"""The offline page that plays games and trials in a browser."""

from __future__ import annotations

import html
import json
import math
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from coevo.replay import scene
from coevo.replay.packing import differences, pack_images, runs
from coevo.soccer.field import walls
from coevo.soccer.sight import label_images
from coevo.tree.rules import question

if TYPE_CHECKING:
    from coevo.config import CameraSettings
    from coevo.replay.recording import Actor, Recording, Take
    from coevo.replay.scene import Label
    from coevo.skill import ObjectModel
    from coevo.tree import Tree

__all__ = ["make_page"]


def make_page(recording: Recording) -> str:
    """Return an HTML page with a player and all games or trials in it; it needs nothing from outside.

    Positions are rounded to millimetres, headings to milliradians; each number is the difference to the one of the step
    before. What the cameras show is packed, too: three games of 600 steps between three robots take about 300 kB.

    The page may stand in an ``iframe`` with ``srcdoc``: it asks for nothing that a sandbox with scripts forbids, and
    tells the window around it ``{"coevo": "height", "height": px}`` by ``postMessage``.
    """
    template = resources.files("coevo.replay").joinpath("player.html").read_text(encoding="utf-8")
    data = json.dumps(_describe(recording), separators=(",", ":"), ensure_ascii=True)
    # Inside <script>, "</script>" or "<!--" in a name would end or hide what follows.
    return template.replace("{{title}}", html.escape(recording.name)).replace("{{data}}", data.replace("<", "\\u003c"))


def _describe(recording: Recording) -> dict[str, Any]:
    world = recording.world
    field = world.field
    colours = {"ball": scene.BALL, "floor": scene.FLOOR, "wall": scene.WALL, "surround": scene.SURROUND}
    colours["backdrop"] = scene.BACKDROP
    skills = zip(scene.skill_labels(recording), recording.skills.values(), strict=True)
    return {
        "name": recording.name,
        "kind": recording.kind,
        "sides": recording.sides,
        "shows": recording.shows,
        "step_s": world.physics.step_s,
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
        "ball_radius": _mm(world.ball.radius_m),
        "robot_radius": _mm(world.robot.radius_m),
        "sight": [[_mm(x), _mm(y)] for x, y in scene.seen_floor(world.camera)],
        "camera": _describe_camera(world.camera),
        "colours": {**colours, "ink": scene.INK, "paper": scene.PAPER},
        "skills": [{**_label(label), "objects": [_sees(model) for model in models]} for label, models in skills],
        "actions": [_label(label) for label in scene.action_labels(world.robot)],
        "teams": [{"colour": colour} for colour in scene.TEAM_COLOURS],
        "robots": [_describe_actor(recording, number) for number in range(len(recording.actors))],
        "games": [_describe_take(recording, take) for take in recording.takes],
    }


def _label(label: Label) -> dict[str, str]:
    return {"name": label[0], "colour": label[1]}


def _sees(model: ObjectModel) -> dict[str, Any]:
    name = "nearest robot" if model.kind == "robot" else model.kind.replace("_", " ")
    return {"name": name, "order": model.order, "lost": model.lost_states}


def _describe_camera(camera: CameraSettings) -> dict[str, Any]:
    """Return the size of the image, how much wider than high it is for an eye, and the floor in it.

    ``ground``: for each row how far ahead its pixels show the floor, and how far to the left the left edge does [mm];
    (0, 0) where they show none.
    """
    wide, high = (math.tan(0.5 * math.radians(d)) for d in (camera.horizontal_view_deg, camera.vertical_view_deg))
    down = math.radians(-camera.tilt_deg)
    ground = []
    for row in range(camera.height_px):
        below = high * ((2 * row + 1) / camera.height_px - 1.0)  # in focal lengths
        falls = math.sin(down) + below * math.cos(down)
        ahead = math.cos(down) - below * math.sin(down)
        share = camera.height_m / falls if falls > 0.0 and ahead > 0.0 else 0.0
        ground.append((_mm(share * ahead), _mm(share * wide)))
    size = {"columns": camera.width_px, "rows": camera.height_px}
    return {**size, "aspect": round(wide / high, 4), "ground": ground}


def _describe_actor(recording: Recording, number: int) -> dict[str, Any]:
    actor = recording.actors[number]
    others = [colour for n, colour in enumerate(scene.ROBOT_COLOURS[: len(recording.actors)]) if n != number]
    own, opponents = scene.TEAM_COLOURS if actor.team == 0 else scene.TEAM_COLOURS[::-1]
    return {
        "name": actor.name,
        "colour": scene.ROBOT_COLOURS[number],
        "team": actor.team,
        "sees": actor.sees,
        "objects": [scene.BALL, own, opponents, *others],  # in the order of the camera's objects
        "tree": None if actor.tree is None else _describe_tree(actor.tree),
    }


def _describe_tree(tree: Tree) -> dict[str, Any]:
    """Return a tree as the words of its nodes, each word once, and where second branches begin."""
    words = list(dict.fromkeys(question(name) for name in tree.names))
    numbers = {word: number for number, word in enumerate(words)}
    return {"words": words, "nodes": [numbers[question(name)] for name in tree.names], "second": tree.second}


def _describe_take(recording: Recording, take: Take) -> dict[str, Any]:
    trace = take.trace
    units = np.round(trace.states[:, :, :3] * 1000.0).astype(np.int64)
    bodies = [[differences(column) for column in units[:, body].T] for body in range(units.shape[1])]
    del bodies[-1][2]  # nobody sees the ball turn
    return {
        "title": take.title,
        "ending": take.ending,
        "point": take.point,
        "idle": take.idle,
        "steps": len(trace.skills),
        "bodies": bodies,
        "skills": [runs(column) for column in trace.skills.T],
        "actions": [runs(column) for column in trace.actions.T],
        "leaves": [runs(column) for column in trace.leaves.T],
        "perceived": [runs(column) for column in trace.perceived.T],
        "images": [_images(recording, take, number, actor) for number, actor in enumerate(recording.actors)],
    }


def _images(recording: Recording, take: Take, number: int, actor: Actor) -> str:
    if not actor.sees:
        return ""
    return pack_images(label_images(recording.world, take.trace.states, number, actor.team))


def _mm(metres: float) -> int:
    return round(1000.0 * metres)
