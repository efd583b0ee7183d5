"""Begin, sense, decide, drive, step: each is written here once, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import helper, inlined
from coevo.skill.estimate import discrete_state, forget, remember
from coevo.soccer.camera import look
from coevo.soccer.events import clear_events, goal_scored, record_contacts, record_goal
from coevo.soccer.noise import blur_sight, shake_drive
from coevo.soccer.physics import advance, reset
from coevo.soccer.referee import free_ball
from coevo.soccer.rng import below
from coevo.stage.data import Stage

__all__ = ["begin", "drive", "new_state", "sense", "start_action", "state_of_skill", "step", "use_skill"]


@helper
def begin(stage: Stage, rng: NDArray[np.uint64]) -> None:
    """Begin with the bodies where ``stage.body.state`` says, at rest, nothing seen and nothing having happened."""
    body, doing, memory = stage.body, stage.doing, stage.memory
    reset(stage.handles, body.state)
    forget(memory)
    clear_events(stage.events)
    body.commands.fill(0.0)
    body.codes.fill(0.0)
    doing.skill.fill(-1)
    doing.action.fill(-1)
    doing.held.fill(0)
    doing.start.fill(-1)
    stage.roles.left.fill(0)
    for robot in range(stage.roles.role.shape[0]):
        if stage.roles.guesses[robot]:
            for thing in range(memory.side.shape[1]):
                memory.side[robot, thing] = below(rng, 2)


@inlined
def sense(stage: Stage, time: int, rng: NDArray[np.uint64]) -> None:
    """Let the robots that have eyes see, and remember it with the action that led to it."""
    memory, camera, roles = stage.memory, stage.camera, stage.roles
    for robot in range(roles.role.shape[0]):
        if roles.sees[robot]:
            features, areas = memory.features[robot], memory.areas[robot]
            look(camera, stage.body.state, robot, roles.team[robot], stage.retina, features, areas)
            if camera.noise > 0.0:
                blur_sight(camera, memory.areas.shape[1] - 1, features, areas, rng)
            remember(memory, stage.bank, robot, time, stage.body.codes[robot], 0.5 * camera.columns)


@helper
def state_of_skill(stage: Stage, robot: int, skill: int, time: int) -> int:
    """Return the discrete state that a skill sees a robot in."""
    return int(discrete_state(stage.memory, stage.bank, skill, robot, time))


@inlined
def new_state(stage: Stage, robot: int, skill: int, time: int) -> int:
    """Return the discrete state to choose an action of a skill in, -1 while the one under way goes on.

    An action repeats a primitive until the state changes (Uchibe 1999, 3.3.1), within the limits of the skill, or until
    another skill is to act.
    """
    doing, bank = stage.doing, stage.bank
    fresh = doing.skill[robot] != skill or doing.held[robot] >= bank.max_steps[skill]
    if not fresh and doing.held[robot] < bank.min_steps[skill]:
        return -1
    now = discrete_state(stage.memory, bank, skill, robot, time)
    if not fresh and now == doing.start[robot]:
        return -1
    return now


@inlined
def start_action(stage: Stage, robot: int, skill: int, state: int, action: int) -> None:
    """Begin an action of a skill, chosen in a discrete state."""
    doing = stage.doing
    doing.skill[robot], doing.start[robot], doing.action[robot], doing.held[robot] = skill, state, action, 0


@inlined
def use_skill(stage: Stage, robot: int, skill: int, time: int) -> int:
    """Return the action of the step that begins, by a skill's greedy policy."""
    now = new_state(stage, robot, skill, time)
    if now >= 0:
        start_action(stage, robot, skill, now, stage.bank.policy[stage.bank.first[skill] + now])
    stage.doing.held[robot] += 1
    return int(stage.doing.action[robot])


@inlined
def drive(stage: Stage, robot: int, action: int, rng: NDArray[np.uint64]) -> None:
    """Give a robot's drive the command of an action, with the noise of the actuators."""
    body = stage.body
    body.codes[robot, 0], body.codes[robot, 1] = stage.drive.codes[action, 0], stage.drive.codes[action, 1]
    share = stage.roles.share[robot]
    body.commands[robot, 0] = stage.drive.commands[action, 0] * share
    body.commands[robot, 1] = stage.drive.commands[action, 1] * share
    if stage.physics.actuator_noise > 0.0:
        shake_drive(stage.physics, body.commands, robot, rng)


@inlined
def step(stage: Stage, time: int) -> int:
    """Move the world on and count what happens; return the team that scores, -1 for none."""
    body = stage.body
    advance(stage.handles, stage.physics, body.state, body.commands, body.ball_gap, body.robot_gap)
    record_contacts(stage.limits, stage.roles.team, time, body.ball_gap, body.robot_gap, stage.events)
    scored = goal_scored(stage.physics, body.state)
    record_goal(stage.roles.team, scored, stage.events)
    if stage.limits.stuck_after > 0 and scored < 0:
        free_ball(stage.limits, stage.physics, stage.handles, body.state, time, stage.events)
    return scored
