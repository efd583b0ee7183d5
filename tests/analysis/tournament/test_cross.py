"""Champions of runs against those of other runs."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from analysis.tournament import cross_play, same_game
from coevo.contest import champions, line_up
from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator
from coevo.game import SoccerGame
from coevo.run import create_run
from coevo.seeds import RunStream, game_seeds
from coevo.skill import skill_path


@pytest.fixture(scope="module")
def three_runs(small_settings, go_on, tmp_path_factory):
    folder = tmp_path_factory.mktemp("three")
    fitness = ("fixed", "fixed", "varying")
    return [
        go_on(create_run(folder / f"run{seed}", small_settings(f"seed={seed}", f"fitness.kind={kind}")))
        for seed, kind in enumerate(fitness)
    ]


def meet(runs, names=None):
    names = names or [run.path.name for run in runs]
    with Evaluator(runs[0].config, workers=2, backend="threads", folders=runs[0].folders) as evaluator:
        return cross_play(runs, names, evaluator, games=5)


def test_every_pair_is_what_its_games_played_alone_give(three_runs):
    table = meet(three_runs).set_index(["side", "run", "met"])["share"]
    game = SoccerGame(three_runs[0].config)
    for a, mine in enumerate(three_runs):
        for b, other in enumerate(three_runs):
            seeds = game_seeds(0, RunStream.CROSS, (a + b) % 3, count=5)
            played = game.play(line_up(game, champions(mine, 2)[0], champions(other, 2)[1]), seeds)
            assert table["r0, r1", f"run{a}", f"run{b}"] == np.mean(played.winner == 0)
            assert table["r2", f"run{b}", f"run{a}"] == np.mean(played.winner == 1)
    assert len(table) == 18


def test_only_champions_of_one_game_meet(three_runs, small_settings, go_on, tmp_path, ladder):
    assert same_game(three_runs)
    longer = go_on(create_run(tmp_path / "longer", small_settings("game.time_limit_steps=91")))
    assert not same_game([three_runs[0], longer])
    with pytest.raises(InputError, match="champions of different games cannot meet"):
        meet([three_runs[0], longer])
    assert not same_game([ladder(2), ladder(2, luck=1.0)])


def test_skills_are_the_same_by_what_they_do_and_not_by_where_they_lay(three_runs, small_settings, tmp_path):
    """One file changes between two runs; another is a copy of what the others play with."""
    mine = tmp_path / "mine.npz"
    runs = []
    for name in ("shoot", "search"):
        shutil.copy(skill_path(name), mine)
        runs.append(create_run(tmp_path / name, small_settings(f"skills.shoot={mine}")))
    assert same_game([three_runs[0], runs[0]])
    assert not same_game(runs)
    assert not same_game([three_runs[0], runs[1]])


def test_runs_with_levels_meet_those_without_in_the_game_of_the_recipe(three_runs, small_settings, go_on, tmp_path):
    """Champions that evolved beside a weak r2 play against the full one, like all others."""
    weak = 'levels.keys=[{"players.2.strength" = [0.4, 1.0]}]'
    levelled = go_on(create_run(tmp_path / "levelled", small_settings(weak, 'levels.keep="both sides winning"')))
    slower = go_on(create_run(tmp_path / "slower", small_settings("players.2.strength=0.4")))
    assert same_game([three_runs[0], levelled])
    assert not same_game([three_runs[0], slower])
    table = meet([three_runs[0], levelled]).set_index(["side", "run", "met"])["share"]
    game = SoccerGame(three_runs[0].config)
    seeds = game_seeds(0, RunStream.CROSS, 1, count=5)
    played = game.play(line_up(game, champions(levelled, 2)[0], champions(three_runs[0], 2)[1]), seeds)
    assert table["r0, r1", "levelled", "run0"] == np.mean(played.winner == 0)


def test_a_team_alone_meets_nobody(ladder):
    table = meet([ladder(1), ladder(1)], names=["a", "b"])
    assert table["met"].tolist() == ["0", "1", "0", "1"]
    assert table["share"].tolist() == [1.0] * 4
