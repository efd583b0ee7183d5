"""Settings: typed, frozen, and checked on the way in.

Every number of the world and of the experiments stands here once, with its unit in its name and its source in
its description. ``[T]`` marks a value stated in Uchibe (1999), ``[S]`` one from the RoboCup rules of 1997/98,
``[C]`` a free choice of ours where the text is silent.
"""

from __future__ import annotations

import math
import tomllib
import types
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec
import tomli_w
from msgspec import Meta, Struct

from coevo.errors import InputError, nearest_name

__all__ = [
    "BallSettings",
    "CameraSettings",
    "CategorySettings",
    "EvaluationSettings",
    "FieldSettings",
    "FitnessSettings",
    "FitnessWeights",
    "GPSettings",
    "GameSettings",
    "PhysicsSettings",
    "PlayerSettings",
    "RobotSettings",
    "RunSettings",
    "SkillSettings",
    "StartSettings",
    "WorldSettings",
    "check",
    "override",
    "read_toml",
    "to_toml",
]

_S = TypeVar("_S", bound=Struct)
Positive = Annotated[float, Meta(gt=0.0, le=1e6)]
NonNegative = Annotated[float, Meta(ge=0.0, le=1e9)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
Range = tuple[float, float]


class _Settings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all settings: frozen, by keyword only, no unknown keys."""


class FieldSettings(_Settings, frozen=True, kw_only=True):
    """The field, seen from above; x runs from goal to goal, y to the left of it, origin in a corner."""

    length_m: Annotated[float, Meta(ge=2.0, le=50.0)] = 8.22  # [S] three table-tennis tables
    width_m: Annotated[float, Meta(ge=2.0, le=50.0)] = 4.575  # [S]
    goal_width_m: Positive = 1.5  # [S]
    goal_height_m: Positive = 0.5  # [S]
    goal_depth_m: Annotated[float, Meta(ge=0.3, le=2.0)] = 0.5  # [C] a walled box, so that nothing drives off
    corner_panels: bool = True  # [S] without them a ball is trapped in a corner
    corner_panel_m: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.2  # [S] cut off along both walls
    wall_thickness_m: Annotated[float, Meta(ge=0.2, le=2.0)] = 0.2  # [C] thinner walls can be tunnelled through
    wall_elasticity: Share = 0.8  # [C]
    wall_friction: NonNegative = 0.5  # [C]

    def __post_init__(self) -> None:
        # Behind the goal line the round end of a corner panel reaches a little farther than its face.
        beside = self.corner_panel_m
        if self.corner_panels:
            beside += (1.0 - math.sqrt(0.5)) * 0.5 * self.wall_thickness_m
        most = self.width_m - 2.0 * beside
        if self.goal_width_m > most:
            raise ValueError(
                f"goal_width_m must be at most {most:g}, so that walls and corner panels fit beside it into width_m"
                f" {self.width_m:g}, got {self.goal_width_m:g}"
            )


class BallSettings(_Settings, frozen=True, kw_only=True):
    """The ball."""

    radius_m: Annotated[float, Meta(ge=0.02, le=0.5)] = 0.1025  # FIFA size 4
    mass_kg: Positive = 0.37  # FIFA size 4
    elasticity: Share = 0.6  # [C] multiplied by that of what it hits
    friction: NonNegative = 0.3  # [C] multiplied likewise
    rolling_deceleration_mps2: NonNegative = 0.3  # [C] carpet: a push of 1 m/s rolls 1.7 m


class RobotSettings(_Settings, frozen=True, kw_only=True):
    """The body and the drive, the same for all robots."""

    drive: Literal["pws", "4ws"] = "pws"  # [T] power wheeled steering in chapters 5 and 6, 4-wheel in 3 and 4
    radius_m: Annotated[float, Meta(ge=0.05, le=0.5)] = 0.2  # [C] the league allowed about 0.5 m across
    height_m: Positive = 0.5  # [C]
    mass_kg: Positive = 10.0  # [C]
    elasticity: Share = 0.5  # [C]
    friction: NonNegative = 0.3  # [C]
    max_speed_mps: Annotated[float, Meta(gt=0.0, le=3.0)] = 1.0  # [C]
    max_turn_rate_dps: Annotated[float, Meta(gt=0.0, le=720.0)] = 120.0  # [C] power wheeled steering
    max_steering_deg: Annotated[float, Meta(gt=0.0, lt=80.0)] = 25.0  # [C] 4-wheel steering
    wheelbase_m: Positive = 0.4  # [C] 4-wheel steering
    max_acceleration_mps2: Positive = 4.0  # [C] what the motors and the grip of the tyres can do
    max_turn_acceleration_dps2: Positive = 2400.0  # [C]
    actuator_noise: Share = 0.0  # standard deviation, as a share of the commanded speed and turn rate


class CameraSettings(_Settings, frozen=True, kw_only=True):
    """The on-board camera."""

    width_px: Annotated[int, Meta(ge=8, le=640)] = 64  # [T]
    height_px: Annotated[int, Meta(ge=8, le=64)] = 60  # [T] a column of the image fits one 64-bit word
    horizontal_view_deg: Annotated[float, Meta(gt=5.0, lt=140.0)] = 67.0  # [T]
    vertical_view_deg: Annotated[float, Meta(gt=5.0, lt=140.0)] = 60.0  # [T] the pixels are not square
    tilt_deg: Annotated[float, Meta(gt=-80.0, lt=30.0)] = -26.0  # [T]
    height_m: Positive = 0.4  # [C]
    noise_px: Annotated[float, Meta(ge=0.0, le=20.0)] = 0.0  # standard deviation of each measured coordinate

    def __post_init__(self) -> None:
        if abs(self.tilt_deg) + 0.5 * self.vertical_view_deg >= 85.0:
            raise ValueError(
                "tilt_deg and half of vertical_view_deg must together stay below 85, so that the camera looks forward;"
                f" got {self.tilt_deg:g} and {self.vertical_view_deg:g}"
            )


class PhysicsSettings(_Settings, frozen=True, kw_only=True):
    """Time and the solver."""

    step_s: Annotated[float, Meta(gt=0.0, le=0.1)] = 1.0 / 30.0  # [T] video rate; "1/30 ms" is a slip
    substeps: Annotated[int, Meta(ge=1, le=20)] = 2  # [C] with two, nothing tunnels
    iterations: Annotated[int, Meta(ge=1, le=100)] = 10  # Chipmunk's own choice
    collision_slop_m: Positive = 0.001  # [C] overlap that the solver leaves
    contact_gap_m: NonNegative = 0.004  # [C] bodies nearer than this touch


class WorldSettings(_Settings, frozen=True, kw_only=True):
    """Everything physical."""

    field: FieldSettings = FieldSettings()
    ball: BallSettings = BallSettings()
    robot: RobotSettings = RobotSettings()
    camera: CameraSettings = CameraSettings()
    physics: PhysicsSettings = PhysicsSettings()


class StartSettings(_Settings, frozen=True, kw_only=True):
    """Where a body starts: uniform in a rectangle; a robot faces what is named, give or take a spread."""

    x_m: Range
    y_m: Range
    facing: Literal["ball", "opponent_goal", "own_goal", "random"] = "ball"
    spread_deg: Annotated[float, Meta(ge=0.0, le=180.0)] = 0.0

    def __post_init__(self) -> None:
        for name, (low, high) in (("x_m", self.x_m), ("y_m", self.y_m)):
            if low > high:
                raise ValueError(f"{name} must be [low, high] with low <= high, got [{low}, {high}]")


class PlayerSettings(_Settings, frozen=True, kw_only=True):
    """One robot of a game; robots are named r0, r1, ... in their order."""

    team: Annotated[int, Meta(ge=0, le=1)] = 0  # team 0 attacks the goal at x = length, team 1 the one at x = 0
    control: Literal["evolve", "stationary"] = "evolve"
    start: StartSettings


class GameSettings(_Settings, frozen=True, kw_only=True):
    """When a game ends and what counts as a pass and a collision."""

    time_limit_steps: Annotated[int, Meta(ge=1, le=100_000)] = 1000  # [C] a game ends with a goal or with time [T]
    pass_window_s: NonNegative = 3.0  # [C] "in a short time"
    collision_release_m: NonNegative = 0.02  # [C] robots must part by this before a new collision counts
    ball_start: StartSettings


class CategorySettings(_Settings, frozen=True, kw_only=True):
    """Limits of the image categories of Table 6.1.

    The limits of area are about terciles over the visible samples of random play in the presets, which
    'python -m analysis.categories' measures.
    """

    left_below_px: Positive = 64.0 / 3.0  # [C] thirds of the image
    right_from_px: Positive = 128.0 / 3.0
    ball_small_below_px: NonNegative = 20.0
    ball_large_from_px: NonNegative = 60.0
    goal_small_below_px: NonNegative = 35.0
    goal_large_from_px: NonNegative = 80.0
    robot_small_below_px: NonNegative = 25.0
    robot_large_from_px: NonNegative = 65.0


class SkillSettings(_Settings, frozen=True, kw_only=True):
    """The terminals: for each the name of an installed skill, or the path of a skill file."""

    shoot: str = "shoot"
    pass_: str = msgspec.field(default="pass", name="pass")
    avoid: str = "avoid"
    search: str = "search"


class GPSettings(_Settings, frozen=True, kw_only=True):
    """Genetic programming, Table 6.3."""

    population: Annotated[int, Meta(ge=2, le=100_000)] = 80  # [T] for each robot
    generations: Annotated[int, Meta(ge=1, le=100_000)] = 60  # [T] the print lost a digit: "?0"
    tournament: Annotated[int, Meta(ge=1, le=1000)] = 10  # [T]
    crossover: Share = 0.85  # [T] lost in print; reproduction and mutation leave 85 %
    reproduction: Share = 0.05  # [T]
    mutation: Share = 0.10  # [T]
    elite: Annotated[int, Meta(ge=0, le=100)] = 1  # [T] the best survives
    creation_depth_min: Annotated[int, Meta(ge=0, le=14)] = 2  # [C] ramped half and half
    creation_depth_max: Annotated[int, Meta(ge=0, le=14)] = 10  # [T]
    crossover_depth_max: Annotated[int, Meta(ge=1, le=90)] = 25  # [T] mutation may exceed it, as Table 6.4 shows
    mutation_depth_max: Annotated[int, Meta(ge=0, le=14)] = 5  # [C] grown subtree
    leaf_probability: Share = 0.1  # [C] of a crossover point, Koza (1992)

    def __post_init__(self) -> None:
        total = self.crossover + self.reproduction + self.mutation
        if not math.isclose(total, 1.0, abs_tol=1e-9):
            raise ValueError(f"crossover + reproduction + mutation must be 1, got {total:g}")
        if self.creation_depth_min > self.creation_depth_max:
            raise ValueError(f"creation_depth_min must be at most creation_depth_max, got {self.creation_depth_min}")
        if self.elite >= self.population:
            raise ValueError(f"elite must be smaller than population {self.population}, got {self.elite}")


class FitnessWeights(_Settings, frozen=True, kw_only=True):
    """The constants of one fitness function, Table 6.2."""

    alpha_g: NonNegative = 1.0  # goals missing
    alpha_l: NonNegative  # lost goals
    alpha_k: NonNegative  # kicks missing to beta
    alpha_c: NonNegative  # collisions
    alpha_s: NonNegative  # steps
    beta: NonNegative = 4000.0  # [T] steps of contact that are enough; 200 a game


class FitnessSettings(_Settings, frozen=True, kw_only=True):
    """Which fitness function, and the constants of both; smaller is better."""

    kind: Literal["fixed", "varying"] = "fixed"
    fixed: FitnessWeights = FitnessWeights(alpha_l=0.5, alpha_k=1e-3, alpha_c=5e-3, alpha_s=1e-4)  # [T]
    varying: FitnessWeights = FitnessWeights(alpha_l=1.0, alpha_k=1e-2, alpha_c=1e-2, alpha_s=1e-2)  # [T]


class EvaluationSettings(_Settings, frozen=True, kw_only=True):
    """How individuals meet."""

    games: Annotated[int, Meta(ge=1, le=100_000)] = 20  # [T] a grouping
    grouping: Literal["random"] = "random"  # [T] each individual plays in one grouping a generation


class RunSettings(_Settings, frozen=True, kw_only=True):
    """A whole experiment: 'coevo evolve' takes exactly this."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")] = "run"  # a part of the run folder's name
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    world: WorldSettings = WorldSettings()
    game: GameSettings
    players: Annotated[tuple[PlayerSettings, ...], Meta(min_length=1, max_length=6)]
    categories: CategorySettings = CategorySettings()
    skills: SkillSettings = SkillSettings()
    gp: GPSettings = GPSettings()
    fitness: FitnessSettings = FitnessSettings()
    evaluation: EvaluationSettings = EvaluationSettings()

    def __post_init__(self) -> None:
        if all(player.control != "evolve" for player in self.players):
            raise ValueError('players: at least one must have control = "evolve"')
        field = self.world.field
        starts = [("game.ball_start", self.game.ball_start, self.world.ball.radius_m)]
        starts += [(f"players.{i}.start", p.start, self.world.robot.radius_m) for i, p in enumerate(self.players)]
        for name, start, radius in starts:
            for axis, (low, high), size in (
                ("x_m", start.x_m, field.length_m),
                ("y_m", start.y_m, field.width_m),
            ):
                if low < radius or high > size - radius:
                    limits = f"[{radius:g}, {size - radius:g}]"
                    raise ValueError(f"{name}.{axis} must lie within {limits} on this field, got [{low:g}, {high:g}]")


