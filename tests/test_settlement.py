"""How games end, by the rule that is written down; and since when one side is ahead."""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd
import pytest

from coevo.contest import champions, line_up
from coevo.evolution.evaluation import Evaluator
from coevo.game import Role
from coevo.run import open_run
from coevo.seeds import RunStream, game_seeds
from coevo.settlement import PATTERNS, Settled, classify, settle, settlement_columns, taken_over


class Three:
    roles = (Role("r0", 0), Role("r1", 0), Role("r2", 1))


def in_words(winner, kicks, passes, own):
    """Return the pattern of one game by the definitions, read one by one."""
    if winner == -1:
        return "time-out"
    losers = [2] if winner == 0 else [0, 1]
    if any(own[robot] for robot in losers):
        return "own goal"
    if winner == 0:
        return "pass and shoot" if passes[0] or passes[1] else "alone"
    return "interception" if kicks[0] or kicks[1] else "unopposed"


def test_every_game_has_the_pattern_that_is_written_down():
    flags = list(itertools.product((-1, 0, 1), *[(0, 3)] * 3, *[(0, 2)] * 2, *[(0, 1)] * 3))
    table = np.array(flags, np.int64)
    zeros = np.zeros(len(table), np.int64)
    counts = {
        "kicks": table[:, 1:4],
        "passes": np.column_stack([table[:, 4:6], zeros]),
        "own_goals": table[:, 6:9],
    }
    found = classify(Three(), counts, table[:, 0], 0)
    expected = [
        in_words(winner, counts["kicks"][k], counts["passes"][k], counts["own_goals"][k])
        for k, winner in enumerate(table[:, 0])
    ]
    assert [PATTERNS[k] for k in found] == expected
    assert set(expected) == set(PATTERNS)


def settled(*counts, take_over=None):
    return Settled("run", ("r0", "r1"), ("r2",), np.repeat(np.arange(len(PATTERNS)), counts), take_over)


def test_shares_ratio_and_the_most_frequent_of_the_decided():
    one = settled(10, 5, 30, 0, 5, 50, take_over=18)
    assert one.ratio() == 0.25
    assert one.most == "interception"
    columns = settlement_columns(one)
    assert columns["settled_pass_and_shoot"] == 0.1
    assert sum(value for name, value in columns.items() if name not in ("settled_ratio", "take_over")) == 1.0
    assert (columns["settled_ratio"], columns["take_over"]) == (0.25, 18.0)
    none = settled(0, 0, 0, 0, 0, 7)
    assert none.most == "time-out"
    assert np.isnan([none.ratio(), settlement_columns(none)["take_over"]]).all()


def test_there_is_no_ratio_where_nobody_could_intercept():
    patterns = np.zeros(10, np.int64)  # all by pass and shoot
    assert np.isnan(Settled("run", ("r0", "r1"), (), patterns, None).ratio())
    assert Settled("run", ("r0", "r1"), ("r2",), patterns, None).ratio() == 1.0


def goals_table(first, second, other):
    rows = [
        (g, robot, goals[g])
        for robot, goals in (("r0", first), ("r1", second), ("r2", other))
        for g in range(len(first))
    ]
    return pd.DataFrame(rows, columns=["generation", "robot", "goals"])


@pytest.mark.parametrize(
    ("first", "second", "other", "since"),
    [
        ([0, 0, 0], [0, 0, 0], [1, 1, 1], 0),
        ([5, 1, 1], [0, 3, 0], [2, 2, 2], 2),  # r1 is ahead in generation 1
        ([0, 0, 2], [0, 0, 0], [1, 1, 2], None),  # level is not ahead
        ([2, 0, 2, 0], [0, 0, 0, 0], [1, 1, 1, 1], 3),  # that of generation 1 was not for good
    ],
)
def test_a_take_over_is_for_good(first, second, other, since):
    assert taken_over(goals_table(first, second, other), ("r0", "r1"), ("r2",)) == since
    assert taken_over(goals_table(first, second, other), ("r0", "r1"), ()) is None


def test_games_of_champions_are_classified_one_by_one_and_kept(copied_run):
    small_run = open_run(copied_run)
    with Evaluator(small_run.config, workers=2, backend="threads") as evaluator:
        found = settle(small_run, evaluator, games=70)
    game, last = small_run.game, champions(small_run, small_run.finished - 1)
    expected = []
    for seed in game_seeds(small_run.config.seed, RunStream.ANSWERED, 3000, count=70):
        played = game.play(line_up(game, *last.values()), np.array([seed]))
        expected.append(classify(game, played.counts, played.winner, 0)[0])
    assert found.patterns.tolist() == expected
    assert (found.first, found.others) == (("r0", "r1"), ("r2",))
    again = settle(open_run(small_run.path), None, games=70)
    assert again.patterns.tolist() == expected
