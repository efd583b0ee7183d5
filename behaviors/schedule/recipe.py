"""The experiment of chapter 3 as a recipe in TOML, checked: two robots, their periods, and what they learn with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from behaviors.settings import ActionSettings, ExperienceSettings, LearningSettings, ModelSettings, StoreSettings
from coevo.config import FileSettings, NonNegative, RobotSettings, Settings, Share, StartSettings, WorldSettings
from coevo.recipes import read_settings

__all__ = ["LearnerSettings", "PairStoreSettings", "Schedule", "TransferSettings", "read_schedule", "transfer_world"]


class LearnerSettings(Settings, frozen=True, kw_only=True):
    """One of the two robots."""

    objects: Annotated[tuple[ModelSettings, ...], Meta(min_length=1, max_length=4)]  # of its state
    also: tuple[ModelSettings, ...] = ()  # models that are identified and reported, but are not part of the state
    action: ActionSettings = ActionSettings()
    learning: LearningSettings = LearningSettings()

    def __post_init__(self) -> None:
        kinds = [model.kind for model in (*self.objects, *self.also)]
        twice = sorted({kind for kind in kinds if kinds.count(kind) > 1})
        if twice:
            raise ValueError(f"objects and also: {twice[0]!r} is there twice")
        if any(model.needed for model in self.objects):
            raise ValueError("objects: only a skill that is learned by its own recipe can need one")
        if self.action.min_steps > self.action.max_steps:
            raise ValueError(f"action.min_steps must be at most max_steps, got {self.action.min_steps}")


class PairStoreSettings(StoreSettings, frozen=True, kw_only=True):
    """What both robots store, and what is told of it."""

    report_orders: bool = True  # find the orders of 3.2.3 and (3.6) too, for Table 3.2; they are not used


class PairStarts(Settings, frozen=True, kw_only=True):
    """Where trials start: uniform in rectangles."""

    in_view: bool = True  # the passer sees ball and shooter, the shooter ball and goal
    # Share of the trials in which the passer starts nearer to the ball. In the others it may or may not: a shooter that
    # is to see ball and goal mostly is nearer, and needs no passer.
    passer_nearer: Share = 0.25
    ball: StartSettings = StartSettings(x_m=(2.5, 7.4), y_m=(0.6, 3.975))
    passer: StartSettings = StartSettings(x_m=(0.4, 6.0), y_m=(0.4, 4.175), spread_deg=60.0)
    shooter: StartSettings = StartSettings(x_m=(1.5, 7.4), y_m=(0.4, 4.175), spread_deg=60.0)


class TransferSettings(Settings, frozen=True, kw_only=True):
    """Periods E and F: another world, which stands in for the real robots."""

    trials_e: Annotated[int, Meta(ge=0, le=100_000)] = 100  # [T] 0: no transfer
    trials_f: Annotated[int, Meta(ge=0, le=100_000)] = 50  # [T]
    camera: Literal["opencv", "analytic"] = "opencv"  # opencv: images are painted, and objects found by colour
    supersample: Annotated[int, Meta(ge=1, le=15)] = 1  # of the painted image; odd
    noise_grey: NonNegative = 8.0  # standard deviation of each colour channel of each pixel [of 255]
    min_region_px: NonNegative = 3.0  # smaller regions of colour are taken for noise
    latency_steps: Annotated[int, Meta(ge=0, le=30)] = 2  # an image is this old when it arrives
    tilt_deg: float = -24.0  # of the camera; [T] -26 in simulation
    rolling_deceleration_mps2: NonNegative = 0.45  # of the ball: another carpet
    wall_elasticity: Share = 0.6
    actuator_noise: Share = 0.1  # standard deviation, as a share of the commanded speed and turn rate
    epsilon: Share = 0.2  # [T] 3.6.2: "selects optimal action with probability 80 %"
    alpha: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.01  # constant: few trials may not spoil what many taught
    reuse: Literal["copy", "mixture", "cold"] = "copy"  # of what E learned, in F: 50 trials teach nothing from zero

    def __post_init__(self) -> None:
        if self.supersample % 2 == 0:
            raise ValueError(f"supersample must be odd, got {self.supersample}")


class Schedule(FileSettings, frozen=True, kw_only=True):
    """One method: how a passer and a shooter learn, from nothing to the other world."""

    kind: Literal["schedule"] = "schedule"
    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}\Z")]
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    periods: Literal["scheduled", "simultaneous"] = "scheduled"  # simultaneous: both learn in all trials at once
    trials: Annotated[int, Meta(ge=1, le=10_000_000)] = 25_000  # [T] a period; simultaneous: four times as many
    time_limit_steps: Annotated[int, Meta(ge=1, le=100_000)] = 900  # 30 s
    # Before C and D: new models with (3.10), with a table from zero, or with the old values in the new states; "keep":
    # models and table as they were, where there is no model to renew.
    reuse: Literal["mixture", "cold", "copy", "keep"] = "mixture"
    fixed_epsilon: Share = 0.0  # random actions of a robot that does not learn; its policy is greedy besides
    goal_reward: float = 1.0  # [T]
    pass_reward: float = 1.0  # [T]
    passes_rewarded: Literal["first", "each"] = (
        "first"  # of a trial; with "each", a goal costs the passer its next passes
    )
    collision_reward: float = -0.3  # [T]
    games: Annotated[int, Meta(ge=10, le=100_000)] = 500  # that measure both robots after the last period
    passer: LearnerSettings
    shooter: LearnerSettings
    starts: PairStarts = PairStarts()
    experience: ExperienceSettings = ExperienceSettings()
    store: PairStoreSettings = PairStoreSettings()
    transfer: TransferSettings = TransferSettings()
    world: WorldSettings = WorldSettings(robot=RobotSettings(drive="4ws"))

    def __post_init__(self) -> None:
        if self.experience.hold_min_steps > self.experience.hold_max_steps:
            raise ValueError(
                f"experience.hold_min_steps must be at most hold_max_steps, got {self.experience.hold_min_steps}"
            )
        if "copy" in (self.reuse, self.transfer.reuse):
            open_orders = [
                model.kind
                for model in (*self.passer.objects, *self.shooter.objects)
                if model.order is None and model.estimator == "cva"
            ]
            if open_orders:
                raise ValueError(f'reuse = "copy" needs the same states again: give an order for {open_orders[0]!r}')
        estimators = {m.estimator for part in (self.passer, self.shooter) for m in part.also}
        if "raw" in estimators:
            raise ValueError('also: an estimator "raw" has nothing to report')


def read_schedule(name: str, changes: Sequence[str] = ()) -> Schedule:
    """Read a recipe by name or path, with settings replaced by ``dotted.key=value``.

    Raises:
        InputError: there is no such recipe, it is of another kind, or it is wrong.
    """
    return read_settings(Schedule, name, changes)


def transfer_world(schedule: Schedule) -> WorldSettings:
    """Return the world of periods E and F."""
    world, other = schedule.world, schedule.transfer
    return msgspec.structs.replace(
        world,
        camera=msgspec.structs.replace(world.camera, tilt_deg=other.tilt_deg),
        ball=msgspec.structs.replace(world.ball, rolling_deceleration_mps2=other.rolling_deceleration_mps2),
        field=msgspec.structs.replace(world.field, wall_elasticity=other.wall_elasticity),
        robot=msgspec.structs.replace(world.robot, actuator_noise=other.actuator_noise),
    )
