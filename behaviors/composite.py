"""Trials of several behaviours at once, compiled: steps to a goal, and learning again where they compete (B.2.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from behaviors.task import COLLISION, GOING, SUCCESS, judge, move_other, start_trial
from behaviors.trials import Learner, Scene, _command, _greedy, _learn, _watch
from coevo.compiled import borrowed, entry, helper
from coevo.skill.estimate import discrete_state, forget
from coevo.soccer.physics import advance, reset
from coevo.soccer.rng import below, uniform

__all__ = ["count_steps", "relearn_trials"]


@helper
def _trial(
    scene: Scene,
    fixed: NDArray[np.bool_],
    values: NDArray[np.float64],
    epsilon: float,
    ease: float,
    in_view: bool,
    rng: NDArray[np.uint64],
    states: NDArray[np.int64],
    actions: NDArray[np.int64],
    rewards: NDArray[np.float64],
    lengths: NDArray[np.int64],
) -> tuple[int, int, int, int]:
    """Play one trial and write down its decisions; return their number, the outcome, the steps and the last state.

    In ``fixed`` states the bank's policy acts, elsewhere ``values`` with exploration. The number is -1 if no start
    was found; the last state is where time ran out, -1 if the trial ended. See behaviors.trials.run_trials.
    """
    task, robots, bank = scene.task, scene.task.robots, scene.bank
    state, commands = np.zeros((robots + 1, 6)), np.zeros((robots, 2))
    ball_gap, robot_gap = np.empty(robots), np.empty((robots, robots))
    touched, held_other = np.full(1, -1), np.zeros(1, np.int64)
    if not start_trial(task, scene.physics, scene.camera, ease, in_view, state, scene.retina, scene.memory, rng):
        return -1, GOING, 0, -1
    reset(scene.handles, state)
    forget(scene.memory)
    for o in range(scene.memory.side.shape[1]):
        scene.memory.side[0, o] = below(rng, 2)
    chases = uniform(rng) < task.chaser_share
    count, action, held, outcome, t = 0, -1, 0, GOING, 0
    _watch(scene, state, 0, np.zeros(2), rng)
    while t < task.time_limit:
        if action < 0 or held >= bank.min_steps[0]:
            now = discrete_state(scene.memory, bank, 0, 0, t)
            if action < 0 or held >= bank.max_steps[0] or now != states[count - 1]:
                if fixed[now]:
                    action = bank.policy[now]
                elif uniform(rng) < epsilon:
                    action = below(rng, values.shape[1])
                else:
                    action = _greedy(values, now, rng)
                states[count], actions[count], rewards[count], lengths[count] = now, action, 0.0, 0
                count += 1
                held = 0
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
            return count, outcome, t, -1
    return count, GOING, t, discrete_state(scene.memory, bank, 0, 0, t)


@entry
def count_steps(
    scene: Scene,
    learner: Learner,
    never: float,
    seeds: NDArray[np.uint64],
    expected: NDArray[np.float64],
    visits: NDArray[np.int64],
) -> bool:
    """Estimate the expected physical steps to the goal under the bank's policy; return False if no start was found.

    The rule is that of the values, with steps as rewards.

    Args:
        scene: world, task and models of the behaviour.
        learner: numbers of the rule; gamma must be 1.
        never: steps that a trial counts which ends without the goal.
        seeds: (trials,) uint64.
        expected: (states, 1) float64, updated. visits: likewise, how often each was updated.
    """
    scene = borrowed(scene)
    task = scene.task
    room = task.time_limit + 1
    states, actions = np.empty(room, np.int64), np.empty(room, np.int64)
    rewards, lengths = np.empty(room), np.empty(room, np.int64)
    fixed, rng = np.ones(expected.shape[0], np.bool_), np.zeros(1, np.uint64)
    for n in range(seeds.shape[0]):
        rng[0] = seeds[n]
        count, outcome, _, last = _trial(
            scene, fixed, expected, 0.0, 0.0, task.in_view, rng, states, actions, rewards, lengths
        )
        if count < 0:
            return False
        _expect(learner, never, expected, visits, states, lengths, count, outcome, last)
    return True


@helper
def _expect(
    learner: Learner,
    never: float,
    expected: NDArray[np.float64],
    visits: NDArray[np.int64],
    states: NDArray[np.int64],
    lengths: NDArray[np.int64],
    count: int,
    outcome: int,
    last: int,
) -> None:
    """Update the expected steps backwards through one trial."""
    steps = lengths[:count].astype(np.float64)
    if outcome not in (SUCCESS, GOING):
        steps[count - 1] += never
    _learn(learner, expected, visits, states, np.zeros(count, np.int64), steps, lengths, count, last)


@entry
def relearn_trials(
    scene: Scene,
    learner: Learner,
    fixed: NDArray[np.bool_],
    first: int,
    total: int,
    seeds: NDArray[np.uint64],
    values: NDArray[np.float64],
    visits: NDArray[np.int64],
    outcomes: NDArray[np.int64],
    steps: NDArray[np.int64],
) -> bool:
    """Learn in the re-learning area, one trial a seed; return False if no start was found.

    Args:
        scene: world, task and models; the bank's policy acts in the no-more-learning areas.
        learner: numbers of Q learning.
        fixed: (states,) whether a state is in a no-more-learning area.
        first, total: number of the first of these trials, and of all trials of the learning: set the schedule.
        seeds: (trials,) uint64.
        values: (states, actions) float64, updated where not fixed; where fixed, each row's best value is ^iV.
        visits: likewise, how often each was updated.
        outcomes, steps: (trials,) filled with the outcome and the length of each trial.
    """
    scene = borrowed(scene)
    task = scene.task
    room = task.time_limit + 1
    states, actions = np.empty(room, np.int64), np.empty(room, np.int64)
    rewards, lengths = np.empty(room), np.empty(room, np.int64)
    rng = np.zeros(1, np.uint64)
    for n in range(seeds.shape[0]):
        rng[0] = seeds[n]
        progress = (first + n) / max(total - 1, 1)
        epsilon = learner.epsilon_start + (learner.epsilon_end - learner.epsilon_start) * progress
        ease = max(0.0, 1.0 - progress / learner.easy_share) if learner.easy_share > 0.0 else 0.0
        in_view = task.in_view and not uniform(rng) < learner.anywhere_share
        count, outcome, t, last = _trial(
            scene, fixed, values, epsilon, ease, in_view, rng, states, actions, rewards, lengths
        )
        if count < 0:
            return False
        if outcome == SUCCESS:
            rewards[count - 1] += task.goal_reward
        elif outcome == COLLISION:
            rewards[count - 1] += task.collision_reward
        outcomes[n], steps[n] = outcome, t
        _relearn(learner, fixed, values, visits, states, actions, rewards, lengths, count, last)
    return True


@helper
def _relearn(
    learner: Learner,
    fixed: NDArray[np.bool_],
    values: NDArray[np.float64],
    visits: NDArray[np.int64],
    states: NDArray[np.int64],
    actions: NDArray[np.int64],
    rewards: NDArray[np.float64],
    lengths: NDArray[np.int64],
    count: int,
    last: int,
) -> None:
    """Update the values backwards through one trial by (B.6).

    A stretch of decisions in the re-learning area is learned from like a trial that ran out of time in the area that
    it left for: the value of what follows is ^iV, and no return reaches across the border.
    """
    k = count - 1
    while k >= 0:
        if fixed[states[k]]:
            k -= 1
            continue
        end = k + 1
        while k >= 0 and not fixed[states[k]]:
            k -= 1
        part = slice(k + 1, end)
        after = last if end == count else states[end]
        _learn(learner, values, visits, states[part], actions[part], rewards[part], lengths[part], end - k - 1, after)
