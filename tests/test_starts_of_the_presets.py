"""The starts of the presets, by geometry: what docs/decisions/0015-presets.md says of who is where, for every start."""

from __future__ import annotations

import itertools
import math

import pytest

from coevo.config import RunSettings
from coevo.recipes import read_settings

PRESETS = ("two-learners", "stationary-opponent", "three-learners")


@pytest.fixture(params=PRESETS)
def settings(request):
    return read_settings(RunSettings, request.param)


def distances(one, other):
    """Return the least and the largest distance between points of two rectangles that do not overlap in x, in m."""
    corners = [list(itertools.product(of.x_m, of.y_m)) for of in (one, other)]
    most = max(math.dist(a, b) for a, b in itertools.product(*corners))
    gaps = [max(0.0, b[0] - a[1], a[0] - b[1]) for a, b in ((one.x_m, other.x_m), (one.y_m, other.y_m))]
    return math.hypot(*gaps), most


def test_r0_is_the_nearest_to_the_ball_and_beyond_it(settings):
    """Its team attacks towards larger x: so it has to drive around the ball."""
    ball, (r0, *others) = settings.game.ball_start, settings.players
    assert r0.start.x_m[0] > ball.x_m[1]
    for other in others:
        assert distances(r0.start, ball)[1] < distances(other.start, ball)[0]


def test_r1_is_on_the_way_to_the_goal_and_an_opponent_before_that_goal(settings):
    ball, length, (r0, r1, *opponents) = settings.game.ball_start, settings.world.field.length_m, settings.players
    assert max(ball.x_m[1], r0.start.x_m[1]) < r1.start.x_m[0] < r1.start.x_m[1] < length
    for r2 in opponents:
        assert r2.start.x_m[0] > r1.start.x_m[1]


def test_robots_that_evolve_face_anything(settings):
    assert {one.start.facing for one in settings.players if one.control == "evolve"} == {"random"}
