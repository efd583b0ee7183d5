"""Trials of two robots that learn to pass and to shoot, compiled (Uchibe 1999, 3.5).

Robot 0 is the passer, robot 1 the shooter; both attack the goal at x = length. Each has its own models, table and
store, and a role. One trial is ``begin_trial``, then ``act`` and ``take_in`` in each step, then ``end_trial``: compiled
trials (``run_pair``) and those with images from elsewhere (behaviors.pair.transfer) are made of the same pieces.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from behaviors.alone.task import COLLISION, FAILURE, GOING, SUCCESS, easy_reach
from behaviors.alone.trials import command, watch
from behaviors.pair.data import LEARNING, PASSER, RANDOM, SHOOTER, STATIONARY, Pair, Player
from behaviors.tabular.decisions import end_decisions, forget_decisions, next_action
from behaviors.tabular.table import row_of
from coevo.compiled import borrowed, entry, helper, inlined
from coevo.skill.estimate import discrete_state, forget, remember
from coevo.soccer.camera import BALL, FEATURES, OPPONENT_GOAL, ROBOTS, look
from coevo.soccer.events import clear_events, goal_scored, out_of_field, record_contacts
from coevo.soccer.physics import advance, reset
from coevo.soccer.placement import place
from coevo.soccer.rng import below, uniform

__all__ = ["STRAY_GOAL", "act", "begin_trial", "end_trial", "run_pair", "take_in"]

STRAY_GOAL = 4  # how a trial ends, besides those of behaviors.alone.task: a goal that the shooter did not touch last
_TRIES = 10_000_000  # of drawing a start; for the easy ones of the shooter 100,000 were too few in one set of ten


@helper
def _start(
    pair: Pair, ease_passer: float, ease_shooter: float, in_view: bool, passer_nearer: bool, rng: NDArray[np.uint64]
) -> bool:
    """Draw the start of a trial; False if none was found.

    Ease brings a robot near the ball, and the ball near where that robot should bring it.
    """
    physics, state, memory = pair.physics, pair.stage.state, pair.memory
    to_ball_0, to_mate = easy_reach(physics, ease_passer)
    to_ball_1, to_goal = easy_reach(physics, ease_shooter)
    for _ in range(_TRIES):
        if not place(physics, pair.regions, pair.stage.teams, state, rng):
            return False
        x, y = state[2, 0], state[2, 1]
        apart_0, apart_1 = math.hypot(state[0, 0] - x, state[0, 1] - y), math.hypot(state[1, 0] - x, state[1, 1] - y)
        if apart_0 > to_ball_0 or apart_1 > to_mate or apart_1 > to_ball_1:
            continue
        if passer_nearer and apart_0 >= apart_1:
            continue
        if math.hypot(physics.length - x, 0.5 * physics.width - y) > to_goal:
            continue
        pair.stage.nearer[0] = PASSER if apart_0 < apart_1 else SHOOTER
        if not in_view:
            return True
        look(pair.camera, state, SHOOTER, 0, pair.retina, memory.features[SHOOTER], memory.areas[SHOOTER])
        if memory.areas[SHOOTER, BALL] <= 0.0 or memory.areas[SHOOTER, OPPONENT_GOAL] <= 0.0:
            continue
        look(pair.camera, state, PASSER, 0, pair.retina, memory.features[PASSER], memory.areas[PASSER])
        if memory.areas[PASSER, BALL] > 0.0 and memory.areas[PASSER, ROBOTS] > 0.0:
            return True
    return False


@helper
def _ease(player: Player, progress: float) -> float:
    share = player.learner.easy_share
    if player.role != LEARNING or player.old >= 0 or share <= 0.0:
        return 0.0
    return max(0.0, 1.0 - progress / share)


@helper
def _anywhere(player: Player) -> float:
    return player.learner.anywhere_share if player.role == LEARNING else 0.0


@entry
def begin_trial(pair: Pair, progress: float, rng: NDArray[np.uint64]) -> bool:
    """Place everything and forget the trial before; False if no start was found.

    ``progress``: share of the period's trials that are done; sets how easy missions are.
    """
    passer, shooter = pair.players
    anywhere = max(_anywhere(passer), _anywhere(shooter))
    in_view = pair.rules.in_view and not (anywhere > 0.0 and uniform(rng) < anywhere)
    ease_passer, ease_shooter = _ease(passer, progress), _ease(shooter, progress)
    if ease_passer > 0.0 and ease_shooter > 0.0:  # a start that is easy for both hardly exists
        if below(rng, 2) == 0:
            ease_passer = 0.0
        else:
            ease_shooter = 0.0
    share = pair.rules.passer_nearer
    nearer = share > 0.0 and ease_shooter <= 0.0 and uniform(rng) < share
    if not _start(pair, ease_passer, ease_shooter, in_view, nearer, rng):
        return False
    reset(pair.handles, pair.stage.state)
    forget(pair.memory)
    clear_events(pair.events)
    pair.stage.commands[:] = 0.0
    pair.stage.codes[:] = 0.0
    pair.stage.held[:] = 0
    pair.stage.passes[0] = 0
    for robot in range(2):
        for o in range(pair.memory.side.shape[1]):
            pair.memory.side[robot, o] = below(rng, 2)
    forget_decisions(passer.decisions)
    forget_decisions(shooter.decisions)
    return True


@inlined
def _reward(player: Player, amount: float) -> None:
    if player.role == LEARNING:
        player.decisions.rewards[player.decisions.made[0] - 1] += amount


@inlined
def _judge(pair: Pair, time: int) -> int:
    """Give rewards for the step, and return how the trial stands after it; a goal is tested before everything else."""
    physics, stage, events, rules = pair.physics, pair.stage, pair.events, pair.rules
    passer, shooter = pair.players
    before = events.passes[PASSER]
    record_contacts(pair.limits, stage.teams, time, stage.ball_gap, stage.robot_gap, events)
    passes = events.passes[PASSER] - before
    if passes > 0 and (rules.every_pass or stage.passes[0] == 0):
        _reward(passer, rules.pass_reward)
    stage.passes[0] += passes
    scored = goal_scored(physics, stage.state)
    if scored == 0:
        if events.last_touch[0] != SHOOTER:
            return STRAY_GOAL
        _reward(shooter, rules.goal_reward)
        return SUCCESS
    if stage.robot_gap[0, 1] <= pair.limits.contact_gap:
        _reward(passer, rules.collision_reward)
        _reward(shooter, rules.collision_reward)
        return COLLISION
    if scored == 1 or out_of_field(physics, stage.state, PASSER) or out_of_field(physics, stage.state, SHOOTER):
        return FAILURE
    return GOING


@inlined
def _choose(pair: Pair, player: Player, robot: int, time: int, progress: float, rng: NDArray[np.uint64]) -> None:
    """Let a robot choose, and give its drive the command."""
    stage = pair.stage
    if player.role == STATIONARY:
        return
    if player.role == RANDOM:
        if stage.held[robot, 1] == 0:
            stage.held[robot, 0] = below(rng, pair.codes.shape[0])
            stage.held[robot, 1] = pair.rules.hold_min + below(rng, pair.rules.hold_max - pair.rules.hold_min + 1)
        stage.held[robot, 1] -= 1
        action = stage.held[robot, 0]
    else:
        learner, learning = player.learner, player.role == LEARNING
        epsilon = player.fixed_epsilon
        if learning:
            epsilon = learner.epsilon_start + (learner.epsilon_end - learner.epsilon_start) * progress
        action = next_action(
            pair.memory,
            pair.bank,
            2 * robot,
            robot,
            time,
            learner,
            player.table,
            player.decisions,
            learning,
            False,
            epsilon,
            player.old,
            progress,
            rng,
        )
    stage.codes[robot] = pair.codes[action]
    command(pair.physics, pair.commands[action], robot, stage.commands, rng)


@inlined
def _act(pair: Pair, time: int, progress: float, rng: NDArray[np.uint64]) -> int:
    stage = pair.stage
    passer, shooter = pair.players
    _choose(pair, passer, PASSER, time, progress, rng)
    _choose(pair, shooter, SHOOTER, time, progress, rng)
    advance(pair.handles, pair.physics, stage.state, stage.commands, stage.ball_gap, stage.robot_gap)
    return _judge(pair, time + 1)


@inlined
def _keep(pair: Pair, player: Player, robot: int) -> None:
    """Write what a robot sees now, and the action that led to it, into its store."""
    if not player.stores:
        return
    store, memory = player.store, pair.memory
    row = store.written[0] % store.trial.shape[0]
    store.written[0] += 1
    store.trial[row] = pair.stage.trial[0]
    store.inputs[row] = pair.stage.codes[robot]
    for o in range(store.areas.shape[1]):
        store.areas[row, o] = memory.areas[robot, o]
        for k in range(FEATURES):
            store.features[row, o, k] = memory.features[robot, o, k]


@inlined
def _sense(pair: Pair, time: int, rng: NDArray[np.uint64]) -> None:
    """Let both robots see, by the analytic camera, and remember."""
    for robot in range(2):
        code = pair.stage.codes[robot]
        watch(pair.camera, pair.bank, pair.memory, pair.retina, pair.stage.state, robot, time, code, rng)
    if time > 0:
        passer, shooter = pair.players
        _keep(pair, passer, PASSER)
        _keep(pair, shooter, SHOOTER)


@helper
def _learn_of_trial(pair: Pair, player: Player, robot: int, ends: int, time: int) -> None:
    if player.role == LEARNING:
        last = -1
        if ends == GOING:
            last = row_of(player.table, discrete_state(pair.memory, pair.bank, 2 * robot, robot, time))
        end_decisions(player.learner, player.table, player.decisions, last)


@entry
def end_trial(pair: Pair, ends: int, time: int) -> None:
    """Let the robots that learn do so; ``ends``: how the trial stood after its last step, number ``time``."""
    passer, shooter = pair.players
    _learn_of_trial(pair, passer, PASSER, ends, time)
    _learn_of_trial(pair, shooter, SHOOTER, ends, time)


@entry
def run_pair(
    pair: Pair,
    time_limit: int,
    first: int,
    total: int,
    seeds: NDArray[np.uint64],
    ends: NDArray[np.int64],
    passes: NDArray[np.int64],
    steps: NDArray[np.int64],
    nearer: NDArray[np.int64],
) -> bool:
    """Run one trial a seed; return False if no start was found.

    Args:
        pair: world, models and players; the tables of those who learn have room for what these trials may visit.
        time_limit: of a trial [steps].
        first, total: number of the first of these trials, and of all trials of the period.
        seeds: (trials,).
        ends: (trials,) filled with GOING (time ran out), SUCCESS (the shooter's goal), FAILURE (out of the field),
            COLLISION or STRAY_GOAL.
        passes, steps: (trials,) filled with the passes and the length of each trial.
        nearer: (trials,) filled with the robot that started nearer to the ball.
    """
    pair = borrowed(pair)
    rng = np.zeros(1, np.uint64)
    for n in range(seeds.shape[0]):
        rng[0] = seeds[n]
        progress = (first + n) / max(total - 1, 1)
        if not begin_trial(pair, progress, rng):
            return False
        pair.stage.trial[0] = first + n
        t, standing = 0, GOING
        _sense(pair, t, rng)
        while t < time_limit and standing == GOING:
            standing = _act(pair, t, progress, rng)
            t += 1
            _sense(pair, t, rng)
        end_trial(pair, standing, t)
        ends[n], passes[n], steps[n], nearer[n] = standing, pair.stage.passes[0], t, pair.stage.nearer[0]
    return True


@entry
def act(pair: Pair, time: int, progress: float, rng: NDArray[np.uint64]) -> int:
    """Let both robots choose and move by one step; return how the trial stands after it.

    Args:
        pair: with what was seen until now.
        time: number of the step, from 0 on.
        progress: share of the period's trials that are done, (trial - 1) / (N_all - 1): the beta of (3.10); it sets
            epsilon too.
        rng: the trial's stream.
    """
    return _act(pair, time, progress, rng)


@entry
def take_in(pair: Pair, time: int) -> None:
    """Let both robots remember, and keep, features and areas that were put into their memory from elsewhere."""
    for robot in range(2):
        remember(pair.memory, pair.bank, robot, time, pair.stage.codes[robot], 0.5 * pair.camera.columns)
    if time > 0:
        passer, shooter = pair.players
        _keep(pair, passer, PASSER)
        _keep(pair, shooter, SHOOTER)
