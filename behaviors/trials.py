"""Trials of one learner, compiled: random experience for the models, Q learning, and greedy evaluation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from behaviors.informed import informed_action
from behaviors.qlearning import Learner, greedy, lambda_returns, one_step
from behaviors.table import Table, row_of
from behaviors.task import AVOID, COLLISION, FAILURE, GOING, SUCCESS, TaskParams, judge, move_other, start_trial
from coevo.compiled import borrowed, entry, helper
from coevo.skill import SkillBank
from coevo.skill.estimate import Memory, discrete_state, forget, perturb, remember
from coevo.soccer.camera import FEATURES, ROBOTS, CameraParams, Retina, look
from coevo.soccer.physics import Handles, PhysicsParams, advance, reset
from coevo.soccer.rng import below, normal, uniform

__all__ = ["INFORMED", "LEARNED", "RANDOM", "Decisions", "Scene", "gather", "make_decisions", "run_trials"]

LEARNED, RANDOM, INFORMED = 0, 1, 2


class Scene(NamedTuple):
    """Everything a trial happens in."""

    handles: Handles
    physics: PhysicsParams
    camera: CameraParams
    task: TaskParams
    bank: SkillBank
    memory: Memory
    retina: Retina
    codes: NDArray[np.float64]
    commands: NDArray[np.float64]


class Decisions(NamedTuple):
    """The decisions of one trial of a learning, filled anew in each.

    rows: (room,) int64, row of the table. actions: (room,) int64. rewards: (room,) float64, what came while the action
        lasted. lengths: (room,) int64, how long it lasted in steps.
    made: (1,) int64, how many there are.
    last: (1,) int64, row of the state that time ran out in, -1 if the trial ended.
    """

    rows: NDArray[np.int64]
    actions: NDArray[np.int64]
    rewards: NDArray[np.float64]
    lengths: NDArray[np.int64]
    made: NDArray[np.int64]
    last: NDArray[np.int64]


def make_decisions(time_limit: int) -> Decisions:
    """Make room for the decisions of a trial of ``time_limit`` steps."""
    steps = [np.zeros(time_limit, np.int64) for _ in range(3)]
    return Decisions(steps[0], steps[1], np.zeros(time_limit), steps[2], np.zeros(1, np.int64), np.zeros(1, np.int64))


@helper
def _watch(
    scene: Scene,
    state: NDArray[np.float64],
    time: int,
    code: NDArray[np.float64],
    rng: NDArray[np.uint64],
) -> None:
    """Let the learner see and remember."""
    features, areas = scene.memory.features[0], scene.memory.areas[0]
    look(scene.camera, state, 0, 0, scene.retina, features, areas)
    if scene.camera.noise > 0.0:
        perturb(scene.camera, scene.memory.areas.shape[1] - 1, features, areas, rng)
    remember(scene.memory, scene.bank, 0, time, code, 0.5 * scene.camera.columns)


@helper
def _command(scene: Scene, commands: NDArray[np.float64], action: int, rng: NDArray[np.uint64]) -> None:
    """Give the learner's drive its command, with the noise of the actuators."""
    commands[0] = scene.commands[action]
    if scene.physics.actuator_noise > 0.0:
        commands[0, 0] *= 1.0 + scene.physics.actuator_noise * normal(rng)
        commands[0, 1] *= 1.0 + scene.physics.actuator_noise * normal(rng)


@entry
def gather(
    scene: Scene,
    seed: np.uint64,
    hold_min: int,
    hold_max: int,
    trial_steps: int,
    trial: NDArray[np.int64],
    inputs: NDArray[np.float64],
    features: NDArray[np.float64],
    areas: NDArray[np.float64],
) -> int:
    """Fill the rows with the experience of random actions, each held for a while; return how many rows are filled.

    trial: (rows,) number of the trial. inputs: (rows, 2) code of the action that led to the row's images.
    features: (rows, objects, 11), areas: (rows, objects), with the nearest robot in the last slot.
    """
    scene = borrowed(scene)
    task, robots = scene.task, scene.task.robots
    objects = ROBOTS + robots - 1
    state, commands = np.zeros((robots + 1, 6)), np.zeros((robots, 2))
    ball_gap, robot_gap = np.empty(robots), np.empty((robots, robots))
    touched, held = np.empty(1, np.int64), np.empty(1, np.int64)
    rng = np.full(1, seed)
    row, number = 0, 0
    while row < trial.shape[0]:
        if not start_trial(
            task, scene.physics, scene.camera, 0.0, task.in_view, state, scene.retina, scene.memory, rng
        ):
            return row
        reset(scene.handles, state)
        forget(scene.memory)
        commands[:] = 0.0
        touched[0], held[0] = -1, 0
        chases = uniform(rng) < task.chaser_share
        action, left = 0, 0
        for t in range(trial_steps):
            if left == 0:
                action, left = (
                    below(rng, scene.codes.shape[0]),
                    hold_min + below(rng, hold_max - hold_min + 1),
                )
            left -= 1
            _command(scene, commands, action, rng)
            if robots > 1:
                move_other(task, chases, state, held, commands, rng)
            advance(scene.handles, scene.physics, state, commands, ball_gap, robot_gap)
            _watch(scene, state, t, scene.codes[action], rng)
            trial[row] = number
            inputs[row] = scene.codes[action]
            for o in range(objects + 1):
                areas[row, o] = scene.memory.areas[0, o]
                for k in range(FEATURES):
                    features[row, o, k] = scene.memory.features[0, o, k]
            row += 1
            ends = judge(task, scene.physics, state, scene.memory, ball_gap, robot_gap, touched, t)
            if row == trial.shape[0] or (task.task < AVOID and ends in (SUCCESS, FAILURE)):
                break
        number += 1
    return row


