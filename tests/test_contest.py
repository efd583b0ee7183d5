"""Judging the last champions by games that evolution has not seen."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from coevo.contest import champions, judge, line_up, single_skills
from coevo.evolution.evaluation import Evaluator, group_seeds
from coevo.game import Role, SoccerGame
from coevo.run import open_run
from coevo.seeds import RunStream, game_seeds
from coevo.tree import FunctionSet


@pytest.fixture(scope="module")
def small_run(small_run, tmp_path_factory):
    """Return a copy of the finished small run, into which results are written."""
    return open_run(Path(shutil.copytree(small_run.path, tmp_path_factory.mktemp("judged") / "run")))


@pytest.fixture(scope="module")
def judged(small_run):
    with Evaluator(small_run.config, workers=2, backend="threads") as evaluator:
        return list(judge(small_run, evaluator, games=80))


def shares(run, team, part):
    """Return the share of unseen games that a team of programs wins, by single games."""
    game = SoccerGame(run.config)
    opponents = champions(run, run.finished - 1)[1 - team]
    seeds = game_seeds(run.config.seed, RunStream.UNSEEN, count=80)
    return np.mean([game.play(line_up(game, part, opponents), seeds[k : k + 1]).winner[0] == team for k in range(80)])


def test_shares_are_those_of_single_games(judged, small_run):
    for one in judged:
        last, first = (champions(small_run, g)[one.team] for g in (small_run.finished - 1, 0))
        assert one.last[0] == shares(small_run, one.team, last)
        assert one.first[0] == shares(small_run, one.team, first)
        names = {small_run.number_of(robot): skill for robot, skill in one.skills.items()}
        best = next(part for named, part in single_skills(small_run.game, one.team) if named == names)
        assert one.single_skills[0] == shares(small_run, one.team, best)
        assert one.over_first[0] == pytest.approx(one.last[0] - one.first[0])
        for share, low, high in (one.last, one.first, one.single_skills, one.over_first, one.over_single_skills):
            assert low <= share <= high


def test_every_team_is_judged_by_its_robots(judged):
    assert [(one.team, one.robots, one.games) for one in judged] == [(0, ("r0", "r1"), 80), (1, ("r2",), 80)]


def test_games_are_neither_those_of_evolution_nor_those_that_choose(small_run):
    config = small_run.config
    unseen = set(game_seeds(config.seed, RunStream.UNSEEN, count=400).tolist())
    choosing = set(game_seeds(config.seed, RunStream.CHOICE, count=100).tolist())
    groups = {
        int(seed)
        for generation in range(config.gp.generations)
        for group in range(config.gp.population)
        for seed in group_seeds(config.seed, generation, group, config.evaluation.games)
    }
    assert not unseen & choosing
    assert not unseen & groups
    assert not choosing & groups


def test_what_was_judged_is_kept(judged, small_run):
    assert list(judge(small_run, None, games=80)) == judged


def test_of_very_many_teams_of_single_skills_some_are_tried():
    class Many:
        roles = tuple(Role(f"p{number}", 0) for number in range(20))

        def function_set(self, role):
            return FunctionSet(("IF_x",), tuple(f"s{k}" for k in range(2 + role % 3)))

    game = Many()
    teams = single_skills(game, 0, seed=1)
    assert 60 <= len(teams) <= 64
    assert len({tuple(names.values()) for names, _ in teams}) == len(teams)
    for names, _ in teams:
        assert all(name in game.function_set(role).terminals for role, name in names.items())
    assert [names for names, _ in single_skills(game, 0, seed=2)] != [names for names, _ in teams]


def test_workers_change_nothing(judged, small_run):
    shutil.rmtree(small_run.path / "results")
    with Evaluator(small_run.config, workers=1, backend="processes") as evaluator:
        assert list(judge(small_run, evaluator, games=80)) == judged
