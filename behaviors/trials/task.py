"""The tasks that robots learn: how a trial stands, and the rewards of each robot; compiled.

In a task of one the learner is robot 0. For pass and avoid robot 1 follows a script, and for defend it attacks with a
skill: it is a part of the environment. In the task of two robot 0 is the passer and robot 1 the shooter; both attack
the goal at x = length. In the task of a team every robot may learn, and has a side.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import inlined
from coevo.skill.estimate import sees_what_it_needs
from coevo.soccer.camera import BALL
from coevo.soccer.events import goal_scored, in_contact, out_of_field
from coevo.stage import GOING
from coevo.stage.data import Stage
from coevo.stage.roles import LEARNER

__all__ = [
    "AVOID",
    "BUMPED",
    "CHANNELS",
    "COLLIDED",
    "COLLISION",
    "CONCEDED",
    "DEFEND",
    "FAILURE",
    "GIVEN_AWAY",
    "GOING",
    "HOME",
    "KICKED",
    "MOVERS",
    "PASS",
    "PASSED",
    "PASSER",
    "PASS_AND_SHOOT",
    "SEARCH",
    "SHOOT",
    "SHOOTER",
    "STRAY_GOAL",
    "SUCCEEDED",
    "SUCCESS",
    "TASKS",
    "TEAM",
    "TOUCHED",
    "Tally",
    "TaskParams",
    "judge",
]

SHOOT, PASS, AVOID, SEARCH, PASS_AND_SHOOT, DEFEND, HOME, TEAM = range(8)
TASKS = ("shoot", "pass", "avoid", "search", "pass and shoot", "defend", "home", "team")
MOVERS = ("none", "standing", "random", "chaser", "skill")
PASSER, SHOOTER = 0, 1
# How a trial stands. A stray goal: one that the shooter of the task of two, or the learner, did not touch last. In the
# task of a team a goal of team 0 is a success, and one of team 1 a failure.
SUCCESS, FAILURE, COLLISION, STRAY_GOAL = range(GOING + 1, GOING + 5)
# What a robot may be rewarded for in a step, in the order in which rewards are added. Contact lasts: kicked is that it
# begins with the ball; touched is that there is some in the step, bumped the same of another robot. Given away is a
# pass that an opponent receives.
PASSED, SUCCEEDED, COLLIDED, CONCEDED, KICKED, TOUCHED, BUMPED, GIVEN_AWAY = range(8)
CHANNELS = 8
_HOME_M = 1.0  # from the middle of its goal, a robot is at home


class TaskParams(NamedTuple):
    """Numbers of a task; speeds as shares of the maximum.

    task: one of TASKS. in_view: start where what the task is about is seen.
    mover, mover_speed, chaser_share, chaser_speed: what the other robot does, see MoverSettings.
    passer_nearer: share of trials of two in which the passer starts nearer to the ball.
    every_pass: reward each pass of a trial, not only the first.
    patience: for how many steps a learner may not see what its skill needs before the trial ends.
    gathering: only experience is wanted: a trial ends with the ball, or when the store is full.
    goal_ends: of a task of one: nothing ends a trial but goals and time. by_last_touch: only a goal after a touch of
        the learner is its own; in the task of a team it is of who touched the ball last, else of all its side.
    """

    task: int
    in_view: bool
    mover: int
    mover_speed: float
    chaser_share: float
    chaser_speed: float
    passer_nearer: float
    every_pass: bool
    patience: int
    gathering: bool
    goal_ends: bool = False
    by_last_touch: bool = False


class Tally(NamedTuple):
    """What is counted in a trial.

    rewards: (robots, CHANNELS) float64, what each robot did in the last step.
    passes: (1,) int64, so far.
    nearer: (1,) int64, the robot that started nearer to the ball. trial: (1,) int64, number of the trial.
    lost_for: (1,) int64, for how many steps a learner has not seen what its skill needs.
    touched, collisions: (robots,) int64, whether each touched the ball in the step before, and collisions so far.
    holder, held_at: (1,) int64, who had touched the ball last when the step began, and when.
    counted: (robots, CHANNELS) int64, of the task of a team: how often each did what it may be rewarded for.
    """

    rewards: NDArray[np.float64]
    passes: NDArray[np.int64]
    nearer: NDArray[np.int64]
    trial: NDArray[np.int64]
    lost_for: NDArray[np.int64]
    touched: NDArray[np.int64]
    collisions: NDArray[np.int64]
    holder: NDArray[np.int64]
    held_at: NDArray[np.int64]
    counted: NDArray[np.int64]


@inlined
def judge(task: TaskParams, stage: Stage, tally: Tally) -> int:
    """Return how the trial stands after a step, and fill the rewards of the robots.

    A goal is tested before everything else: the robot that pushed the ball over the line may follow it out.
    """
    tally.rewards.fill(0.0)
    if task.task == PASS_AND_SHOOT:
        return _judge_two(task, stage, tally)
    if task.task == TEAM:
        return _judge_team(task, stage, tally)
    return _judge_one(task, stage, tally)


@inlined
def _judge_sight(task: TaskParams, stage: Stage, tally: Tally) -> int:
    """End the trial of a learner that has not seen for long what its skill is for: nothing is to be learned there."""
    if stage.roles.role[0] != LEARNER or sees_what_it_needs(stage.memory, stage.bank, stage.roles.skill[0], 0):
        tally.lost_for[0] = 0
        return GOING
    tally.lost_for[0] += 1
    return FAILURE if tally.lost_for[0] > task.patience else GOING


@inlined
def _note_contacts(stage: Stage, tally: Tally) -> None:
    """Fill what robot 0 may be rewarded for by contact with the ball."""
    if in_contact(stage.limits, stage.body.ball_gap[0]):
        tally.rewards[0, TOUCHED] = 1.0
        if tally.touched[0] == 0:
            tally.rewards[0, KICKED] = 1.0
    tally.touched[0] = int(tally.rewards[0, TOUCHED])


@inlined
def _judge_one(task: TaskParams, stage: Stage, tally: Tally) -> int:
    body = stage.body
    tally.passes[0] = stage.events.passes[0]
    _note_contacts(stage, tally)
    scored = goal_scored(stage.physics, body.state)
    if task.task == SHOOT and scored == 0:
        if task.by_last_touch and stage.events.last_touch[0] != 0:
            return STRAY_GOAL
        tally.rewards[0, SUCCEEDED] = 1.0
        return SUCCESS
    if task.task == PASS and tally.passes[0] > 0:
        tally.rewards[0, SUCCEEDED] = 1.0
        return SUCCESS
    if task.task == DEFEND:
        if scored == 1:
            tally.rewards[0, CONCEDED] = 1.0
            return FAILURE
        return SUCCESS if scored == 0 else _judge_sight(task, stage, tally)
    if body.ball_gap.shape[0] > 1 and in_contact(stage.limits, body.robot_gap[0, 1]):
        tally.rewards[0, BUMPED] = 1.0
        if not task.goal_ends:
            tally.rewards[0, COLLIDED] = 1.0
            return COLLISION
        if stage.events.collisions[0] > tally.collisions[0]:
            tally.collisions[0] = stage.events.collisions[0]
            tally.rewards[0, COLLIDED] = 1.0
    if task.task == SEARCH and stage.memory.areas[0, BALL] > 0.0:
        tally.rewards[0, SUCCEEDED] = 1.0
        return SUCCESS
    if task.task == HOME and math.hypot(body.state[0, 0], body.state[0, 1] - 0.5 * stage.physics.width) < _HOME_M:
        tally.rewards[0, SUCCEEDED] = 1.0
        return SUCCESS
    if task.task < AVOID and (scored >= 0 or (not task.goal_ends and out_of_field(stage.physics, body.state, 0))):
        return FAILURE
    return _judge_sight(task, stage, tally)


@inlined
def _judge_two(task: TaskParams, stage: Stage, tally: Tally) -> int:
    body, events, rewards = stage.body, stage.events, tally.rewards
    passes = events.passes[PASSER]
    if passes > tally.passes[0] and (task.every_pass or tally.passes[0] == 0):
        rewards[PASSER, PASSED] = 1.0
    tally.passes[0] = passes
    scored = goal_scored(stage.physics, body.state)
    if scored == 0:
        if events.last_touch[0] != SHOOTER:
            return STRAY_GOAL
        rewards[SHOOTER, SUCCEEDED] = 1.0
        return SUCCESS
    if in_contact(stage.limits, body.robot_gap[PASSER, SHOOTER]):
        rewards[PASSER, COLLIDED], rewards[SHOOTER, COLLIDED] = 1.0, 1.0
        return COLLISION
    physics, state = stage.physics, body.state
    if scored == 1 or out_of_field(physics, state, PASSER) or out_of_field(physics, state, SHOOTER):
        return FAILURE
    return GOING


@inlined
def _note_touches(stage: Stage, tally: Tally) -> None:
    """Fill what the robots of a team may be rewarded for by contact with the ball.

    A ball is given away as it is passed (see ``record_contacts``), but to an opponent.
    """
    ball_gap, teams, events = stage.body.ball_gap, stage.roles.team, stage.events
    holder, held_at, now = tally.holder[0], tally.held_at[0], events.touched_at[0]
    for r in range(teams.shape[0]):
        if in_contact(stage.limits, ball_gap[r]):
            tally.rewards[r, TOUCHED] = 1.0
            if tally.touched[r] == 0:
                tally.rewards[r, KICKED] = 1.0
                free = holder >= 0 and not in_contact(stage.limits, ball_gap[holder])
                if free and teams[holder] != teams[r] and now - held_at <= stage.limits.pass_window:
                    tally.rewards[holder, GIVEN_AWAY] += 1.0
            holder, held_at = r, now
        tally.touched[r] = int(tally.rewards[r, TOUCHED])
    tally.holder[0], tally.held_at[0] = events.last_touch[0], events.touched_at[0]


@inlined
def _judge_team(task: TaskParams, stage: Stage, tally: Tally) -> int:
    body, events, teams, rewards = stage.body, stage.events, stage.roles.team, tally.rewards
    _note_touches(stage, tally)
    scored = goal_scored(stage.physics, body.state)
    tally.passes[0] = 0
    for r in range(teams.shape[0]):
        rewards[r, PASSED] = events.passes[r] - tally.counted[r, PASSED]
        tally.passes[0] += events.passes[r]
        rewards[r, COLLIDED] = events.collisions[r] - tally.counted[r, COLLIDED]
        for other in range(teams.shape[0]):
            if other != r and in_contact(stage.limits, body.robot_gap[r, other]):
                rewards[r, BUMPED] = 1.0
        if scored == teams[r] and (events.last_touch[0] == r or not task.by_last_touch):
            rewards[r, SUCCEEDED] = 1.0
        if scored >= 0 and scored != teams[r]:
            rewards[r, CONCEDED] = 1.0
        for event in range(CHANNELS):
            tally.counted[r, event] += int(rewards[r, event])
    if scored < 0:
        return GOING
    return SUCCESS if scored == 0 else FAILURE
