"""The soccer world on pymunk: build it, step it from Python, or hand it to compiled code."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pymunk
from numpy.typing import ArrayLike, NDArray
from pymunk import _chipmunk

from coevo.config import WorldSettings
from coevo.soccer.field import walls
from coevo.soccer.physics import Handles

__all__ = ["World"]

_ffi, _lib = _chipmunk.ffi, _chipmunk.lib
_FULL = _lib.POSITION | _lib.ANGLE | _lib.VELOCITY | _lib.ANGULAR_VELOCITY
_VELOCITIES = _lib.VELOCITY | _lib.ANGULAR_VELOCITY


class World:
    """A field with a ball and robots in a pymunk Space.

    ``step`` is the readable, plain path: pymunk's Python methods and nothing else. The compiled path of
    ``coevo.soccer.physics`` runs on the same Space through ``handles`` and gives the same bits.

    Args:
        settings: sizes, speeds and materials.
        robots: how many robots; bodies and shapes are added in the order r0, r1, ..., ball.
    """

    def __init__(self, settings: WorldSettings, robots: int) -> None:
        self.settings = settings
        self.space = pymunk.Space()
        self.space.iterations = settings.physics.iterations
        self.space.collision_slop = settings.physics.collision_slop_m
        self._build_walls()
        self._shape_counter = int(_lib.cpSpaceGetShapeIDCounter(self.space._space))
        robot, ball = settings.robot, settings.ball
        self.robots = [
            self._disc(robot.mass_kg, robot.radius_m, robot.elasticity, robot.friction) for _ in range(robots)
        ]
        self.ball = self._disc(ball.mass_kg, ball.radius_m, ball.elasticity, ball.friction)
        self.bodies = [*self.robots, self.ball]
        self.handles = self._make_handles()

    def _build_walls(self) -> None:
        field, static = self.settings.field, self.space.static_body
        for wall in walls(field):
            shape = pymunk.Segment(static, wall.start, wall.end, 0.5 * field.wall_thickness_m)
            shape.elasticity, shape.friction = field.wall_elasticity, field.wall_friction
            self.space.add(shape)

    def _disc(self, mass: float, radius: float, elasticity: float, friction: float) -> pymunk.Body:
        body = pymunk.Body(mass, pymunk.moment_for_circle(mass, 0.0, radius))
        shape = pymunk.Circle(body, radius)
        shape.elasticity, shape.friction = elasticity, friction
        self.space.add(body, shape)
        return body

    def _make_handles(self) -> Handles:
        count = len(self.bodies)
        # Room to spare: Chipmunk must never find the buffer full, as it would free memory that numpy owns.
        full, drive = np.zeros(6 * count + 8), np.zeros(3 * count + 8)
        full_array, drive_array = self._float_array(full), self._float_array(drive)
        batches = [
            self._batch(full_array, _FULL),
            self._batch(full_array, _FULL),
            self._batch(drive_array, _VELOCITIES),
        ]
        shapes = [next(iter(body.shapes)) for body in self.bodies]
        located = [self.space._space, *batches]
        located += [body._body for body in self.bodies] + [shape._shape for shape in shapes]
        addresses = [int(_ffi.cast("uintptr_t", item)) for item in located]
        addresses.insert(4, self._shape_counter)
        # Nothing of pymunk's may stand here. A C space that outlives its Space is freed when nobody holds the bodies
        # and shapes in it any more, and a garbage collection meanwhile frees them under its hands: a crash.
        self._keep_alive: list[Any] = [batches, full_array, drive_array]
        return Handles(
            np.array(addresses, np.uint64),
            np.frombuffer(_ffi.buffer(full_array, 4), np.int32),
            full,
            np.frombuffer(_ffi.buffer(drive_array, 4), np.int32),
            drive,
        )

    @staticmethod
    def _float_array(buffer: NDArray[np.float64]) -> Any:
        array = _ffi.new("pmFloatArray *")
        array.num, array.max = 0, len(buffer)
        array.arr = _ffi.cast("cpFloat *", buffer.ctypes.data)
        return array

    @staticmethod
    def _batch(array: Any, fields: int) -> Any:
        batch = _ffi.new("pmBatchedData *")
        batch.floatArray, batch.fields = array, fields
        return batch

    @property
    def state(self) -> NDArray[np.float64]:
        """(bodies, 6) float64, robots then ball: x, y [m], heading [rad], vx, vy [m/s], turn rate [rad/s]."""
        rows = [(*b.position, b.angle, *b.velocity, b.angular_velocity) for b in self.bodies]
        return np.array(rows, np.float64)

    def place(self, state: ArrayLike) -> None:
        """Put the bodies of a World that has not moved yet where ``state`` (bodies, 6) says.

        The shapes are added anew, so that Chipmunk's search tree, and with it the order in which contacts are solved,
        is that of bodies which were there from the beginning.
        """
        shapes = [next(iter(body.shapes)) for body in self.bodies]
        self.space.remove(*shapes)
        _lib.cpSpaceSetShapeIDCounter(self.space._space, self._shape_counter)
        rows = np.asarray(state, np.float64).tolist()
        for body, (x, y, heading, vx, vy, turn) in zip(self.bodies, rows, strict=True):
            body.position, body.angle = (x, y), heading
            body.velocity, body.angular_velocity = (vx, vy), turn
        self.space.add(*shapes)

    def step(self, commands: ArrayLike, after_substep: Callable[[], object] | None = None) -> None:
        """Move on by one step (1/30 s).

        Args:
            commands: (robots, 2), speed [m/s] and turn rate [rad/s] that each drive asks for.
            after_substep: called after each substep, for what is counted between steps.
        """
        physics, robot = self.settings.physics, self.settings.robot
        substep_s = physics.step_s / physics.substeps
        speed_change = robot.max_acceleration_mps2 * substep_s
        turn_change = math.radians(robot.max_turn_acceleration_dps2) * substep_s
        ball_slowing = self.settings.ball.rolling_deceleration_mps2 * substep_s
        wanted = np.asarray(commands, np.float64).tolist()
        for _ in range(physics.substeps):
            for body, (speed, turn_rate) in zip(self.robots, wanted, strict=True):
                vx, vy = body.velocity
                dx, dy = speed * math.cos(body.angle) - vx, speed * math.sin(body.angle) - vy
                change = math.sqrt(dx * dx + dy * dy)
                if change > speed_change:
                    dx, dy = dx * (speed_change / change), dy * (speed_change / change)
                turn = min(max(turn_rate - body.angular_velocity, -turn_change), turn_change)
                body.velocity = (vx + dx, vy + dy)
                body.angular_velocity += turn
            vx, vy = self.ball.velocity
            rolling = math.sqrt(vx * vx + vy * vy)
            kept = 1.0 - ball_slowing / rolling if rolling > ball_slowing else 0.0
            self.ball.velocity = (vx * kept, vy * kept)
            self.space.step(substep_s)
            if after_substep is not None:
                after_substep()
