"""What a robot remembers of what it saw, and the discrete state a skill makes of it; compiled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import helper, inlined
from coevo.skill.bank import MATE, NEAREST, SkillBank
from coevo.soccer.camera import FEATURES, ROBOT_FEATURES, ROBOTS

__all__ = ["Memory", "discrete_state", "forget", "make_memory", "remember", "sees_what_it_needs"]


class Memory(NamedTuple):
    """What every robot of a game sees and remembers; K objects of the camera, and slot K for the nearest robot.

    features: (robots, K + 1, 11) float64, the newest features of each visible object.
    areas: (robots, K + 1) float64, 0 where not visible.
    past: (robots, K + 1, history, 11) float64, a ring of observations.
    inputs: (robots, history, 2) float64, the ring of the actions that led to them.
    seen: (robots, K + 1) int64, for how many steps in a row the object has been visible.
    side: (robots, K + 1) int64, where it was seen last: 0 left, 1 right.
    nearest: (robots,) int64, which object slot K stands for, or -1.
    mate: (robots,) int64, the object that is the first team mate, or -1.
    watched: (robots, K + 1) int64, how many features of an object any skill needs; 0 for none.
    window: (history * 13,) float64, scratch.
    """

    features: NDArray[np.float64]
    areas: NDArray[np.float64]
    past: NDArray[np.float64]
    inputs: NDArray[np.float64]
    seen: NDArray[np.int64]
    side: NDArray[np.int64]
    nearest: NDArray[np.int64]
    mate: NDArray[np.int64]
    watched: NDArray[np.int64]
    window: NDArray[np.float64]


def memory_slot(code: int, robot: int, mates: Sequence[int]) -> int:
    """Return where in its memory a robot has the object of a code of ``coevo.skill.bank``, -1 for nowhere.

    The nearest robot is there once more, after all others.

    Args:
        code: of the object.
        robot: which robot.
        mates: of each robot the number of its team mate, -1 for none.
    """
    if code == MATE:
        mate = mates[robot]
        return -1 if mate < 0 else ROBOTS + mate - (mate > robot)
    return ROBOTS + len(mates) - 1 if code == NEAREST else code


def make_memory(bank: SkillBank, mates: list[int]) -> Memory:
    """Make room for the memory of robots; ``mates``: for each the number of its team mate, -1 for none."""
    robots, history = len(mates), bank.history
    objects = ROBOTS + robots
    watched = np.zeros((robots, objects), np.int64)
    for code, features in zip(bank.objects.ravel().tolist(), bank.features.ravel().tolist(), strict=True):
        for robot in range(robots):
            thing = memory_slot(code, robot, mates)
            if thing >= 0:
                watched[robot, thing] = max(watched[robot, thing], features)
    return Memory(
        features=np.zeros((robots, objects, FEATURES)),
        areas=np.zeros((robots, objects)),
        past=np.zeros((robots, objects, history, FEATURES)),
        inputs=np.zeros((robots, history, 2)),
        seen=np.zeros((robots, objects), np.int64),
        side=np.zeros((robots, objects), np.int64),
        nearest=np.full(robots, -1, np.int64),
        mate=np.array([memory_slot(MATE, robot, mates) for robot in range(robots)], np.int64),
        watched=watched,
        window=np.zeros(history * (2 + FEATURES)),
    )


@helper
def forget(memory: Memory) -> None:
    """Start a game with nothing seen."""
    memory.areas.fill(0.0)
    memory.inputs.fill(0.0)
    memory.seen.fill(0)
    memory.side.fill(0)
    memory.nearest.fill(-1)


@inlined
def remember(
    memory: Memory, bank: SkillBank, robot: int, time: int, inputs: NDArray[np.float64], middle: float
) -> None:
    """Keep what the robot sees now, and the action code (2,) that led to it.

    When an object comes into view its whole past is filled with this first sight. ``middle``: column that parts
    left from right [px].
    """
    slot = time % bank.history
    slots = memory.areas.shape[1] - 1
    memory.inputs[robot, slot, 0] = inputs[0]
    memory.inputs[robot, slot, 1] = inputs[1]
    if bank.nearest:
        largest, which = 0.0, -1
        for o in range(ROBOTS, slots):
            if memory.areas[robot, o] > largest:
                largest, which = memory.areas[robot, o], o
        memory.areas[robot, slots] = largest
        if which >= 0:
            if which != memory.nearest[robot]:
                memory.seen[robot, slots] = 0
                memory.nearest[robot] = which
            for k in range(ROBOT_FEATURES):
                memory.features[robot, slots, k] = memory.features[robot, which, k]
    for o in range(slots + 1):
        features = memory.watched[robot, o]
        if features == 0:
            continue
        if memory.areas[robot, o] <= 0.0:
            memory.seen[robot, o] = 0
            continue
        row, past = memory.features[robot, o], memory.past[robot, o]
        if memory.seen[robot, o] == 0:
            for h in range(bank.history):
                for k in range(features):
                    past[h, k] = row[k]
        else:
            for k in range(features):
                past[slot, k] = row[k]
        memory.seen[robot, o] += 1
        memory.side[robot, o] = 0 if row[0] < middle else 1


@inlined
def thing_of(memory: Memory, bank: SkillBank, skill: int, model: int, robot: int) -> int:
    """Return which object of a robot's memory a model of a skill looks at, -1 for a mate that it does not have."""
    thing = int(bank.objects[skill, model])
    if thing == MATE:
        thing = int(memory.mate[robot])
    elif thing == NEAREST:
        thing = memory.areas.shape[1] - 1
    return thing


@helper
def sees_what_it_needs(memory: Memory, bank: SkillBank, skill: int, robot: int) -> bool:
    """Tell whether all objects of a skill's domain are in view."""
    for i in range(bank.models[skill]):
        if bank.needed[skill, i]:
            thing = thing_of(memory, bank, skill, i, robot)
            if thing < 0 or memory.areas[robot, thing] <= 0.0:
                return False
    return True


@inlined
def discrete_state(memory: Memory, bank: SkillBank, skill: int, robot: int, time: int) -> int:
    """Return the state of a skill: the cells (3.9) of x = M (p - mean) of each of its objects."""
    state = 0
    newest = time % bank.history
    for i in range(bank.models[skill]):
        thing = thing_of(memory, bank, skill, i, robot)
        states = bank.states[skill, i]
        if thing < 0 or memory.areas[robot, thing] <= 0.0:
            lost = bank.lost[skill, i]
            side = memory.side[robot, thing] if thing >= 0 and lost > 1 else 0
            state = state * states + states - lost + side
            continue
        length, features = bank.lengths[skill, i], bank.features[skill, i]
        window, at, slot = memory.window, 2 * length, newest
        for back in range(length):
            window[2 * back] = memory.inputs[robot, slot, 0]
            window[2 * back + 1] = memory.inputs[robot, slot, 1]
            for k in range(features):
                window[at + k] = memory.past[robot, thing, slot, k]
            at += features
            slot = slot - 1 if slot > 0 else bank.history - 1
        cell, digit, weight = bank.cells[skill, i], 0, 1
        for j in range(bank.orders[skill, i]):
            row = bank.memory[skill, i, j]
            x = -bank.offset[skill, i, j]
            for k in range(at):
                x += row[k] * window[k]
            if x >= cell:
                digit += 2 * weight
            elif x >= -cell:
                digit += weight
            weight *= 3
        state = state * states + digit
    return state
