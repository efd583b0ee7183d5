"""Settings of the world: field, ball, robot, camera, physics, rules of play, and where bodies start."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from msgspec import Meta

from coevo.config.reader import NonNegative, Positive, Range, Settings, Share

__all__ = [
    "BallSettings",
    "CameraSettings",
    "FieldSettings",
    "PhysicsSettings",
    "RobotSettings",
    "RuleSettings",
    "StartSettings",
    "WorldSettings",
]


class FieldSettings(Settings, frozen=True, kw_only=True):
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


class BallSettings(Settings, frozen=True, kw_only=True):
    """The ball."""

    radius_m: Annotated[float, Meta(ge=0.02, le=0.5)] = 0.1025  # FIFA size 4
    mass_kg: Positive = 0.37  # FIFA size 4
    elasticity: Share = 0.6  # [C] multiplied by that of what it hits
    friction: NonNegative = 0.3  # [C] multiplied likewise
    rolling_deceleration_mps2: NonNegative = 0.3  # [C] carpet: a push of 1 m/s rolls 1.7 m


class RobotSettings(Settings, frozen=True, kw_only=True):
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


class CameraSettings(Settings, frozen=True, kw_only=True):
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


class PhysicsSettings(Settings, frozen=True, kw_only=True):
    """Time and the solver."""

    # [T] video rate; "1/30 ms" is a slip. Above 0.1 s only for slow bodies, which may not pass through others.
    step_s: Annotated[float, Meta(ge=1e-3, le=0.5)] = 1.0 / 30.0
    substeps: Annotated[int, Meta(ge=1, le=20)] = 2  # [C] with two, nothing tunnels
    iterations: Annotated[int, Meta(ge=1, le=100)] = 10  # Chipmunk's own choice
    collision_slop_m: Positive = 0.001  # [C] overlap that the solver leaves
    contact_gap_m: NonNegative = 0.004  # [C] bodies nearer than this touch


class RuleSettings(Settings, frozen=True, kw_only=True):
    """What counts as a pass and as a collision, and when a ball is stuck; a contact is ``physics.contact_gap_m``."""

    pass_window_s: NonNegative = 3.0  # [C] "in a short time", from the last touch of the one to the first of the other
    collision_release_m: NonNegative = 0.02  # [C] robots must part by this before a new collision counts
    # A ball that has stayed within a small circle for so long is stuck, and goes to the middle of the field's width, as
    # a referee of the league drops it there. 0: it stays where it is. See coevo.soccer.referee.
    stuck_after_s: NonNegative = 0.0
    stuck_within_m: NonNegative = 0.3  # [C] of where it was when the time began
    stuck_off_goals_m: NonNegative = 1.5  # [C] and it is dropped no nearer than this to a goal line


class WorldSettings(Settings, frozen=True, kw_only=True):
    """Everything physical, and the rules of play."""

    field: FieldSettings = FieldSettings()
    ball: BallSettings = BallSettings()
    robot: RobotSettings = RobotSettings()
    camera: CameraSettings = CameraSettings()
    physics: PhysicsSettings = PhysicsSettings()
    rules: RuleSettings = RuleSettings()


class StartSettings(Settings, frozen=True, kw_only=True):
    """Where a body starts: uniform in a rectangle; a robot faces what is named, give or take a spread."""

    x_m: Range
    y_m: Range
    facing: Literal["ball", "opponent_goal", "own_goal", "random"] = "ball"
    spread_deg: Annotated[float, Meta(ge=0.0, le=180.0)] = 0.0

    def __post_init__(self) -> None:
        for name, (low, high) in (("x_m", self.x_m), ("y_m", self.y_m)):
            if low > high:
                raise ValueError(f"{name} must be [low, high] with low <= high, got [{low}, {high}]")
