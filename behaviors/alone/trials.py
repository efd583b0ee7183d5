"""Trials of one learner, compiled: random experience for the models, Q learning, and greedy evaluation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from behaviors.alone.informed import informed_action
from behaviors.alone.task import AVOID, COLLISION, FAILURE, GOING, SUCCESS, TaskParams, judge, move_other, start_trial
from behaviors.tabular.decisions import Decisions, end_decisions, forget_decisions, next_action
from behaviors.tabular.qlearning import Learner
from behaviors.tabular.table import Table, row_of
from coevo.compiled import borrowed, entry, helper
from coevo.skill import SkillBank
from coevo.skill.estimate import Memory, discrete_state, forget, perturb, remember
from coevo.soccer.camera import FEATURES, ROBOTS, CameraParams, Retina, look
from coevo.soccer.physics import Handles, PhysicsParams, advance, reset
from coevo.soccer.rng import below, normal, uniform

__all__ = ["INFORMED", "LEARNED", "RANDOM", "Scene", "command", "gather", "play_trial", "run_trials", "watch"]

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


@helper
def watch(
    camera: CameraParams,
    bank: SkillBank,
    memory: Memory,
    retina: Retina,
    state: NDArray[np.float64],
    robot: int,
    time: int,
    code: NDArray[np.float64],
    rng: NDArray[np.uint64],
) -> None:
    """Let a robot of side 0 see and remember; ``code``: (2,) action that led to what it sees."""
    features, areas = memory.features[robot], memory.areas[robot]
    look(camera, state, robot, 0, retina, features, areas)
    if camera.noise > 0.0:
        perturb(camera, memory.areas.shape[1] - 1, features, areas, rng)
    remember(memory, bank, robot, time, code, 0.5 * camera.columns)


@helper
def command(
    physics: PhysicsParams,
    wanted: NDArray[np.float64],
    robot: int,
    commands: NDArray[np.float64],
    rng: NDArray[np.uint64],
) -> None:
    """Give a robot's drive the ``wanted`` (2,) speed and turn rate, with the noise of the actuators."""
    commands[robot] = wanted
    if physics.actuator_noise > 0.0:
        commands[robot, 0] *= 1.0 + physics.actuator_noise * normal(rng)
        commands[robot, 1] *= 1.0 + physics.actuator_noise * normal(rng)


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
            command(scene.physics, scene.commands[action], 0, commands, rng)
            if robots > 1:
                move_other(task, chases, state, held, commands, rng)
            advance(scene.handles, scene.physics, state, commands, ball_gap, robot_gap)
            watch(scene.camera, scene.bank, scene.memory, scene.retina, state, 0, t, scene.codes[action], rng)
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


@helper
def play_trial(
    scene: Scene,
    learner: Learner,
    learning: bool,
    policy: int,
    epsilon: float,
    ease: float,
    in_view: bool,
    table: Table,
    decisions: Decisions,
    rng: NDArray[np.uint64],
) -> tuple[int, int]:
    """Play one trial; return its outcome and its steps, or -1 steps if no start was found.

    Args:
        scene, learner, learning, policy, table: see ``run_trials``.
        epsilon: probability of a random action.
        ease: of the start, 1 near the ball and what is to be done with it, 0 anywhere.
        in_view: start where the learner sees what the task is about.
        decisions: filled with those of the trial, with no rewards.
        rng: the trial's stream.
    """
    task, robots, bank = scene.task, scene.task.robots, scene.bank
    state, commands = np.zeros((robots + 1, 6)), np.zeros((robots, 2))
    ball_gap, robot_gap = np.empty(robots), np.empty((robots, robots))
    touched, held_other = np.full(1, -1), np.zeros(1, np.int64)
    if not start_trial(task, scene.physics, scene.camera, ease, in_view, state, scene.retina, scene.memory, rng):
        return GOING, -1
    reset(scene.handles, state)
    forget(scene.memory)
    # What was in view before the trial is anybody's guess; search would else know one lost state only.
    for o in range(scene.memory.side.shape[1]):
        scene.memory.side[0, o] = below(rng, 2)
    chases = uniform(rng) < task.chaser_share
    forget_decisions(decisions)
    watch(scene.camera, bank, scene.memory, scene.retina, state, 0, 0, np.zeros(2), rng)
    outcome, t = GOING, 0
    while t < task.time_limit and outcome == GOING:
        action = next_action(
            scene.memory,
            bank,
            0,
            0,
            t,
            learner,
            table,
            decisions,
            learning,
            policy == RANDOM,
            epsilon,
            -1,
            1.0,
            rng,
        )
        if policy == INFORMED:
            action = informed_action(task, scene.physics, state, scene.commands)
        command(scene.physics, scene.commands[action], 0, commands, rng)
        if robots > 1:
            move_other(task, chases, state, held_other, commands, rng)
        advance(scene.handles, scene.physics, state, commands, ball_gap, robot_gap)
        t += 1
        watch(scene.camera, bank, scene.memory, scene.retina, state, 0, t, scene.codes[action], rng)
        outcome = judge(task, scene.physics, state, scene.memory, ball_gap, robot_gap, touched, t)
    if learning and outcome == GOING:
        decisions.last[0] = row_of(table, discrete_state(scene.memory, bank, 0, 0, t))
    return outcome, t


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
        learner: numbers of Q learning; its epsilon is the share of random actions, learning or not.
        learning: update ``table``; else follow ``policy``.
        policy: LEARNED, the bank's; RANDOM, each action as long as a learned one; INFORMED, see
            behaviors.alone.informed.
        first, total: number of the first of these trials, and of all trials of the learning: set the schedule.
        seeds: (trials,) uint64.
        table: action values, updated, with room for every state that these trials may visit.
        decisions: room for those of one trial; in the end it holds those of the last.
        outcomes: (trials,) filled with GOING (time ran out), SUCCESS, FAILURE or COLLISION.
        steps: (trials,) filled with the length of each trial.
    """
    scene = borrowed(scene)
    task = scene.task
    rng = np.zeros(1, np.uint64)
    for n in range(seeds.shape[0]):
        rng[0] = seeds[n]
        progress = (first + n) / max(total - 1, 1)
        epsilon = learner.epsilon_start + (learner.epsilon_end - learner.epsilon_start) * progress
        ease = 0.0
        if learning and learner.easy_share > 0.0:
            ease = max(0.0, 1.0 - progress / learner.easy_share)
        in_view = task.in_view and not (learning and uniform(rng) < learner.anywhere_share)
        outcomes[n], steps[n] = play_trial(
            scene, learner, learning, policy, epsilon, ease, in_view, table, decisions, rng
        )
        if steps[n] < 0:
            return False
        if outcomes[n] == SUCCESS:
            decisions.rewards[decisions.made[0] - 1] += task.goal_reward
        elif outcomes[n] == COLLISION:
            decisions.rewards[decisions.made[0] - 1] += task.collision_reward
        if learning:
            end_decisions(learner, table, decisions, decisions.last[0])
    return True
