"""The tasks that skills are learned on: where a trial starts, what the other robot does, when it ends; compiled.

One learner (robot 0), the ball, and for pass and avoid one other robot (robot 1) that follows a fixed script: it
is a part of the environment.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from behaviors.recipe import Recipe
from coevo.compiled import helper
from coevo.skill.estimate import Memory
from coevo.soccer.camera import BALL, OPPONENT_GOAL, ROBOTS, CameraParams, Retina, look
from coevo.soccer.physics import PhysicsParams
from coevo.soccer.rng import below, uniform

__all__ = [
    "AVOID",
    "COLLISION",
    "FAILURE",
    "GOING",
    "PASS",
    "SEARCH",
    "SHOOT",
    "TaskParams",
    "easy_reach",
    "judge",
    "move_other",
    "start_trial",
    "task_params",
]

SHOOT, PASS, AVOID, SEARCH = 0, 1, 2, 3
TASKS = ("shoot", "pass", "avoid", "search")
MOVERS = ("none", "standing", "random", "chaser")
GOING, SUCCESS, FAILURE, COLLISION = 0, 1, 2, 3
_TRIES = 20_000


class TaskParams(NamedTuple):
    """Numbers of a task; speeds as shares of the maximum, lengths in metres."""

    task: int
    robots: int
    in_view: bool
    time_limit: int
    mover: int
    mover_speed: float
    chaser_share: float
    chaser_speed: float
    max_speed: float
    max_turn: float
    contact_gap: float
    goal_reward: float
    collision_reward: float


def task_params(recipe: Recipe) -> TaskParams:
    """Return what the kernels need of a recipe."""
    return TaskParams(
        task=TASKS.index(recipe.task),
        robots=1 if recipe.mover.kind == "none" else 2,
        in_view=recipe.starts == "in-view",
        time_limit=recipe.time_limit_steps,
        mover=MOVERS.index(recipe.mover.kind),
        mover_speed=recipe.mover.speed,
        chaser_share=recipe.mover.share_of_chasers,
        chaser_speed=recipe.mover.chaser_speed,
        max_speed=recipe.world.robot.max_speed_mps,
        max_turn=math.radians(recipe.world.robot.max_turn_rate_dps),
        contact_gap=recipe.world.physics.contact_gap_m,
        goal_reward=recipe.goal_reward,
        collision_reward=recipe.collision_reward,
    )


@helper
def _draw(
    physics: PhysicsParams,
    radius: float,
    around_x: float,
    around_y: float,
    reach: float,
    state: NDArray[np.float64],
    body: int,
    rng: NDArray[np.uint64],
) -> bool:
    """Draw a body's pose, uniform on the part of the field within ``reach`` of a point; False if the draw missed it."""
    margin = radius + 0.05
    low_x, high_x = max(margin, around_x - reach), min(physics.length - margin, around_x + reach)
    low_y, high_y = max(margin, around_y - reach), min(physics.width - margin, around_y + reach)
    state[body, 0] = low_x + (high_x - low_x) * uniform(rng)
    state[body, 1] = low_y + (high_y - low_y) * uniform(rng)
    state[body, 2] = math.pi * (2.0 * uniform(rng) - 1.0) if body < state.shape[0] - 1 else 0.0
    return math.hypot(state[body, 0] - around_x, state[body, 1] - around_y) <= reach


@helper
def easy_reach(physics: PhysicsParams, ease: float) -> tuple[float, float]:
    """Return how far a learner may start from the ball, and the ball from where it should go [m]; ease 0: anywhere."""
    diagonal = math.sqrt(physics.length * physics.length + physics.width * physics.width)
    return 0.6 + (1.0 - ease) * diagonal, 1.0 + (1.0 - ease) * diagonal


