"""The actions of both drives: (5.13) for power wheeled steering, (3.12) for 4-wheel steering."""

from __future__ import annotations

import math

import pytest

from coevo.config import RobotSettings
from coevo.soccer.drive import action_set


def test_power_wheeled_steering_has_all_nine_pairs_of_speed_and_turn():
    robot = RobotSettings(max_speed_mps=0.7, max_turn_rate_dps=90.0)
    actions = action_set(robot)
    pairs = [(v, w) for v in (-1, 0, 1) for w in (-1, 0, 1)]
    assert [tuple(code) for code in actions.codes.tolist()] == pairs
    for (v, w), (speed, turn) in zip(pairs, actions.commands.tolist(), strict=True):
        assert speed == pytest.approx(0.7 * v)
        assert turn == pytest.approx(0.5 * math.pi * w)


def test_four_wheel_steering_has_seven_actions_and_none_that_steers_while_standing():
    robot = RobotSettings(drive="4ws", max_speed_mps=0.5, max_steering_deg=30.0, wheelbase_m=0.3)
    actions = action_set(robot)
    pairs = [(-1, -1), (-1, 0), (-1, 1), (0, 0), (1, -1), (1, 0), (1, 1)]
    assert [tuple(code) for code in actions.codes.tolist()] == pairs
    # Both axles at 30 degrees, opposite: the middle of turning lies 0.15 m / tan 30 beside the robot.
    radius = 0.15 * math.sqrt(3.0)
    for (v, steering), (speed, turn) in zip(pairs, actions.commands.tolist(), strict=True):
        assert speed == pytest.approx(0.5 * v)
        assert turn == pytest.approx(v * steering * 0.5 / radius)  # backwards, the same wheels turn it the other way


@pytest.mark.parametrize("drive", ["pws", "4ws"])
def test_codes_and_commands_belong_together_and_standing_is_an_action(drive):
    actions = action_set(RobotSettings(drive=drive))
    assert actions.codes.shape == actions.commands.shape == ({"pws": 9, "4ws": 7}[drive], 2)
    assert len({tuple(code) for code in actions.codes.tolist()}) == len(actions.codes)
    still = actions.codes.tolist().index([0.0, 0.0])
    assert actions.commands[still].tolist() == [0.0, 0.0]
