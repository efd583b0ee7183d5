"""What an arena asks for: a program for each robot that evolves, none for one that stands."""

from __future__ import annotations

import numpy as np
import pytest

from coevo.config import RunSettings
from coevo.game import Arena
from coevo.recipes import read_settings
from coevo.tree import Program

ALONE = Program(np.array([-1], np.int16), np.zeros(1, np.int32))  # the first skill, whatever is seen
SEEDS = np.array([3, 4], np.uint64)


@pytest.fixture(scope="module")
def arena():
    return Arena(read_settings(RunSettings, "stationary-opponent", ["game.time_limit_steps=30"]))


@pytest.mark.parametrize("robot", [0, 1])
def test_a_robot_that_evolves_needs_a_program(arena, robot):
    team = [ALONE, ALONE, None]
    team[robot] = None
    for play in (arena.play, lambda programs, seeds: arena.trace(programs, seeds[0])):
        with pytest.raises(ValueError, match=f"the robot r{robot} needs a program"):
            play(team, SEEDS)


def test_a_robot_that_stands_needs_none(arena):
    with pytest.raises(ValueError, match="the robot r2 needs none, as it stands"):
        arena.play([ALONE] * 3, SEEDS)
    outcome = arena.play([ALONE, ALONE, None], SEEDS)
    assert outcome.skill_steps[2].tolist() == [0] * outcome.skill_steps.shape[1]
    assert outcome.skill_steps[:2, 0].tolist() == [outcome.steps.sum()] * 2
