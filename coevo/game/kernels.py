"""Games between trees, compiled: a whole set of games in one call."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import borrowed, entry, inlined
from coevo.game.conditions import holds
from coevo.soccer.conditions import ConditionTable
from coevo.soccer.placement import place
from coevo.stage.data import Stage
from coevo.stage.kernels import begin, drive, sense, step, use_skill
from coevo.stage.loop import run_episode
from coevo.stage.roles import STANDING, TREE, follow_script
from coevo.stage.tape import Tape, is_taping, record_choice, record_state

__all__ = ["Match", "Programs", "Score", "play"]


class Programs(NamedTuple):
    """The programs of all robots, one after the other.

    codes: (nodes,) int16, a function's index, or -1 - s for the skill s.
    second: (nodes,) int32, where the second branch begins, counted from the robot's root.
    start: (robots + 1,) int64, where each robot's program begins.
    steps: (nodes,) int64, steps that ended at each leaf; counted up.
    """

    codes: NDArray[np.int16]
    second: NDArray[np.int32]
    start: NDArray[np.int64]
    steps: NDArray[np.int64]


class Match(NamedTuple):
    """What games of one setting between given programs work on.

    scored: (1,) int64, the team that scored in the last step, -1 for none.
    """

    stage: Stage
    conditions: ConditionTable
    programs: Programs
    tape: Tape
    scored: NDArray[np.int64]


class Score(NamedTuple):
    """What happened in games.

    steps, winner: (games,) int64, length, and the team that scored, -1 if time ran out.
    kicks, collisions, passes, own_goals: (games, robots) int64.
    """

    steps: NDArray[np.int64]
    winner: NDArray[np.int64]
    kicks: NDArray[np.int64]
    collisions: NDArray[np.int64]
    passes: NDArray[np.int64]
    own_goals: NDArray[np.int64]


@inlined
def _walk(match: Match, robot: int) -> int:
    """Go down a robot's program by what it sees; return the node of the leaf."""
    programs, memory = match.programs, match.stage.memory
    features, areas = memory.features[robot], memory.areas[robot]
    root = programs.start[robot]
    node = root
    code = programs.codes[node]
    while code >= 0:
        node = node + 1 if holds(match.conditions, robot, code, features, areas) else root + programs.second[node]
        code = programs.codes[node]
    return int(node)


@inlined
def _see(match: Match, time: int, rng: NDArray[np.uint64]) -> None:
    sense(match.stage, time, rng)


@inlined
def _act(match: Match, time: int, rng: NDArray[np.uint64]) -> None:
    stage, programs, tape = match.stage, match.programs, match.tape
    taping = is_taping(tape)
    for robot in range(stage.roles.role.shape[0]):
        role, skill, action, leaf = stage.roles.role[robot], -1, -1, -1
        if role == TREE:
            leaf = _walk(match, robot)
            programs.steps[leaf] += 1
            skill = -1 - programs.codes[leaf]
            action = use_skill(stage, robot, skill, time)
        elif role != STANDING:
            action = follow_script(stage, robot, rng)
        if action >= 0:
            drive(stage, robot, action, rng)
        if taping:
            leaf = int(leaf - programs.start[robot]) if leaf >= 0 else -1
            record_choice(tape, stage, robot, time, skill, action, leaf)
    match.scored[0] = step(stage, time)
    if taping:
        record_state(tape, stage, time + 1)


@inlined
def _judge(match: Match, _time: int) -> int:
    return int(match.scored[0] + 1)


@entry
def play(match: Match, time_limit: int, regions: NDArray[np.float64], seeds: NDArray[np.uint64], score: Score) -> bool:
    """Play one game a seed; return False if the bodies do not fit into their start regions.

    Args:
        match: stage and programs.
        time_limit: [steps].
        regions: (bodies, 6), see coevo.soccer.placement.
        seeds: (games,).
        score: filled.
    """
    match, score = borrowed(match), borrowed(score)
    stage = match.stage
    events, state = stage.events, stage.body.state
    rng = np.zeros(1, np.uint64)
    for game in range(seeds.shape[0]):
        rng[0] = seeds[game]
        if not place(stage.physics, regions, stage.roles.team, state, rng):
            return False
        begin(stage, rng)
        if is_taping(match.tape):
            record_state(match.tape, stage, 0)
        standing, score.steps[game] = run_episode(match, time_limit, rng, _see, _act, _judge)
        score.winner[game] = standing - 1
        for robot in range(stage.roles.role.shape[0]):
            score.kicks[game, robot], score.collisions[game, robot] = events.kicks[robot], events.collisions[robot]
            score.passes[game, robot], score.own_goals[game, robot] = events.passes[robot], events.own_goals[robot]
    return True
