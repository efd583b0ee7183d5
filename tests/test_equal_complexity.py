"""The preset of equal task complexity (6.5) favours no side: neither its starts, nor its physics, nor who wins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from coevo.config import check_experiment, override
from coevo.game import make_game, programs_of
from coevo.recipes import read_experiment, read_recipe
from coevo.seeds import RunStream, game_seeds
from coevo.tree import parse

RECIPE = "chapter6/equal-complexity"
OTHER_SIDE = [2, 3, 0, 1]
SEEKER = "IF_ball_is_lost(search, shoot)"
PASSER = "IF_ball_is_lost(search, pass)"


@pytest.fixture(scope="module")
def settings():
    return read_experiment(RECIPE)


@pytest.fixture(scope="module")
def game(settings):
    return make_game(settings)


def trees(*sides):
    return [parse(tree) for side in sides for tree in side]


def turned(start, field):
    """Return a start turned by half a turn about the middle of the field."""
    x, y = start.x_m, start.y_m
    return (field.length_m - x[1], field.length_m - x[0], field.width_m - y[1], field.width_m - y[0])


def test_each_robot_starts_as_its_counterpart_and_is_as_strong(settings):
    field = settings.world.field
    assert [player.team for player in settings.players] == [0, 0, 1, 1]
    for own, other in zip(settings.players, [settings.players[k] for k in OTHER_SIDE], strict=True):
        assert (*own.start.x_m, *own.start.y_m) == pytest.approx(turned(other.start, field))
        assert (own.start.facing, own.start.spread_deg) == (other.start.facing, other.start.spread_deg)
        assert (own.strength, own.control) == (1.0, "evolve")
    ball = settings.game.ball_start
    assert (*ball.x_m, *ball.y_m) == pytest.approx(turned(ball, field))


@pytest.mark.parametrize(
    ("side", "steps"),
    [((SEEKER, "pass"), 25), (("search", "shoot"), 45), (("IF_ball_is_left(shoot, pass)", "search"), 100)],
)
def test_a_game_that_begins_mirrored_goes_on_mirrored(side, steps):
    """As long as no rounding is decisive, such as which of two robots touches the ball first."""
    places, middle = [(2.95, 2.1), (5.15, 3.6)], (4.11, 2.2875)
    places += [(2 * middle[0] - x, 2 * middle[1] - y) for x, y in places]
    points = [f"players.{k}.start={{x_m=[{x},{x}], y_m=[{y},{y}]}}" for k, (x, y) in enumerate(places)]
    ball = f"game.ball_start={{x_m=[{middle[0]},{middle[0]}], y_m=[{middle[1]},{middle[1]}]}}"
    game = make_game(check_experiment(override(read_recipe(RECIPE, "evolution"), [*points, ball]), "mirrored"))
    _, seen = game.arena.trace(programs_of(game, trees(side, side)), np.uint64(5))
    before = seen.states[: steps + 1]  # (steps + 1, bodies, 6): x, y, heading and their speeds; robots, then the ball
    mirrored = before[:, [*OTHER_SIDE, 4]] * np.array([-1, -1, 1, -1, -1, 1]) + [
        *(2 * np.array(middle)),
        math.pi,
        0,
        0,
        0,
    ]
    apart = before - mirrored
    apart[..., 2] = np.angle(np.exp(1j * apart[..., 2]))
    apart[:, 4, 2] = 0.0  # a ball has no front
    assert np.ptp(before[:, 0, :2], axis=0).max() > 0.05  # something moved
    assert np.abs(apart).max() < 1e-9


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ((SEEKER, SEEKER), (SEEKER, SEEKER)),
        ((PASSER, "shoot"), (SEEKER, "search")),
        (("shoot", "avoid"), (SEEKER, PASSER)),
    ],
)
def test_teams_that_change_sides_win_as_often(one, other, game):
    games = 300
    seeds = game_seeds(3, RunStream.PLAY, count=games), game_seeds(4, RunStream.PLAY, count=games)
    first = game.play(programs_of(game, trees(one, other)), seeds[0]).winner
    second = game.play(programs_of(game, trees(other, one)), seeds[1]).winner
    for won in ((first == 0, second == 1), (first == 1, second == 0), (first < 0, second < 0)):
        share = np.mean(won)
        error = math.sqrt(2.0 * share * (1.0 - share) / games)
        assert abs(np.mean(won[0]) - np.mean(won[1])) < 3.5 * error + 1e-9
    assert (np.concatenate([first, second]) >= 0).mean() > 0.5  # most games are decided, so that this says something
