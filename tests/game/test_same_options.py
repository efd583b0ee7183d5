"""Compiled games against the plain loop where a ball may be stuck, a skill has a domain, a robot is weak."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from coevo.game import Arena
from coevo.skill import load_skill
from coevo.soccer.drive import action_set
from coevo.soccer.sight import label_images

STUCK = ("world.rules.stuck_after_s=0.5", "world.rules.stuck_within_m=0.4")
WEAK = ("players.0.strength=0.35", "players.2.strength=0.8")
DOMAINS = {"shoot": ("ball",), "pass": ("ball", "mate"), "avoid": ("robot",)}


@pytest.fixture(scope="module")
def narrow(tmp_path_factory):
    """Return assignments of installed skills that know what to do only where they see all that they look for."""
    folder = tmp_path_factory.mktemp("narrow")
    for name, domain in DOMAINS.items():
        dataclasses.replace(load_skill(name), domain=domain).save(folder / f"{name}.npz")
    return tuple(f"skills.{name}='{folder / name}.npz'" for name in DOMAINS)


def drops(traces):
    """Return (drops, 2): where the ball was put: it jumps there farther than it rolls in a step, and rests."""
    found = []
    for trace in traces:
        ball = trace.states[:, -1]
        jumped = np.hypot(*np.diff(ball[:, :2], axis=0).T) > 0.3
        at_rest = ~ball[1:, 2:].any(axis=1)
        found += ball[1:][jumped & at_rest, :2].tolist()
    return np.array(found).reshape(-1, 2)


@pytest.mark.parametrize("what", ["stuck", "narrow", "weak", "all"])
def test_games_with_options_are_those_of_the_plain_loop(
    what, narrow, settings_of, random_trees, the_same_tree, seeds_of, play_both, programs
):
    options = {"stuck": STUCK, "narrow": narrow, "weak": WEAK, "all": (*STUCK, *narrow, *WEAK)}[what]
    settings = settings_of("chapter6/dissertation-three-learners", "game.time_limit_steps=250", *options)
    trees = [the_same_tree(settings, name) for name in ("shoot", "pass")] + random_trees(settings, 10, seed=41)
    seeds = seeds_of(42, count=len(trees))
    different, outcomes, traces = play_both(settings, trees, seeds)
    assert different == []
    assert sum(outcome.kicks.sum() for outcome in outcomes) > 10  # they played
    places, field = drops(traces), settings.world.field
    assert (len(places) > 5) == (what in ("stuck", "all"))
    if len(places):
        assert places[:, 0].min() >= 1.5
        assert places[:, 0].max() <= field.length_m - 1.5
    # Without the option, the same games are others.
    arena = Arena(settings_of("chapter6/dissertation-three-learners", "game.time_limit_steps=250"))
    without = [arena.trace(programs(settings, team), seed)[1] for team, seed in zip(trees, seeds, strict=True)]
    assert sum(one.states.tobytes() != two.states.tobytes() for one, two in zip(traces, without, strict=True)) >= 6


def test_a_skill_stands_where_it_does_not_see_what_it_needs(narrow, settings_of, the_same_tree, seeds_of, play_both):
    settings = settings_of("chapter6/dissertation-two-learners", "game.time_limit_steps=300", *narrow)
    stand = action_set(settings.world.robot).standing
    assert not action_set(settings.world.robot).commands[stand].any()
    trees, seeds = [the_same_tree(settings, "shoot")] * 6, seeds_of(43, count=6)
    different, _, traces = play_both(settings, trees, seeds)
    assert different == []
    shortest, lost, in_view = load_skill("shoot").min_steps, 0, 0
    for trace in traces:
        for robot in range(2):
            sees = (label_images(settings.world, trace.states[:-1], robot, 0) == 1).any(axis=(1, 2))  # the ball
            # An action that began with the ball in view lasts its shortest time at most.
            blind = np.convolve(~sees, np.ones(shortest), "valid")[: len(sees)] == shortest
            assert (trace.actions[shortest - 1 :, robot][blind] == stand).all()
            lost, in_view = lost + blind.sum(), in_view + (trace.actions[sees, robot] != stand).sum()
    assert min(lost, in_view) > 100


def test_a_weak_robot_drives_and_turns_at_its_share(settings_of, the_same_tree, programs, seeds_of):
    fastest = {}
    for strength in (1.0, 0.5):
        settings = settings_of("chapter6/dissertation-two-learners", f"players.0.strength={strength}")
        team = programs(settings, the_same_tree(settings, "shoot"))
        speeds = []
        for seed in seeds_of(44, count=10):
            _, trace = Arena(settings).trace(team, seed)
            away = [np.hypot(*(trace.states[:, 0, :2] - trace.states[:, other, :2]).T) > 0.6 for other in (1, 2)]
            speeds.append(np.abs(trace.states[away[0] & away[1], 0, 3:]))  # nobody pushes it
        told = np.concatenate(speeds)
        fastest[strength] = np.hypot(told[:, 0], told[:, 1]).max(), told[:, 2].max()
    robot = settings_of("chapter6/dissertation-two-learners").world.robot
    for strength, (speed, turn) in fastest.items():
        assert speed == pytest.approx(robot.max_speed_mps * strength, rel=0.02)
        assert turn == pytest.approx(np.radians(robot.max_turn_rate_dps) * strength, rel=0.02)