def check(kind: type[_S], data: Mapping[str, Any], source: str) -> _S:
    """Make settings of ``kind`` from plain data, as TOML gives it.

    Raises:
        InputError: a key is unknown (the nearest is offered), a value has the wrong type or is out of range.
    """
    _check_keys(kind, data, source, "")
    try:
        return msgspec.convert(dict(data), kind)
    except msgspec.ValidationError as error:
        text, _, where = str(error).partition(" - at `$.")
        text = text.replace("Expected `object`", "expected a table").replace("Expected", "expected")
        path = where.rstrip("`").replace("[", ".").replace("]", "").replace("...", "*")
        came = _look_up(data, path)
        if text.startswith("Invalid enum value"):
            text = f"expected one of {', '.join(map(repr, _choices(kind, path)))}"
        got = f", got {came!r}" if path and not isinstance(came, Mapping) and "got" not in text else ""
        raise InputError(f"{source}: {path + ': ' if path else ''}{text.replace('`', '')}{got}") from None


def _check_keys(kind: Any, data: Any, source: str, path: str) -> None:
    if isinstance(data, float) and not math.isfinite(data):
        raise InputError(f"{source}: {path}: expected a finite number, got {data}")
    if isinstance(data, list | tuple):
        item = next((a for a in _arguments(kind) if _is_settings(a)), None)
        for index, value in enumerate(data):
            _check_keys(item, value, source, f"{path}.{index}")
    kind = next((a for a in [kind, *_arguments(kind)] if _is_settings(a)), None)
    if kind is None or not isinstance(data, Mapping):
        return
    fields = {field.encode_name: field.type for field in msgspec.structs.fields(kind)}
    for key, value in data.items():
        here = f"{path}.{key}" if path else str(key)
        if key not in fields:
            known = nearest_name(str(key), fields) or f" Known here: {', '.join(fields)}."
            raise InputError(f"{source}: unknown setting {here!r}.{known}")
        _check_keys(fields[key], value, source, here)


