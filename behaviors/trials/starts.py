"""Where trials start, compiled: drawn until the bodies fit and the robots see what the task is about."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from behaviors.trials.task import AVOID, DEFEND, HOME, PASS, PASSER, SEARCH, SHOOT, SHOOTER, TaskParams
from coevo.compiled import helper, inlined
from coevo.soccer.camera import BALL, OPPONENT_GOAL, OWN_GOAL, ROBOTS, look
from coevo.soccer.physics import PhysicsParams
from coevo.soccer.placement import place
from coevo.soccer.rng import uniform
from coevo.stage.data import Stage

__all__ = ["start_one", "start_team", "start_two"]

_TRIES = 20_000
_TRIES_OF_TWO = 10_000_000  # for the easy starts of the shooter 100,000 were too few in one set of ten
_APART_M = 0.05  # from walls and from each other
_AVOID_LEAST_M, _AVOID_MOST_M = 0.7, 2.0  # between the two robots of the task avoid
# Of the task defend: how far at most the ball and the defender start from the defender's goal, and the attacker from
# the ball; it starts beyond the ball, which it faces give or take so much.
_BALL_REACH_M, _DEFENDER_REACH_M, _ATTACKER_REACH_M, _ATTACKER_SPREAD = 5.0, 4.0, 1.2, 0.7


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
    margin = radius + _APART_M
    low_x, high_x = max(margin, around_x - reach), min(physics.length - margin, around_x + reach)
    low_y, high_y = max(margin, around_y - reach), min(physics.width - margin, around_y + reach)
    state[body, 0] = low_x + (high_x - low_x) * uniform(rng)
    state[body, 1] = low_y + (high_y - low_y) * uniform(rng)
    state[body, 2] = math.pi * (2.0 * uniform(rng) - 1.0) if body < state.shape[0] - 1 else 0.0
    return math.hypot(state[body, 0] - around_x, state[body, 1] - around_y) <= reach


@helper
def _easy_reach(physics: PhysicsParams, ease: float) -> tuple[float, float]:
    """Return how far a learner may start from the ball, and the ball from where it should go [m]; ease 0: anywhere."""
    diagonal = math.sqrt(physics.length * physics.length + physics.width * physics.width)
    return 0.6 + (1.0 - ease) * diagonal, 1.0 + (1.0 - ease) * diagonal


@inlined
def _free(physics: PhysicsParams, state: NDArray[np.float64]) -> bool:
    bodies = state.shape[0]
    for i in range(bodies):
        for j in range(i):
            size = physics.ball_radius if i == bodies - 1 else physics.robot_radius
            apart = math.hypot(state[i, 0] - state[j, 0], state[i, 1] - state[j, 1])
            if apart < physics.robot_radius + size + _APART_M:
                return False
    return True


@helper
def _sees(stage: Stage, robot: int) -> None:
    memory, state, team = stage.memory, stage.body.state, stage.roles.team[robot]
    look(stage.camera, state, robot, team, stage.retina, memory.features[robot], memory.areas[robot])


@helper
def _draw_attack(physics: PhysicsParams, state: NDArray[np.float64], rng: NDArray[np.uint64]) -> bool:
    """Draw ball, attacker and defender of the task defend; False if the draw missed its places."""
    ball, middle = state.shape[0] - 1, 0.5 * physics.width
    free = _draw(physics, physics.ball_radius, 0.0, middle, _BALL_REACH_M, state, ball, rng)
    free = free and _draw(physics, physics.robot_radius, 0.0, middle, _DEFENDER_REACH_M, state, 0, rng)
    x, y = state[ball, 0], state[ball, 1]
    free = free and _draw(physics, physics.robot_radius, x, y, _ATTACKER_REACH_M, state, 1, rng)
    towards = math.atan2(y - state[1, 1], x - state[1, 0])
    state[1, 2] = towards + _ATTACKER_SPREAD * (2.0 * uniform(rng) - 1.0)
    return free and state[1, 0] > x


@helper
def start_one(task: TaskParams, stage: Stage, ease: float, in_view: bool, rng: NDArray[np.uint64]) -> bool:
    """Draw the start of a trial of one learner into the stage's state; False if none was found.

    Bodies lie anywhere on the field without touching. With starts ``in_view``, what the task is about is visible to
    the learner (for search: the ball is not; for home: the own goal). ``ease``: 1 starts near, 0 anywhere: limits how
    far the learner is from the ball and the ball from where it should go. For defend, ball and robots start where an
    attack comes from.
    """
    physics, state, areas = stage.physics, stage.body.state, stage.memory.areas
    bodies = state.shape[0]
    ball = bodies - 1
    anywhere = 2.0 * math.sqrt(physics.length * physics.length + physics.width * physics.width)
    to_ball, to_aim = _easy_reach(physics, ease)
    for _ in range(_TRIES):
        state.fill(0.0)
        if task.task == DEFEND:
            if _draw_attack(physics, state, rng) and _free(physics, state):
                _sees(stage, 0)
                if not in_view or areas[0, BALL] > 0.0:
                    return True
            continue
        if task.task == SHOOT:
            free = _draw(physics, physics.ball_radius, physics.length, 0.5 * physics.width, to_aim, state, ball, rng)
        else:
            free = _draw(physics, physics.ball_radius, 0.0, 0.0, anywhere, state, ball, rng)
        near = anywhere if task.task in (AVOID, HOME) else to_ball
        free = free and _draw(physics, physics.robot_radius, state[ball, 0], state[ball, 1], near, state, 0, rng)
        if bodies > 2:
            near = to_aim if task.task == PASS else anywhere
            free = free and _draw(physics, physics.robot_radius, state[ball, 0], state[ball, 1], near, state, 1, rng)
        if not free or not _free(physics, state):
            continue
        if task.task == AVOID:
            apart = math.hypot(state[1, 0] - state[0, 0], state[1, 1] - state[0, 1])
            if apart < _AVOID_LEAST_M or apart > _AVOID_MOST_M:
                continue
        if not in_view and task.task != SEARCH:
            return True
        _sees(stage, 0)
        sees_ball = areas[0, BALL] > 0.0
        if task.task == SEARCH:
            found = not sees_ball
        elif task.task == SHOOT:
            found = sees_ball and areas[0, OPPONENT_GOAL] > 0.0
        elif task.task == PASS:
            found = sees_ball and areas[0, ROBOTS] > 0.0
        elif task.task == HOME:
            found = areas[0, OWN_GOAL] > 0.0
        else:
            found = areas[0, ROBOTS] > 0.0
        if found:
            return True
    return False


@helper
def start_two(
    stage: Stage,
    regions: NDArray[np.float64],
    ease_passer: float,
    ease_shooter: float,
    in_view: bool,
    passer_nearer: bool,
    nearer: NDArray[np.int64],
    rng: NDArray[np.uint64],
) -> bool:
    """Draw the start of a trial of passer and shooter; False if none was found.

    Ease brings a robot near the ball, and the ball near where that robot should bring it. With starts ``in_view`` the
    passer sees ball and shooter, the shooter ball and goal.
    """
    physics, state, areas = stage.physics, stage.body.state, stage.memory.areas
    to_ball_0, to_mate = _easy_reach(physics, ease_passer)
    to_ball_1, to_goal = _easy_reach(physics, ease_shooter)
    for _ in range(_TRIES_OF_TWO):
        if not place(physics, regions, stage.roles.team, state, rng):
            return False
        x, y = state[2, 0], state[2, 1]
        apart_0, apart_1 = math.hypot(state[0, 0] - x, state[0, 1] - y), math.hypot(state[1, 0] - x, state[1, 1] - y)
        if apart_0 > to_ball_0 or apart_1 > to_mate or apart_1 > to_ball_1:
            continue
        if passer_nearer and apart_0 >= apart_1:
            continue
        if math.hypot(physics.length - x, 0.5 * physics.width - y) > to_goal:
            continue
        nearer[0] = PASSER if apart_0 < apart_1 else SHOOTER
        if not in_view:
            return True
        _sees(stage, SHOOTER)
        if areas[SHOOTER, BALL] <= 0.0 or areas[SHOOTER, OPPONENT_GOAL] <= 0.0:
            continue
        _sees(stage, PASSER)
        if areas[PASSER, BALL] > 0.0 and areas[PASSER, ROBOTS] > 0.0:
            return True
    return False


@helper
def start_team(
    stage: Stage,
    regions: NDArray[np.float64],
    learner: int,
    ease: float,
    in_view: bool,
    rng: NDArray[np.uint64],
) -> bool:
    """Draw the start of a trial of a team; False if none was found.

    Bodies lie in their regions. ``ease`` brings the ball near the goal that the learner (-1: nobody) attacks, and the
    learner near the ball, wherever their regions are. ``in_view``: the learner sees both.
    """
    physics, state, areas = stage.physics, stage.body.state, stage.memory.areas
    ball, middle = state.shape[0] - 1, 0.5 * physics.width
    to_ball, to_aim = _easy_reach(physics, ease)
    for _ in range(_TRIES):
        if not place(physics, regions, stage.roles.team, state, rng):
            return False
        if learner < 0:
            return True
        if ease > 0.0:
            aim_x = physics.length if stage.roles.team[learner] == 0 else 0.0
            free = _draw(physics, physics.ball_radius, aim_x, middle, to_aim, state, ball, rng)
            x, y = state[ball, 0], state[ball, 1]
            free = free and _draw(physics, physics.robot_radius, x, y, to_ball, state, learner, rng)
            if not free or not _free(physics, state):
                continue
        if not in_view:
            return True
        _sees(stage, learner)
        if areas[learner, BALL] > 0.0 and areas[learner, OPPONENT_GOAL] > 0.0:
            return True
    return False
