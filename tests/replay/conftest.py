"""Games of trees whose every question is answered both ways, once for all tests of replays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from coevo.config import RunSettings
from coevo.game import SoccerGame, Trace, programs_of
from coevo.replay import Recording, game_recording
from coevo.tree import Tree, parse

TEAM = (
    "IF_ball_is_lost(IF_r1_is_lost(search, avoid), IF_ball_is_left(pass, IF_opponent_goal_is_lost(search, shoot)))",
    "IF_r0_is_lost(IF_ball_is_lost(search, IF_ball_is_large(shoot, pass)), IF_r0_is_large(avoid, shoot))",
    "IF_ball_is_lost(search, IF_ball_is_lost(avoid, shoot))",
)


@dataclass(frozen=True)
class Games:
    """Some games of TEAM, played."""

    settings: RunSettings
    game: SoccerGame
    trees: tuple[Tree, ...]
    traces: tuple[Trace, ...]
    recording: Recording


@pytest.fixture(scope="session")
def games(small_settings) -> Games:
    settings = small_settings("game.time_limit_steps=240", preset="three-learners")
    game = SoccerGame(settings)
    trees = tuple(parse(text) for text in TEAM)
    programs = programs_of(game, trees)
    traces = tuple(game.arena.trace(programs, np.uint64(seed))[1] for seed in range(3))
    return Games(settings, game, trees, traces, game_recording(settings, traces, trees=trees))
