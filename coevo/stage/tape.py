"""Every step of one game or trial, kept for those who want to see it again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import inlined
from coevo.stage.data import Stage
from coevo.stage.kernels import state_of_skill

__all__ = ["Tape", "Trace", "blank_tape", "is_taping", "no_tape", "record_choice", "record_state", "trace_of"]


class Tape(NamedTuple):
    """Room for every step of one episode; nothing is recorded where the arrays are empty.

    states: (time limit + 1, bodies, 6) float64. skills, actions: (time limit, robots) int8.
    leaves, perceived: (time limit, robots) int32. What they hold is said of Trace.
    """

    states: NDArray[np.float64]
    skills: NDArray[np.int8]
    actions: NDArray[np.int8]
    leaves: NDArray[np.int32]
    perceived: NDArray[np.int32]


@dataclass(frozen=True)
class Trace:
    """Every step of one game or trial.

    states: (steps + 1, bodies, 6) float64, from the start on; robots, then the ball.
    skills: (steps, robots) int8, chosen in each step, -1 for a robot that chooses none.
    actions: (steps, robots) int8, action of the drive in each step, -1 likewise.
    leaves: (steps, robots) int32, the node of the robot's tree that decided, -1 for a robot without a tree.
    perceived: (steps, robots) int32, what the chosen skill sees, as the number of its discrete state; -1 without one.
    """

    states: NDArray[np.float64]
    skills: NDArray[np.int8]
    actions: NDArray[np.int8]
    leaves: NDArray[np.int32]
    perceived: NDArray[np.int32]


def blank_tape(robots: int, time_limit: int) -> Tape:
    """Make room for an episode of so many steps."""
    return _tape(time_limit + 1, robots + 1, time_limit, robots)


def no_tape() -> Tape:
    """Return what records nothing."""
    return _tape(0, 0, 0, 0)


def _tape(moments: int, bodies: int, steps: int, robots: int) -> Tape:
    shape = steps, robots
    skills, actions = np.zeros(shape, np.int8), np.zeros(shape, np.int8)
    return Tape(np.zeros((moments, bodies, 6)), skills, actions, np.zeros(shape, np.int32), np.zeros(shape, np.int32))


def trace_of(tape: Tape, steps: int) -> Trace:
    """Return what was recorded of an episode that took so many steps."""
    return Trace(
        tape.states[: steps + 1], tape.skills[:steps], tape.actions[:steps], tape.leaves[:steps], tape.perceived[:steps]
    )


@inlined
def is_taping(tape: Tape) -> bool:
    """Tell whether anything is to be recorded."""
    return bool(tape.states.shape[0] > 0)


@inlined
def record_state(tape: Tape, stage: Stage, time: int) -> None:
    """Record where the bodies are."""
    # Number by number: to assign a whole array numba compiles all of its error messages.
    state = stage.body.state
    for body in range(state.shape[0]):
        for k in range(state.shape[1]):
            tape.states[time, body, k] = state[body, k]


@inlined
def record_choice(tape: Tape, stage: Stage, robot: int, time: int, skill: int, action: int, leaf: int) -> None:
    """Record what a robot does in the step that begins, and what its skill sees."""
    tape.skills[time, robot], tape.actions[time, robot], tape.leaves[time, robot] = skill, action, leaf
    tape.perceived[time, robot] = -1
    if skill >= 0:
        tape.perceived[time, robot] = state_of_skill(stage, robot, skill, time)