def _choices(kind: Any, path: str) -> list[Any]:
    """Return what a setting with a closed list of values may be."""
    for part in path.split("."):
        inner = next((a for a in [kind, *_arguments(kind)] if _is_settings(a)), None)
        if inner is not None and not part.isdigit():
            kind = {field.encode_name: field.type for field in msgspec.structs.fields(inner)}.get(part)
    return [choice for choice in _arguments(kind) if isinstance(choice, str)]


def _is_settings(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, Struct)


def _arguments(kind: Any) -> list[Any]:
    found: list[Any] = []
    for argument in typing.get_args(kind):
        found += [argument, *_arguments(argument)]
    return found


def _look_up(data: Any, path: str) -> Any:
    for part in path.split("."):
        if isinstance(data, Mapping):
            data = data.get(part)
        elif isinstance(data, list | tuple) and part.isdigit() and int(part) < len(data):
            data = data[int(part)]
    return data


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; a missing or broken one is an InputError that says where."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"cannot read {path}: {reason}") from None
    except ValueError as error:
        raise InputError(f"{path} is not valid TOML: {error}") from None


def to_toml(settings: Struct) -> str:
    """Return every setting, resolved, as TOML that 'check' reads back to equal settings.

    TOML has no word for None: such a setting is left out, and None is what it is then.
    """
    return tomli_w.dumps(_without_none(msgspec.to_builtins(settings)))