@entry
def run_trials(
    scene: Scene,
    learner: Learner,
    learning: bool,
    policy: int,
    first: int,
    total: int,
    seeds: NDArray[np.uint64],
    table: Table,
    decisions: Decisions,
    outcomes: NDArray[np.int64],
    steps: NDArray[np.int64],
) -> bool:
    """Run one trial a seed; return False if no start was found.

    Args:
        scene: world, task and models.
        learner: numbers of Q learning.
        learning: explore and update ``table``; else follow ``policy``.
        policy: LEARNED, the bank's; RANDOM, each action as long as a learned one; INFORMED, see behaviors.informed.
        first, total: number of the first of these trials, and of all trials of the learning: set the schedule.
        seeds: (trials,) uint64.
        table: action values, updated, with room for every state that these trials may visit.
        decisions: room for those of one trial; in the end it holds those of the last.
        outcomes: (trials,) filled with GOING (time ran out), SUCCESS, FAILURE or COLLISION.
        steps: (trials,) filled with the length of each trial.
    """
    scene = borrowed(scene)
    task, robots, bank = scene.task, scene.task.robots, scene.bank
    values, visits = table.values, table.visits
    choices = values.shape[1]
    state, commands = np.zeros((robots + 1, 6)), np.zeros((robots, 2))
    ball_gap, robot_gap = np.empty(robots), np.empty((robots, robots))
    touched, held_other = np.empty(1, np.int64), np.empty(1, np.int64)
    standing = np.zeros(2)
    rng = np.zeros(1, np.uint64)
    rows, actions, rewards, lengths = decisions.rows, decisions.actions, decisions.rewards, decisions.lengths
    for n in range(seeds.shape[0]):
        rng[0] = seeds[n]
        progress = (first + n) / max(total - 1, 1)
        epsilon = learner.epsilon_start + (learner.epsilon_end - learner.epsilon_start) * progress
        ease = 0.0
        if learning and learner.easy_share > 0.0:
            ease = max(0.0, 1.0 - progress / learner.easy_share)
        in_view = task.in_view and not (learning and uniform(rng) < learner.anywhere_share)
        if not start_trial(task, scene.physics, scene.camera, ease, in_view, state, scene.retina, scene.memory, rng):
            return False
        reset(scene.handles, state)
        forget(scene.memory)
        # What was in view before the trial is anybody's guess; search would else know one lost state only.
        for o in range(scene.memory.side.shape[1]):
            scene.memory.side[0, o] = below(rng, 2)
        commands[:] = 0.0
        touched[0], held_other[0] = -1, 0
        chases = uniform(rng) < task.chaser_share
        count, action, held, outcome, t, before = 0, -1, 0, GOING, 0, -1
        _watch(scene, state, 0, standing, rng)
        while t < task.time_limit:
            if action < 0 or held >= bank.min_steps[0]:
                now = discrete_state(scene.memory, bank, 0, 0, t)
                if action < 0 or held >= bank.max_steps[0] or now != before:
                    row = row_of(table, now) if learning else 0
                    if learning and learner.one_step and count > 0:
                        k = count - 1
                        one_step(learner, values, visits, rows[k], actions[k], rewards[k], lengths[k], row)
                    if policy == RANDOM or (learning and uniform(rng) < epsilon):
                        action = below(rng, choices)
                    elif learning:
                        action = greedy(values, row, rng)
                    else:
                        action = bank.policy[now]
                    rows[count], actions[count], rewards[count], lengths[count] = row, action, 0.0, 0
                    count += 1
                    held, before = 0, now
            if policy == INFORMED:
                action = informed_action(task, scene.physics, state, scene.commands)
            held += 1
            lengths[count - 1] += 1
            _command(scene, commands, action, rng)
            if robots > 1:
                move_other(task, chases, state, held_other, commands, rng)
            advance(scene.handles, scene.physics, state, commands, ball_gap, robot_gap)
            t += 1
            _watch(scene, state, t, scene.codes[action], rng)
            outcome = judge(task, scene.physics, state, scene.memory, ball_gap, robot_gap, touched, t)
            if outcome != GOING:
                break
        if outcome == SUCCESS:
            rewards[count - 1] += task.goal_reward
        elif outcome == COLLISION:
            rewards[count - 1] += task.collision_reward
        outcomes[n], steps[n] = outcome, t
        decisions.made[0], decisions.last[0] = count, -1
        if learning:
            if outcome == GOING:
                decisions.last[0] = row_of(table, discrete_state(scene.memory, bank, 0, 0, t))
            if learner.one_step:
                k = count - 1
                one_step(learner, values, visits, rows[k], actions[k], rewards[k], lengths[k], decisions.last[0])
            else:
                lambda_returns(learner, values, visits, rows, actions, rewards, lengths, count, decisions.last[0])
    return True
