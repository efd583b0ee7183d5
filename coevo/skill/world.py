"""Whether a skill is used in the world that it was learned for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from coevo.config import WorldSettings
from coevo.errors import InputError
from coevo.skill.model import Skill

__all__ = ["check_world"]

# What decides what a skill sees and what its actions do. Noise, the field, masses and materials a skill has to stand.
_OF_ANY_DRIVE = (
    *("camera.width_px", "camera.height_px", "camera.horizontal_view_deg", "camera.vertical_view_deg"),
    *("camera.tilt_deg", "camera.height_m", "robot.drive", "robot.radius_m", "robot.height_m", "robot.max_speed_mps"),
    *("robot.max_acceleration_mps2", "robot.max_turn_acceleration_dps2", "ball.radius_m", "physics.step_s"),
)
_OF_DRIVE = {"pws": ("robot.max_turn_rate_dps",), "4ws": ("robot.max_steering_deg", "robot.wheelbase_m")}


def check_world(skill: Skill, world: WorldSettings, terminal: str) -> None:
    """Refuse a skill that was learned for another world; one whose file does not tell its world is taken.

    Args:
        skill: what is to be used.
        world: where.
        terminal: the name that it has among the settings' skills.

    Raises:
        InputError: names the first setting that differs, both values and the remedy.
    """
    recipe = skill.about.get("recipe")
    learned = recipe.get("world") if isinstance(recipe, Mapping) else None
    here = msgspec.to_builtins(world)
    for setting in (*_OF_ANY_DRIVE, *_OF_DRIVE[world.robot.drive]):
        was, now = _look_up(learned, setting), _look_up(here, setting)
        if was is not None and was != now:
            raise InputError(
                f"skills.{terminal}: {skill.name!r} was learned for a world with {setting} {was}, here it is {now};"
                f" learn it again for this world ('coevo learn RECIPE.toml', its recipe.toml with world.{setting} ="
                f' {now}), or allow it by skills_elsewhere = "allow"'
            )


def _look_up(data: Any, setting: str) -> Any:
    for part in setting.split("."):
        data = data.get(part) if isinstance(data, Mapping) else None
    return data
