"""Limits of the size categories, against rays cast for every pixel."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from analysis.calibration.categories import areas_table, categories, tercile_table
from coevo.config import CategorySettings, RunSettings
from coevo.evolution import random_teams
from coevo.game import SoccerGame, programs_of
from coevo.recipes import read_settings
from coevo.seeds import RunStream, game_seeds
from coevo.soccer.camera import BALL, ROBOTS

SEED = 2
PRESETS = (
    "chapter6/dissertation-two-learners",
    "chapter6/dissertation-stationary-opponent",
    "chapter6/dissertation-three-learners",
)
SMALL = ("gp.creation_depth_max=3", "game.time_limit_steps=120")


def kind_of(thing):
    return "ball" if thing == BALL else "robot" if thing >= ROBOTS else "goal"


@pytest.mark.parametrize(
    "preset", ["chapter6/dissertation-stationary-opponent", "chapter6/dissertation-three-learners"]
)
def test_areas_are_those_of_a_ray_cast(preset, ray_cast):
    settings = read_settings(RunSettings, preset, SMALL)
    found = areas_table(settings, teams=2, seed=SEED)
    looks = {at: sorted(rows) for at, rows in _sights(found).items()}
    game, same = SoccerGame(settings), []
    for team, trees in enumerate(random_teams(game, settings.gp, seed=SEED, teams=2)):
        for number, seed in enumerate(game_seeds(SEED + team, RunStream.UNSEEN, count=2)):
            states = game.arena.trace(programs_of(game, trees), seed)[1].states
            for step in range(0, len(states), 10):
                for robot, player in enumerate(settings.players):
                    given = looks.pop((team, number, step, robot), [])
                    # Rays from behind a goal line go out through the mouth, which the camera then does not see.
                    inside = 0.0 < states[step, robot, 0] < settings.world.field.length_m
                    if player.control == "evolve" and inside:
                        hit = ray_cast(settings.world, states[step], robot, player.team)
                        things, areas = np.unique(hit[hit >= 0], return_counts=True)
                        same.append(given == sorted(zip(map(kind_of, things), areas.tolist(), strict=True)))
                    else:
                        assert player.control == "evolve" or given == []
    assert looks == {}  # nothing was looked at but every tenth step
    assert len(found) > 100
    assert np.mean(same) > 0.99  # the last bit of a sum may decide about a pixel


def _sights(found):
    """Return what was seen by team, game, step and robot: kinds and areas."""
    sights = {}
    for *at, kind, area in found.itertuples(index=False, name=None):
        sights.setdefault(tuple(at), []).append((kind, area))
    return sights


def test_below_either_limit_lie_one_and_two_thirds():
    random = np.random.default_rng(1)
    drawn = pd.DataFrame({"seen": random.choice(["ball", "robot"], 9001), "area_px": random.exponential(50.0, 9001)})
    found = tercile_table(drawn)
    assert found["seen"].tolist() == ["ball", "robot"]  # a kind that nobody saw has no limits
    assert found["samples"].sum() == 9001
    for row in found.to_dict("records"):
        areas = drawn.loc[drawn["seen"] == row["seen"], "area_px"]
        for limit, share in ((row["small_below_px"], 1 / 3), (row["large_from_px"], 2 / 3)):
            assert (areas < limit).mean() == pytest.approx(share, abs=1.0 / row["samples"])
            # Exponential areas: the quantile has a closed form.
            assert limit == pytest.approx(-50.0 * np.log(1.0 - share), rel=0.06)


def test_the_command_tells_the_terciles_of_all_recipes_together():
    words = ["smoke", "chapter6/dissertation-two-learners", "--teams", "2", "--seed", str(SEED)]
    told = json.loads(CliRunner().invoke(categories, [*words, "--json"], catch_exceptions=False).stdout)
    areas = [areas_table(read_settings(RunSettings, name), teams=2, seed=SEED) for name in words[:2]]
    assert told == tercile_table(pd.concat(areas)).to_dict("records")
    lines = CliRunner().invoke(categories, words, catch_exceptions=False).stdout.splitlines()
    assert [line.split()[:2] for line in lines[1:]] == [[row["seen"], str(row["samples"])] for row in told]


@pytest.mark.slow
def test_of_what_random_teams_see_about_a_third_is_small_and_a_third_large_by_the_shipped_limits():
    shipped = CategorySettings()
    limits = {
        "ball": (shipped.ball_small_below_px, shipped.ball_large_from_px),
        "goal": (shipped.goal_small_below_px, shipped.goal_large_from_px),
        "robot": (shipped.robot_small_below_px, shipped.robot_large_from_px),
    }
    areas = pd.concat(
        [areas_table(read_settings(RunSettings, preset), teams=80, seed=seed) for preset in PRESETS for seed in (1, 2)]
    )
    for kind, (small, large) in limits.items():
        found = areas.loc[areas["seen"] == kind, "area_px"]
        shares = (found < small).mean(), ((found >= small) & (found < large)).mean(), (found >= large).mean()
        assert shares == pytest.approx((1 / 3,) * 3, abs=0.08), kind
