"""What tests of the world in motion share."""

from __future__ import annotations

import numpy as np
import pytest

from coevo.soccer.physics import physics_params, replay
from coevo.soccer.world import World


def _rolled(world, start, commands):
    """Return (steps + 1, bodies, 6), start included, on a Space of its own."""
    start, commands = np.asarray(start, np.float64), np.asarray(commands, np.float64)
    states = np.empty((len(commands), *start.shape))
    mover = World(world, len(start) - 1)
    replay(mover.handles, physics_params(world), start, commands, states)
    return np.concatenate([start[None], states])


@pytest.fixture(scope="session")
def rolled():
    """Return a function of world, start and commands: what comes of them on a Space of its own."""
    return _rolled


def _at_rest(*poses):
    """Return a state of robots (x, y, heading) and in the end the ball (x, y, heading), nothing moving."""
    state = np.zeros((len(poses), 6))
    state[:, :3] = poses
    return state


@pytest.fixture(scope="session")
def at_rest():
    """Return a function of poses: a state in which nothing moves."""
    return _at_rest


def _held(command, steps, robots=1):
    """Return one command for all robots and steps."""
    return np.tile(np.asarray(command, np.float64), (steps, robots, 1))


@pytest.fixture(scope="session")
def held():
    """Return a function of a command and a number of steps: one command throughout."""
    return _held
