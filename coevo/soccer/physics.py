"""One step of the world in compiled code, on a pymunk Space.

A drive is a servo of limited force: in each substep a robot's velocity moves towards what its wheels ask for, by
no more than its acceleration allows. Setting the velocity outright would cancel the impulses of contacts, and
robots would push through walls.

State of a world: (bodies, 6) float64, robots in order, then the ball: x, y [m], heading [rad, CCW], vx, vy [m/s],
turn rate [rad/s].
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import entry, helper, inlined
from coevo.config import WorldSettings
from coevo.soccer import chipmunk

__all__ = ["Handles", "PhysicsParams", "advance", "physics_params", "put_ball", "replay", "reset"]

# Positions in Handles.pointers; bodies follow, then shapes.
SPACE, READ, WRITE, DRIVE, SHAPE_COUNTER, BODIES = 0, 1, 2, 3, 4, 5


class Handles(NamedTuple):
    """Where a Space lives in memory.

    pointers: (5 + 2 bodies,) uint64: space, batch reader, batch writer, velocity writer, value of the shape
        counter before the moving shapes were added, bodies, shapes.
    full_count, drive_count: (1,) int32, positions in the two buffers.
    full: (bodies * 6 + 8,) float64, what the reader and writer move.
    drive: (bodies * 3,) float64, what the velocity writer moves.
    """

    pointers: NDArray[np.uint64]
    full_count: NDArray[np.int32]
    full: NDArray[np.float64]
    drive_count: NDArray[np.int32]
    drive: NDArray[np.float64]


class PhysicsParams(NamedTuple):
    """Numbers of the world that the kernels need, in SI units."""

    substeps: int
    substep_s: float
    speed_change: float
    turn_change: float
    ball_slowing: float
    robot_radius: float
    ball_radius: float
    length: float
    width: float
    mouth_low: float
    mouth_high: float
    actuator_noise: float


def physics_params(world: WorldSettings) -> PhysicsParams:
    """Return what the compiled step needs of the settings."""
    substep_s = world.physics.step_s / world.physics.substeps
    field, robot = world.field, world.robot
    return PhysicsParams(
        substeps=world.physics.substeps,
        substep_s=substep_s,
        speed_change=robot.max_acceleration_mps2 * substep_s,
        turn_change=math.radians(robot.max_turn_acceleration_dps2) * substep_s,
        ball_slowing=world.ball.rolling_deceleration_mps2 * substep_s,
        robot_radius=robot.radius_m,
        ball_radius=world.ball.radius_m,
        length=field.length_m,
        width=field.width_m,
        mouth_low=0.5 * (field.width_m - field.goal_width_m),
        mouth_high=0.5 * (field.width_m + field.goal_width_m),
        actuator_noise=robot.actuator_noise,
    )


@helper
def _write_state(handles: Handles, state: NDArray[np.float64]) -> None:
    bodies = state.shape[0]
    for i in range(bodies):
        for k in range(6):
            handles.full[6 * i + k] = state[i, k]
    handles.full_count[0] = 0
    for i in range(bodies):
        chipmunk.set_body(handles.pointers[BODIES + i], handles.pointers[WRITE])


@helper
def put_ball(handles: Handles, state: NDArray[np.float64]) -> None:
    """Put the ball where its row of ``state`` says, in the middle of a game."""
    ball = state.shape[0] - 1
    for k in range(6):
        handles.full[k] = state[ball, k]
    handles.full_count[0] = 0
    chipmunk.set_body(handles.pointers[BODIES + ball], handles.pointers[WRITE])


@helper
def reset(handles: Handles, state: NDArray[np.float64]) -> None:
    """Put the bodies of a used Space where ``state`` says, and leave nothing of the past behind.

    Bias velocities, cached impulses, shape numbers and the shape of the search tree survive a mere change of
    positions. So the moving shapes are taken out, an empty step forgets contacts and bias, and the shapes are
    put back in order: the game that follows is the one a new Space would play.
    """
    bodies = state.shape[0]
    space = handles.pointers[SPACE]
    for i in range(bodies):
        chipmunk.remove_shape(space, handles.pointers[BODIES + bodies + i])
    chipmunk.set_shape_counter(space, handles.pointers[SHAPE_COUNTER])
    _write_state(handles, state)
    chipmunk.step(space, 1e-9)
    _write_state(handles, state)
    chipmunk.set_time_step(space, 0.0)
    for i in range(bodies):
        chipmunk.add_shape(space, handles.pointers[BODIES + bodies + i])


@inlined
def advance(
    handles: Handles,
    params: PhysicsParams,
    state: NDArray[np.float64],
    commands: NDArray[np.float64],
    ball_gap: NDArray[np.float64],
    robot_gap: NDArray[np.float64],
) -> None:
    """Move the world on by one step (1/30 s).

    Args:
        handles: the Space, which must hold ``state``.
        params: numbers of the world.
        state: (robots + 1, 6), replaced by the state after the step.
        commands: (robots, 2), forward speed [m/s] and turn rate [rad/s] that each drive asks for.
        ball_gap: (robots,), set to the smallest gap between robot and ball in this step [m].
        robot_gap: (robots, robots), likewise between robots (both triangles, diagonal untouched).
    """
    bodies = state.shape[0]
    ball = bodies - 1
    space = handles.pointers[SPACE]
    drive = handles.drive
    for i in range(ball):
        ball_gap[i] = math.inf
        for j in range(ball):
            robot_gap[i, j] = math.inf
    for _ in range(params.substeps):
        for i in range(ball):
            speed = commands[i, 0]
            dx = speed * math.cos(state[i, 2]) - state[i, 3]
            dy = speed * math.sin(state[i, 2]) - state[i, 4]
            change = math.sqrt(dx * dx + dy * dy)
            if change > params.speed_change:
                dx *= params.speed_change / change
                dy *= params.speed_change / change
            turn = commands[i, 1] - state[i, 5]
            turn = min(max(turn, -params.turn_change), params.turn_change)
            drive[3 * i] = state[i, 3] + dx
            drive[3 * i + 1] = state[i, 4] + dy
            drive[3 * i + 2] = state[i, 5] + turn
        rolling = math.sqrt(state[ball, 3] * state[ball, 3] + state[ball, 4] * state[ball, 4])
        kept = 0.0
        if rolling > params.ball_slowing:
            kept = 1.0 - params.ball_slowing / rolling
        drive[3 * ball] = state[ball, 3] * kept
        drive[3 * ball + 1] = state[ball, 4] * kept
        drive[3 * ball + 2] = state[ball, 5]
        handles.drive_count[0] = 0
        for i in range(bodies):
            chipmunk.set_body(handles.pointers[BODIES + i], handles.pointers[DRIVE])
        chipmunk.step(space, params.substep_s)
        handles.full_count[0] = 0
        for i in range(bodies):
            chipmunk.get_body(handles.pointers[BODIES + i], handles.pointers[READ])
        for i in range(bodies):
            for k in range(6):
                state[i, k] = handles.full[6 * i + k]
        for i in range(ball):
            dx = state[i, 0] - state[ball, 0]
            dy = state[i, 1] - state[ball, 1]
            gap = math.sqrt(dx * dx + dy * dy) - params.robot_radius - params.ball_radius
            ball_gap[i] = min(ball_gap[i], gap)
            for j in range(i):
                dx = state[i, 0] - state[j, 0]
                dy = state[i, 1] - state[j, 1]
                gap = math.sqrt(dx * dx + dy * dy) - 2.0 * params.robot_radius
                robot_gap[i, j] = min(robot_gap[i, j], gap)
                robot_gap[j, i] = robot_gap[i, j]


@entry
def replay(
    handles: Handles,
    params: PhysicsParams,
    start: NDArray[np.float64],
    commands: NDArray[np.float64],
    states: NDArray[np.float64],
) -> None:
    """Run pure physics: reset to ``start`` (bodies, 6), follow ``commands`` (steps, robots, 2), keep every state.

    ``states``: (steps, bodies, 6), filled with the state after each step.
    """
    bodies = start.shape[0]
    state = start.copy()
    ball_gap = np.empty(bodies - 1)
    robot_gap = np.empty((bodies - 1, bodies - 1))
    reset(handles, state)
    for t in range(commands.shape[0]):
        advance(handles, params, state, commands[t], ball_gap, robot_gap)
        states[t] = state
