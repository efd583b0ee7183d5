"""Trials, compiled: begin, the stage's loop, and what is learned at the end.

Trials in a compiled world are run by ``run_trials``. Where images come from elsewhere, Python runs the same loop with
``begin_trial``, ``act``, ``take_in``, ``judge_trial`` and ``end_trial``, which are made of the same parts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from behaviors.actor_critic.updates import earn, earn_nothing, learn_backwards
from behaviors.tabular.decisions import decide, end_decisions
from behaviors.tabular.table import row_of
from behaviors.trials.informed import informed_action
from behaviors.trials.minds import Minds, decisions_of, learner_of, outlook_of, table_of
from behaviors.trials.starts import start_one, start_team, start_two
from behaviors.trials.task import (
    AVOID,
    CHANNELS,
    DEFEND,
    FAILURE,
    PASS_AND_SHOOT,
    SUCCESS,
    TEAM,
    Tally,
    TaskParams,
    judge,
)
from coevo.compiled import borrowed, entry, helper, inlined
from coevo.skill.estimate import remember, sees_what_it_needs
from coevo.soccer.camera import FEATURES
from coevo.soccer.rng import below, uniform
from coevo.stage.data import Stage
from coevo.stage.kernels import begin, drive, new_state, sense, start_action, state_of_skill, step
from coevo.stage.loop import GOING, run_episode
from coevo.stage.roles import CHASER, INFORMED, LEARNER, ROAMER, SKILL, STANDING, follow_script
from coevo.stage.tape import Tape, is_taping, record_choice, record_state

__all__ = ["Results", "Trial", "act", "begin_trial", "end_trial", "judge_trial", "run_trials", "take_in"]

_CHASES, _ROAMS, _PLAYS = 3, 2, 4  # of MOVERS


class Trial(NamedTuple):
    """What trials work on.

    regions: (bodies, 6), where those of a task of two or of a team start, see coevo.soccer.placement.
    progress: (1,) float64, share of the trials that are done: the beta of (3.10); it sets epsilon too.
    tape: of the latest trial.
    """

    stage: Stage
    task: TaskParams
    minds: Minds
    tally: Tally
    regions: NDArray[np.float64]
    progress: NDArray[np.float64]
    tape: Tape


class Results(NamedTuple):
    """How trials went: (trials,) int64 each.

    ends: GOING (time ran out), SUCCESS, FAILURE, COLLISION or STRAY_GOAL. passes, steps: how many.
    nearer: of a task of two, the robot that started nearer to the ball.
    kicks, collisions: of robot 0, steps of contact with the ball and how often it ran into another robot.
    counts: (trials, robots, CHANNELS), of a task of a team how often each robot did what it may be rewarded for; of
        another task of no robots.
    """

    ends: NDArray[np.int64]
    passes: NDArray[np.int64]
    steps: NDArray[np.int64]
    nearer: NDArray[np.int64]
    kicks: NDArray[np.int64]
    collisions: NDArray[np.int64]
    counts: NDArray[np.int64]


@inlined
def _is_learning(trial: Trial, robot: int) -> bool:
    return bool(trial.stage.roles.role[robot] == LEARNER)


@inlined
def _ease(trial: Trial, robot: int) -> float:
    """Return how easy the start should be for a robot: less and less, none without learning or with old knowledge."""
    learner = learner_of(trial.minds, robot)
    if not _is_learning(trial, robot) or trial.minds.old[robot] >= 0 or learner.easy_share <= 0.0:
        return 0.0
    return float(max(0.0, 1.0 - trial.progress[0] / learner.easy_share))


@inlined
def _start_one(trial: Trial, rng: NDArray[np.uint64]) -> bool:
    learner, in_view = learner_of(trial.minds, 0), trial.task.in_view
    if _is_learning(trial, 0) and not learner.follows:
        in_view = in_view and not uniform(rng) < learner.anywhere_share
    return start_one(trial.task, trial.stage, _ease(trial, 0), in_view, rng)


@inlined
def _start_two(trial: Trial, rng: NDArray[np.uint64]) -> bool:
    anywhere = 0.0
    for robot in range(2):
        if _is_learning(trial, robot):
            anywhere = max(anywhere, learner_of(trial.minds, robot).anywhere_share)
    in_view = trial.task.in_view and not (anywhere > 0.0 and uniform(rng) < anywhere)
    ease_passer, ease_shooter = _ease(trial, 0), _ease(trial, 1)
    if ease_passer > 0.0 and ease_shooter > 0.0:  # a start that is easy for both hardly exists
        if below(rng, 2) == 0:
            ease_passer = 0.0
        else:
            ease_shooter = 0.0
    share = trial.task.passer_nearer
    nearer = share > 0.0 and ease_shooter <= 0.0 and uniform(rng) < share
    return start_two(trial.stage, trial.regions, ease_passer, ease_shooter, in_view, nearer, trial.tally.nearer, rng)


@inlined
def _start_team(trial: Trial, rng: NDArray[np.uint64]) -> bool:
    """Several that learn take turns in having an easy start, and start where it is no matter what they see."""
    learner, learners = -1, 0
    for robot in range(trial.stage.roles.role.shape[0]):
        if _is_learning(trial, robot):
            learners += 1
            if learners == 1 or below(rng, learners) == 0:
                learner = robot
    ease = _ease(trial, learner) if learner >= 0 else 0.0
    in_view = trial.task.in_view and learners == 1
    return start_team(trial.stage, trial.regions, learner, ease, in_view, rng)


@inlined
def _cast_other(trial: Trial, rng: NDArray[np.uint64]) -> None:
    """Give the other robot of a task of one its part in this trial."""
    task, roles = trial.task, trial.stage.roles
    chases = uniform(rng) < task.chaser_share
    if roles.role.shape[0] > 1:
        roles.role[1], roles.share[1] = STANDING, task.mover_speed
        if task.mover == _CHASES:
            roles.role[1] = CHASER
        elif chases:
            roles.role[1], roles.share[1] = CHASER, task.chaser_speed
        elif task.mover == _ROAMS:
            roles.role[1] = ROAMER
        elif task.mover == _PLAYS:
            roles.role[1] = SKILL


@helper
def _begin(trial: Trial, number: int, total: int, rng: NDArray[np.uint64]) -> bool:
    """Place everything and forget the trial before; False if no start was found."""
    minds, tally = trial.minds, trial.tally
    trial.progress[0] = number / max(total - 1, 1)
    task = trial.task.task
    if task == TEAM:
        found = _start_team(trial, rng)
    else:
        found = _start_two(trial, rng) if task == PASS_AND_SHOOT else _start_one(trial, rng)
    if not found:
        return False
    begin(trial.stage, rng)
    if task not in (PASS_AND_SHOOT, TEAM):
        _cast_other(trial, rng)
    if is_taping(trial.tape):
        record_state(trial.tape, trial.stage, 0)
    tally.trial[0], tally.passes[0], tally.lost_for[0] = number, 0, 0
    tally.holder[0], tally.held_at[0] = -1, 0
    tally.touched.fill(0)
    tally.collisions.fill(0)
    tally.counted.fill(0)
    for robot in range(trial.stage.roles.role.shape[0]):
        learner = learner_of(minds, robot)
        minds.epsilon[robot] = learner.epsilon_start + (learner.epsilon_end - learner.epsilon_start) * trial.progress[0]
        minds.decisions.made[robot] = 0
    return True


@inlined
def _keep(trial: Trial) -> None:
    """Write what robots see now, and the action that led to it, into their stores."""
    minds, memory, store = trial.minds, trial.stage.memory, trial.minds.store
    for robot in range(minds.stores.shape[0]):
        if minds.stores[robot]:
            row = store.written[robot, 0] % store.trial.shape[1]
            store.written[robot, 0] += 1
            store.trial[robot, row] = trial.tally.trial[0]
            for k in range(2):
                store.inputs[robot, row, k] = trial.stage.body.codes[robot, k]
            for o in range(store.areas.shape[2]):
                store.areas[robot, row, o] = memory.areas[robot, o]
                for k in range(FEATURES):
                    store.features[robot, row, o, k] = memory.features[robot, o, k]


@inlined
def _see(trial: Trial, time: int, rng: NDArray[np.uint64]) -> None:
    sense(trial.stage, time, rng)
    if time > 0:
        _keep(trial)


@inlined
def _choose(trial: Trial, robot: int, time: int, rng: NDArray[np.uint64]) -> int:
    """Return the action of a robot that learns, or acts by what it has learned: the one under way, or a new one."""
    stage, minds = trial.stage, trial.minds
    bank, skill = stage.bank, stage.roles.skill[robot]
    learning = _is_learning(trial, robot)
    now = new_state(stage, robot, skill, time)
    if now >= 0:
        known = int(bank.policy[bank.first[skill] + now])
        action = known
        if minds.at_random[robot]:
            action = below(rng, stage.drive.codes.shape[0])
        elif learning and sees_what_it_needs(stage.memory, bank, skill, robot):
            reused, old = minds.old[robot], -1
            if reused >= 0:
                old = int(bank.policy[bank.first[reused] + state_of_skill(stage, robot, reused, time)])
            learner, table, decisions = learner_of(minds, robot), table_of(minds, robot), decisions_of(minds, robot)
            epsilon = minds.epsilon[robot]
            if learner.actor_critic:
                count = decisions.made[0]
                earn_nothing(minds.outlook, robot, count)
                if learner.one_step and count > 0:
                    learn_backwards(learner, table, outlook_of(minds, robot), decisions, count - 1, row_of(table, now))
            action = decide(learner, table, decisions, now, known, old, epsilon, trial.progress[0], rng)
        elif not learning and minds.epsilon[robot] > 0.0 and uniform(rng) < minds.epsilon[robot]:
            action = below(rng, stage.drive.codes.shape[0])
        start_action(stage, robot, skill, now, action)
    stage.doing.held[robot] += 1
    if learning and minds.decisions.made[robot] > 0:
        minds.decisions.lengths[robot, minds.decisions.made[robot] - 1] += 1
    return int(stage.doing.action[robot])


@inlined
def _act(trial: Trial, time: int, rng: NDArray[np.uint64]) -> None:
    stage, tape = trial.stage, trial.tape
    taping = is_taping(tape)
    for robot in range(stage.roles.role.shape[0]):
        role, skill = stage.roles.role[robot], -1
        if role in (LEARNER, SKILL):
            skill = int(stage.roles.skill[robot])
            action = _choose(trial, robot, time, rng)
        elif role == INFORMED:
            action = informed_action(trial.task, stage.physics, stage.body.state, stage.drive.commands)
        elif role == STANDING:
            action = -1
        else:
            action = follow_script(stage, robot, rng)
        if action >= 0:
            drive(stage, robot, action, rng)
        if taping:
            record_choice(tape, stage, robot, time, skill, action, -1)
    step(stage, time)
    if taping:
        record_state(tape, stage, time + 1)


@inlined
def _judge(trial: Trial, _time: int) -> int:
    """Judge, and give those who learn their rewards."""
    minds, task, rewards = trial.minds, trial.task, trial.tally.rewards
    ends = judge(task, trial.stage, trial.tally)
    for robot in range(rewards.shape[0]):
        if _is_learning(trial, robot):
            last = minds.decisions.made[robot] - 1
            for channel in range(CHANNELS):
                if last >= 0 and rewards[robot, channel] != 0.0:  # before its first decision nothing is its doing
                    earned = minds.rewards[robot, channel] * rewards[robot, channel]
                    minds.decisions.rewards[robot, last] += earned
                    earn(minds.outlook, robot, last, channel, rewards[robot, channel])
    if task.gathering:
        return _judge_gathering(trial, ends)
    return ends


@inlined
def _judge_gathering(trial: Trial, ends: int) -> int:
    """Experience goes on after collisions, and where the task is not about the ball to the end of the time."""
    store = trial.minds.store
    if store.written[0, 0] >= store.trial.shape[1]:
        return SUCCESS
    about_ball = trial.task.task < AVOID or trial.task.task == DEFEND
    return ends if about_ball and ends in (SUCCESS, FAILURE) else GOING


@helper
def _end(trial: Trial, ends: int, time: int) -> None:
    """Let the robots that learn do so."""
    stage, minds = trial.stage, trial.minds
    for robot in range(stage.roles.role.shape[0]):
        if _is_learning(trial, robot):
            table, last = table_of(minds, robot), -1
            if ends == GOING:
                last = row_of(table, state_of_skill(stage, robot, stage.roles.skill[robot], time))
            learner, decisions = learner_of(minds, robot), decisions_of(minds, robot)
            if not learner.actor_critic:
                end_decisions(learner, table, decisions, last, ends not in (GOING, SUCCESS))
            elif decisions.made[0] > 0:
                first = decisions.made[0] - 1 if learner.one_step else 0
                learn_backwards(learner, table, outlook_of(minds, robot), decisions, first, last)


@entry
def run_trials(
    trial: Trial,
    time_limit: int,
    first: int,
    total: int,
    seeds: NDArray[np.uint64],
    results: Results,
) -> int:
    """Run one trial a seed; return how many were run: fewer if no start was found, or a gathering's store is full.

    Args:
        trial: stage, task and minds; the tables of those who learn have room for what these trials may visit.
        time_limit: of a trial [steps].
        first, total: number of the first of these trials, and of all trials of the learning: set the schedule.
        seeds: (trials,) uint64; the trials of a gathering all draw from the stream of the first.
        results: filled.
    """
    trial, results = borrowed(trial), borrowed(results)
    store, tally = trial.minds.store, trial.tally
    rng = np.zeros(1, np.uint64)
    for n in range(seeds.shape[0]):
        if n == 0 or not trial.task.gathering:
            rng[0] = seeds[n]
        if not _begin(trial, first + n, total, rng):
            return n
        ends, time = run_episode(trial, time_limit, rng, _see, _act, _judge)
        _end(trial, ends, time)
        results.ends[n], results.passes[n], results.steps[n] = ends, tally.passes[0], time
        results.nearer[n] = tally.nearer[0]
        results.kicks[n] = trial.stage.events.kicks[0]
        results.collisions[n] = trial.stage.events.collisions[0]
        for robot in range(tally.counted.shape[0]):
            for event in range(CHANNELS):
                results.counts[n, robot, event] = tally.counted[robot, event]
        if trial.task.gathering and store.written[0, 0] >= store.trial.shape[1]:
            return n + 1
    return int(seeds.shape[0])


@entry
def begin_trial(trial: Trial, number: int, total: int, rng: NDArray[np.uint64]) -> bool:
    """Place everything and forget the trial before; False if no start was found."""
    found: bool = _begin(borrowed(trial), number, total, rng)
    return found


@entry
def act(trial: Trial, time: int, rng: NDArray[np.uint64]) -> None:
    """Let all robots choose and move, from a time to the next."""
    _act(borrowed(trial), time, rng)


@entry
def take_in(trial: Trial, time: int) -> None:
    """Let all robots remember, and keep, features and areas that were put into their memory from elsewhere."""
    trial = borrowed(trial)
    stage = trial.stage
    for robot in range(stage.roles.role.shape[0]):
        remember(stage.memory, stage.bank, robot, time, stage.body.codes[robot], 0.5 * stage.camera.columns)
    if time > 0:
        _keep(trial)


@entry
def judge_trial(trial: Trial, time: int) -> int:
    """Return how the trial stands after a step, and give those who learn their rewards."""
    standing: int = _judge(borrowed(trial), time)
    return standing


@entry
def end_trial(trial: Trial, ends: int, time: int) -> None:
    """Let the robots that learn do so; ``ends``: how the trial stood after its last step, number ``time``."""
    _end(borrowed(trial), ends, time)
