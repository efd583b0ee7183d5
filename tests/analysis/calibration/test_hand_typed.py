"""Hand-typed teams stand where r0 and r1 play."""

from __future__ import annotations

import pytest

from analysis.calibration.hand_typed import SHOOTER, needs_opponent, team_trees
from coevo.config import RunSettings, check
from coevo.errors import InputError
from coevo.game import SoccerGame


@pytest.fixture(scope="module")
def game_of(recipe):
    """Return a function that gives the game of a preset, with some players changed."""

    def make(preset, changes=()):
        plain = recipe(preset)
        for player, change in changes:
            plain["players"][player].update(change)
        return SoccerGame(check(RunSettings, plain, preset))

    return make


def test_who_evolves_beside_them_needs_a_tree(game_of):
    assert [
        needs_opponent(game_of(preset))
        for preset in (
            "chapter6/dissertation-two-learners",
            "chapter6/dissertation-stationary-opponent",
            "chapter6/dissertation-three-learners",
        )
    ] == [
        False,
        False,
        True,
    ]


def test_everybody_who_evolves_has_a_tree(game_of):
    team = ("pass", SHOOTER)
    told = {
        preset: [None if tree is None else str(tree) for tree in team_trees(game_of(preset), team, opponent)]
        for preset, opponent in (
            ("chapter6/dissertation-two-learners", None),
            ("chapter6/dissertation-stationary-opponent", None),
            ("chapter6/dissertation-three-learners", "search"),
        )
    }
    assert told == {
        "chapter6/dissertation-two-learners": ["pass", SHOOTER],
        "chapter6/dissertation-stationary-opponent": ["pass", SHOOTER, None],
        "chapter6/dissertation-three-learners": ["pass", SHOOTER, "search"],
    }


@pytest.mark.parametrize(
    ("preset", "opponent"),
    [("chapter6/dissertation-two-learners", "shoot"), ("chapter6/dissertation-three-learners", None)],
)
def test_a_tree_too_many_or_too_few_is_refused(game_of, preset, opponent):
    with pytest.raises(InputError, match="an opponent plays by a tree where it evolves, and only there"):
        team_trees(game_of(preset), ("shoot", "shoot"), opponent)


@pytest.mark.parametrize("changes", [[(1, {"team": 1})], [(0, {"control": "stationary"})]])
def test_r0_and_r1_must_be_a_team_that_evolves(game_of, changes):
    with pytest.raises(InputError, match="they must be in one team, and both evolve"):
        needs_opponent(game_of("chapter6/dissertation-three-learners", changes))