def _without_none(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {key: _without_none(value) for key, value in data.items() if value is not None}
    if isinstance(data, list | tuple):
        return [_without_none(value) for value in data]
    return data


def override(data: Mapping[str, Any], assignments: Iterable[str]) -> dict[str, Any]:
    """Return plain data with settings replaced, each given as ``dotted.key=value`` (the value as in TOML)."""
    result = typing.cast("dict[str, Any]", _thaw(data))
    for assignment in assignments:
        key, equals, text = assignment.partition("=")
        if not equals or not key.strip():
            raise InputError(f"--set expects KEY=VALUE, such as gp.population=40; got {assignment!r}")
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except ValueError:  # not TOML, or a number of thousands of digits: take it as text
            value = text.strip()
        *folders, last = key.strip().split(".")
        node: Any = result
        for folder in folders:
            node = _step_into(node, folder, assignment)
        if isinstance(node, list):
            node[_index(node, last, assignment)] = value
        elif isinstance(node, dict):
            node[last] = value
        else:
            raise InputError(f"--set {assignment}: {'.'.join(folders)} is a single value and has no parts")
    return result


def _step_into(node: Any, part: str, assignment: str) -> Any:
    if isinstance(node, list):
        return node[_index(node, part, assignment)]
    if isinstance(node, dict):
        return node.setdefault(part, {})
    raise InputError(f"--set {assignment}: {part!r} lies below a single value, which has no parts")


def _index(items: list[Any], part: str, assignment: str) -> int:
    if not part.isdigit() or int(part) >= len(items):
        raise InputError(f"--set {assignment}: expected an index from 0 to {len(items) - 1}, got {part!r}")
    return int(part)


def _thaw(data: Any) -> Any:
    if isinstance(data, Mapping | types.MappingProxyType):
        return {key: _thaw(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_thaw(value) for value in data]
    return data
