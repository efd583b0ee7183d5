"""A controller that is told the true state of the world: what the tasks allow, with a robot that need not see.

It is a yardstick for what was learned, never a part of a skill. Like a skill it chooses among the drive's actions, but
anew in every step: it looks a little ahead along each action and takes the one that serves best.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from behaviors.trials.task import AVOID, DEFEND, HOME, PASS, SEARCH, TaskParams
from coevo.compiled import helper
from coevo.soccer.physics import PhysicsParams

__all__ = ["informed_action"]

_AHEAD_S = 0.3  # how far ahead an action is followed
_TURNING_M = 0.35  # what a radian of heading error is worth in metres
_FACING = 0.7  # cosine of the heading error up to which it drives on
_CONE = 0.5  # the robot is behind the ball if it, the ball and the aim lie in line within this angle [rad]
_STEER = 0.7  # part of that angle by which it steers beyond the ball
_PUSH_M = 0.6  # how far ahead it heads while it pushes
_ROUND_M = 0.35  # free space it keeps while it drives around the ball
_NEAR_WALL_M = 0.6
_FAR_ENOUGH_M = 1.5  # from the other robot
_WELL_AIMED = 0.8  # part of the radii within which a ball must roll past the mate's centre
_BETWEEN = 0.6  # part of the way from its goal to the ball at which it defends
_FAR_ENOUGH = 1.2  # times the way to the mate that a ball must be able to roll


@helper
def _turned(angle: float) -> float:
    """Return the angle within -pi and pi."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@helper
def _waypoint(physics: PhysicsParams, state: NDArray[np.float64], aim_x: float, aim_y: float) -> tuple[float, float]:
    """Return where the learner should drive next to push the ball towards the aim."""
    ball = state.shape[0] - 1
    x, y, ball_x, ball_y = state[0, 0], state[0, 1], state[ball, 0], state[ball, 1]
    touch = physics.robot_radius + physics.ball_radius
    course = math.atan2(aim_y - ball_y, aim_x - ball_x)
    off = _turned(math.atan2(ball_y - y, ball_x - x) - course)
    if abs(off) < _CONE:
        # The ball rolls away along the line from robot to ball: steer beyond it, so that the error shrinks.
        heading = course + off + _STEER * off
        return x + _PUSH_M * math.cos(heading), y + _PUSH_M * math.sin(heading)
    behind = touch + 0.5 * _ROUND_M
    angle = course + math.pi
    if abs(off) > 0.5 * math.pi:
        # It stands before the ball: around it, on the nearer side unless a wall is there.
        side = -1.0 if off > 0.0 else 1.0
        angle, behind = course + side * 0.6 * math.pi, touch + _ROUND_M
        if not physics.robot_radius < ball_y + behind * math.sin(angle) < physics.width - physics.robot_radius:
            angle = course - side * 0.6 * math.pi
    low, high = 1.1 * physics.robot_radius, physics.width - 1.1 * physics.robot_radius
    to_x = min(max(ball_x + behind * math.cos(angle), low), physics.length - low)
    to_y = min(max(ball_y + behind * math.sin(angle), low), high)
    return to_x, to_y


@helper
def _rolls_to_mate(physics: PhysicsParams, state: NDArray[np.float64]) -> bool:
    """Tell whether the ball would reach the mate, robot 1, if nobody touched it any more."""
    ball = state.shape[0] - 1
    to_x, to_y = state[1, 0] - state[ball, 0], state[1, 1] - state[ball, 1]
    speed = math.hypot(state[ball, 3], state[ball, 4])
    if speed <= 0.0:
        return False
    along = (to_x * state[ball, 3] + to_y * state[ball, 4]) / speed
    aside = abs(to_x * state[ball, 4] - to_y * state[ball, 3]) / speed
    touch = physics.robot_radius + physics.ball_radius
    reach = 0.5 * speed * speed * physics.substep_s / physics.ball_slowing
    return bool(along > 0.0 and aside < _WELL_AIMED * touch and reach > _FAR_ENOUGH * (along - touch))


@helper
def informed_action(
    task: TaskParams, physics: PhysicsParams, state: NDArray[np.float64], commands: NDArray[np.float64]
) -> int:
    """Return the learner's action.

    shoot, pass: it drives behind the ball as seen from the middle of the goal or from the mate, around the ball if it
    stands before it, and pushes; it backs away from a ball that will roll to the mate. avoid: it gets away from the
    other robot and keeps off the walls. search: it turns to the ball. defend: it drives between ball and own goal.
    home: it drives to its own goal.

    Args:
        task, physics: numbers of the task and the world.
        state: (bodies, 6) float64, the learner first, the ball last.
        commands: (actions, 2) float64, speed [m/s] and turn rate [rad/s] of each action.
    """
    ball = state.shape[0] - 1
    aim_x, aim_y = physics.length, 0.5 * physics.width
    if task.task == PASS:
        aim_x, aim_y = state[1, 0], state[1, 1]
    to_x, to_y = state[ball, 0], state[ball, 1]
    let_go = task.task == PASS and _rolls_to_mate(physics, state)
    if task.task < AVOID:
        to_x, to_y = _waypoint(physics, state, aim_x, aim_y)
    elif task.task == DEFEND:
        to_x, to_y = _BETWEEN * to_x, aim_y + _BETWEEN * (to_y - aim_y)
    elif task.task == HOME:
        to_x, to_y = 0.0, aim_y
    wanted = math.atan2(to_y - state[0, 1], to_x - state[0, 0])
    best, least = 0, math.inf
    for a in range(commands.shape[0]):
        speed, turn = commands[a, 0], commands[a, 1]
        error = _turned(wanted - state[0, 2] - turn * _AHEAD_S)
        middle = state[0, 2] + 0.5 * turn * _AHEAD_S
        if task.task == SEARCH:
            cost = abs(error)
        elif let_go:
            cost = speed + abs(turn)  # back, as straight as it can
        elif task.task == AVOID:
            x = state[0, 0] + speed * _AHEAD_S * math.cos(middle)
            y = state[0, 1] + speed * _AHEAD_S * math.sin(middle)
            other_x = state[1, 0] + state[1, 3] * _AHEAD_S
            other_y = state[1, 1] + state[1, 4] * _AHEAD_S
            wall = min(x, physics.length - x, y, physics.width - y) - physics.robot_radius
            cost = max(0.0, _FAR_ENOUGH_M - math.hypot(x - other_x, y - other_y))
            cost += 2.0 * max(0.0, _NEAR_WALL_M - wall)
        else:
            towards = math.cos(_turned(wanted - middle))
            # Ahead only where it more or less faces: it would else drive in circles around a near point.
            ahead = speed * (towards - _FACING) if speed > 0.0 else speed * (towards + _FACING)
            cost = _TURNING_M * abs(error) - _AHEAD_S * ahead
        if cost < least:
            best, least = a, cost
    return best
