"""Outsiders: who they are, and that what they meet is what single games give."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.tournament import play_against, read_outsider, single_skill_outsiders
from analysis.tournament.tables import against_table
from coevo.contest import champions, line_up
from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator
from coevo.game import SoccerGame
from coevo.seeds import RunStream, game_seeds


def meet(run, outsiders, generations=(0, 2), games=6):
    with Evaluator(run.config, workers=2, backend="threads", folders=run.folders) as evaluator:
        return play_against(run, evaluator, outsiders, generations=generations, games=games)


def test_outsiders_meet_every_generation_from_the_same_starts(small_run):
    found = meet(small_run, [read_outsider(small_run, "shoot"), read_outsider(small_run, "pass+shoot")])
    game = SoccerGame(small_run.config)
    seeds = game_seeds(small_run.config.seed, RunStream.TOURNAMENT, small_run.config.gp.generations, count=6)
    shoot = read_outsider(small_run, "shoot")
    for i, generation in enumerate((0, 2)):
        of = champions(small_run, generation)
        for team in (0, 1):
            alone = game.play(line_up(game, of[team], shoot.line_up(game, 1 - team)), seeds)
            assert found.wins[team, i, 0] == (alone.winner == team).sum()
            assert found.lost[team, i, 0] == (alone.winner == 1 - team).sum()
    assert np.all(found.wins[0, :, 1] == -1)  # pass+shoot are two robots: there is no such side against r0 and r1
    assert np.all(found.wins[1, :, 1] >= 0)
    table = against_table(found, {0: "r0, r1", 1: "r2"})
    assert len(table) == 6
    assert np.all((table["low"] <= table["share"]) & (table["share"] <= table["high"]))


def test_the_champions_of_a_run_can_be_outsiders(ladder):
    run, other = ladder(2), ladder(2)
    found = meet(run, [read_outsider(run, str(other.path))], generations=(0, 3), games=2)
    mine = [next(n for n in run.tree("p0", g).names if n[0] == "s") for g in (0, 3)]
    theirs = next(n for n in other.tree("p1", 3).names if n[0] == "s")
    assert found.wins[0, :, 0].tolist() == [2 * (name > theirs) for name in mine]


def test_a_team_alone_is_compared_with_who_is_in_its_place(ladder):
    run = ladder(1)
    found = meet(run, single_skill_outsiders(run), generations=(0, 3), games=5)
    assert found.outsiders == tuple(f"s{k}" for k in range(8))
    assert np.all(found.wins == 5)
    assert np.all(found.lost == -1)


def test_what_was_played_is_read(small_run):
    outsiders = single_skill_outsiders(small_run)
    first = meet(small_run, outsiders)
    again = play_against(small_run, None, outsiders, generations=(0, 2), games=6)
    assert np.array_equal(first.wins, again.wins)


def test_a_tree_longer_than_a_file_name_is_a_tree(small_run):
    text = "shoot"
    for _ in range(200):
        text = f"IF_ball_is_lost({text}, search)"
    assert read_outsider(small_run, text).trees[0] == (0, text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("shout", "unknown name 'shout' .*Did you mean 'shoot'"),
        ("IF_ball_is_lost(search", "the text ends"),
        ("shoot+pass+shoot", "no side has 3 robots; give one tree for all, or one for each"),
        ("IF_r1_is_lost(search, shoot)", "IF_r1_is_lost"),
    ],
)
def test_an_outsider_that_cannot_play_is_told(text, message, small_run):
    with pytest.raises(InputError, match=message):
        read_outsider(small_run, text)
