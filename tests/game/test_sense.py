"""Teams with some sense do better than random ones, and passing pays."""

from __future__ import annotations

import math

import numpy as np
import pytest

from coevo.game import Arena
from coevo.tree import Tree, parse

HAND_TYPED, PASSES = "IF_ball_is_lost(search, shoot)", "IF_ball_is_lost(search, pass)"


@pytest.fixture(scope="module")
def random_goals(settings_of, programs, random_trees, seeds_of):
    """Return the share of games that each of many random teams wins."""
    settings, games = settings_of("chapter6/dissertation-two-learners"), 5
    arena, teams = Arena(settings), random_trees(settings, 600, seed=25)
    won = [
        arena.play(programs(settings, trees), seeds_of(24, team, count=games)).goals_of(0)
        for team, trees in enumerate(teams)
    ]
    return np.array(won) / games


@pytest.mark.parametrize(
    "trees",
    [
        pytest.param((PASSES, "shoot"), id="r0 passes to r1"),
        pytest.param(("shoot", "shoot"), id="both shoot"),
        pytest.param((HAND_TYPED, HAND_TYPED), id="both search or shoot"),
    ],
)
@pytest.mark.slow
def test_a_team_with_some_sense_scores_clearly_more_than_random_ones(
    random_goals, trees, settings_of, programs, seeds_of
):
    settings, games = settings_of("chapter6/dissertation-two-learners"), 1000
    team = programs(settings, [parse(tree) for tree in trees])
    share = Arena(settings).play(team, seeds_of(23, count=games)).goals_of(0) / games
    # One-sided, 99.9 %: games of one random team are not independent of each other, but teams are.
    random = random_goals.mean(), random_goals.std(ddof=1) / math.sqrt(len(random_goals))
    error = math.hypot(math.sqrt(share * (1.0 - share) / games), random[1])
    assert share - random[0] > 3.1 * error, (share, *random)


@pytest.mark.parametrize("preset", ["chapter6/dissertation-two-learners", "chapter6/dissertation-stationary-opponent"])
@pytest.mark.slow
def test_a_team_that_passes_does_better_than_one_robot_alone(preset, settings_of, programs, seeds_of):
    settings, games = settings_of(preset), 1000
    arena = Arena(settings)
    ahead = []
    for texts in ((PASSES, "shoot"), ("shoot", "search"), ("search", "shoot")):
        trees = [parse(text) for text in texts] + [None] * (len(settings.players) - 2)
        scorer = arena.play(programs(settings, trees), seeds_of(27, count=games)).scorer
        ahead.append((scorer == 0).astype(float) - (scorer == 1))
    for alone in ahead[1:]:
        gain = ahead[0] - alone  # the same games
        assert gain.mean() > 3.1 * gain.std(ddof=1) / math.sqrt(games)


def test_a_tree_is_its_text_in_any_writing(settings_of, programs, seeds_of):
    settings = settings_of("chapter6/dissertation-two-learners")
    spaced = parse(" IF_ball_is_lost ( search ,shoot ) ")
    assert spaced == Tree(("IF_ball_is_lost", "search", "shoot")) == parse(HAND_TYPED)
    arena = Arena(settings)
    one, two = (
        arena.play(programs(settings, [tree, tree]), seeds_of(26, count=3)) for tree in (spaced, parse(HAND_TYPED))
    )
    assert np.array_equal(one.steps, two.steps)
