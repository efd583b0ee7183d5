"""What is left of an advantage: all of it where there is no luck, nothing where there is nothing else."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from analysis.tournament import left_over, play_again
from coevo.evolution.evaluation import Evaluator


def again(run, *, workers=1, generations=(0, 1, 2, 3), repeats=3):
    with Evaluator(run.config, workers=workers, backend="threads", folders=run.folders) as evaluator:
        return play_again(run, evaluator, generations=generations, repeats=repeats)


def test_without_luck_all_of_it_is_left(ladder):
    run = ladder(2, generations=2)
    table = again(run, generations=(0, 1))
    assert table["again"].tolist() == table["fitness"].tolist()
    assert table["spread"].tolist() == [0.0] * 4
    for one in left_over(table):
        assert (one.share, one.low, one.high) == (1.0, None, None)  # two generations: no interval
        assert (one.generations, one.text) == (2, "100%")


@pytest.mark.parametrize("grouping", ["partners", "best", "hall-of-fame"])
def test_however_they_are_grouped_as_many_games_are_played_again(grouping, ladder):
    """Each is as strong as it is, whoever else plays: what is counted again is what was counted."""
    run = ladder(3, generations=3, population=6, games=4, grouping=grouping, partners=2)
    table = again(run, generations=(0, 1, 2), repeats=2)
    assert table["again"].tolist() == table["fitness"].tolist()


def test_of_luck_alone_nothing_is_left(ladder):
    run = ladder(2, skill=0.0, luck=1.0, generations=20, population=30)
    for one in left_over(again(run, generations=tuple(range(20)), repeats=10)):
        assert one.low < 0.0 < one.high
        assert abs(one.share) < 0.2


def test_of_both_what_is_left_is_between(ladder):
    run = ladder(2, skill=0.15, luck=1.0, generations=10, population=30)
    for one in left_over(again(run, generations=tuple(range(10)), repeats=20)):
        assert 0.1 < one.low < one.share < one.high < 0.95


def test_what_evolution_saw_is_what_the_run_says_and_all_is_kept(ladder):
    run = ladder(2, luck=1.0)
    table = again(run)
    for _, row in table.iterrows():
        of = run.record(int(row["generation"]), row["robot"])
        assert row["fitness"] == of["fitness"].min()
        assert row["mean"] == pytest.approx(of["fitness"].mean())
    pd.testing.assert_frame_equal(play_again(run, None, generations=(0, 1, 2, 3), repeats=3), table)


def test_workers_change_nothing(small_run):
    with Evaluator(small_run.config, workers=1, backend="threads") as evaluator:
        one = play_again(small_run, evaluator, generations=(0, 2), repeats=2)
    (small_run.path / "results" / "again-2x2-every2-to2.npz").unlink()
    with Evaluator(small_run.config, workers=2, backend="processes") as evaluator:
        two = play_again(small_run, evaluator, generations=(0, 2), repeats=2)
    assert np.array_equal(one["again"], two["again"])