@helper
def start_trial(
    task: TaskParams,
    physics: PhysicsParams,
    camera: CameraParams,
    ease: float,
    in_view: bool,
    state: NDArray[np.float64],
    retina: Retina,
    memory: Memory,
    rng: NDArray[np.uint64],
) -> bool:
    """Draw the start of a trial into ``state`` (bodies, 6); False if none was found.

    Bodies lie anywhere on the field without touching. With starts ``in_view``, what the task is about is visible to
    the learner (for search: the ball is not). ``ease``: 1 starts near, 0 anywhere: limits how far the learner is
    from the ball and the ball from where it should go.
    """
    bodies = state.shape[0]
    ball = bodies - 1
    diagonal = math.sqrt(physics.length * physics.length + physics.width * physics.width)
    to_ball, to_aim = easy_reach(physics, ease)
    for _ in range(_TRIES):
        state[:] = 0.0
        if task.task == SHOOT:
            free = _draw(physics, physics.ball_radius, physics.length, 0.5 * physics.width, to_aim, state, ball, rng)
        else:
            free = _draw(physics, physics.ball_radius, 0.0, 0.0, 2.0 * diagonal, state, ball, rng)
        near = 2.0 * diagonal if task.task == AVOID else to_ball
        free = free and _draw(physics, physics.robot_radius, state[ball, 0], state[ball, 1], near, state, 0, rng)
        if bodies > 2:
            near = to_aim if task.task == PASS else 2.0 * diagonal
            free = free and _draw(physics, physics.robot_radius, state[ball, 0], state[ball, 1], near, state, 1, rng)
        for i in range(bodies):
            for j in range(i):
                apart = physics.robot_radius + (physics.ball_radius if i == ball else physics.robot_radius) + 0.05
                if math.hypot(state[i, 0] - state[j, 0], state[i, 1] - state[j, 1]) < apart:
                    free = False
        if not free:
            continue
        if task.task == AVOID:
            apart = math.hypot(state[1, 0] - state[0, 0], state[1, 1] - state[0, 1])
            if apart < 0.7 or apart > 2.0:
                continue
        if not in_view and task.task != SEARCH:
            return True
        look(camera, state, 0, 0, retina, memory.features[0], memory.areas[0])
        sees_ball = memory.areas[0, BALL] > 0.0
        if task.task == SEARCH:
            if not sees_ball:
                return True
        elif task.task == SHOOT:
            if sees_ball and memory.areas[0, OPPONENT_GOAL] > 0.0:
                return True
        elif task.task == PASS:
            if sees_ball and memory.areas[0, ROBOTS] > 0.0:
                return True
        elif memory.areas[0, ROBOTS] > 0.0:
            return True
    return False


@helper
def move_other(
    task: TaskParams,
    chases: bool,
    state: NDArray[np.float64],
    held: NDArray[np.int64],
    commands: NDArray[np.float64],
    rng: NDArray[np.uint64],
) -> None:
    """Set the command of the other robot, (speed, turn rate) in ``commands[1]``.

    standing: does nothing. random: one of the 9 actions, held for 10 to 40 steps. chaser: turns to the learner, and
    drives at it when it faces it within 45 degrees. ``held``: (1,) steps that the random action still has.
    """
    if task.mover == 3 or chases:
        share = task.mover_speed if task.mover == 3 else task.chaser_speed
        to_x, to_y = state[0, 0] - state[1, 0], state[0, 1] - state[1, 1]
        error = math.atan2(to_y, to_x) - state[1, 2]
        error -= 2.0 * math.pi * math.floor(error / (2.0 * math.pi) + 0.5)
        commands[1, 0] = task.max_speed * share if abs(error) < 0.25 * math.pi else 0.0
        commands[1, 1] = min(max(4.0 * error, -task.max_turn * share), task.max_turn * share)
    elif task.mover == 2:
        if held[0] <= 0:
            commands[1, 0] = (below(rng, 3) - 1.0) * task.max_speed * task.mover_speed
            commands[1, 1] = (below(rng, 3) - 1.0) * task.max_turn * task.mover_speed
            held[0] = 10 + below(rng, 31)
        held[0] -= 1


@helper
def judge(
    task: TaskParams,
    physics: PhysicsParams,
    state: NDArray[np.float64],
    memory: Memory,
    ball_gap: NDArray[np.float64],
    robot_gap: NDArray[np.float64],
    touched: NDArray[np.int64],
    time: int,
) -> int:
    """Return how the trial stands after a step: GOING, SUCCESS, FAILURE or COLLISION.

    A goal is tested before everything else: the robot that pushed the ball over the line may follow it out.
    ``touched``: (1,) step of the learner's last contact with the ball, -1 before the first.
    """
    ball = state.shape[0] - 1
    if task.task == SHOOT and state[ball, 0] > physics.length:
        return SUCCESS
    if ball_gap[0] <= task.contact_gap:
        touched[0] = time
    if task.robots > 1:
        if task.task == PASS and ball_gap[1] <= task.contact_gap and touched[0] >= 0 and time - touched[0] <= 90:
            return SUCCESS
        if robot_gap[0, 1] <= task.contact_gap:
            return COLLISION
    if task.task == SEARCH and memory.areas[0, BALL] > 0.0:
        return SUCCESS
    if task.task < AVOID:
        if state[ball, 0] > physics.length or state[ball, 0] < 0.0:
            return FAILURE
        if state[0, 0] > physics.length or state[0, 0] < 0.0:
            return FAILURE
    return GOING
