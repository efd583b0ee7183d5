"""The loop of blocks: what is run, checked and kept, on tables whose every change is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from behaviors.practice import Practice, Standing, joined
from behaviors.settings import LearningSettings
from behaviors.tabular.table import make_table, with_room
from behaviors.trials.kernels import Results
from behaviors.trials.task import CHANNELS


class Scene:
    """Stands for trials: each adds 1 to all values of robot 0, and 10 to those of robot 1."""

    time_limit = 7

    def __init__(self, *, sparse=False) -> None:
        self.minds = [SimpleNamespace(table=make_table(5, 2, sparse=sparse)) for _ in range(2)]
        bank, roles = SimpleNamespace(min_steps=np.array([1, 3])), SimpleNamespace(skill=np.array([0, 1]))
        self.trial = SimpleNamespace(stage=SimpleNamespace(bank=bank, roles=roles))
        self.grown, self.ran = [], []

    def grow(self, robot, states):
        self.grown.append((robot, states))
        self.minds[robot].table = with_room(self.minds[robot].table, states)

    def run(self, first, count):
        self.ran.append((first, count))
        for mind, step in zip(self.minds, (1.0, 10.0), strict=True):
            mind.table.values[:] += step * count
        numbers = np.arange(first, first + count)
        columns = len(Results._fields) - 1
        return Results(*(numbers + k for k in range(columns)), np.zeros((count, 0, CHANNELS), np.int64))


def practice_of(scores, *, total=1000, block=100, early=False, learners=(0, 1), **rule):  # noqa: ANN003 - settings
    """Return a practice whose checks score as told, one after the other."""
    scene, told = Scene(), iter(scores)
    numbers = LearningSettings(**{"check_every": 100, "check_from": 0.3, **rule})

    def check():
        score = next(told)
        return score, {"score": score}

    found = Practice(scene, learners, total, scene.run, check=check, rule=numbers, early=early, block=block)
    return scene, found


def finish(practice):
    while not practice.is_finished:
        practice.advance()
    return practice


SCORES = (0.2, 0.9, 0.5, 0.9, 0.1, 0.4, 0.95, 0.3)  # after 300, 400, ... trials


@pytest.mark.parametrize(
    ("scores", "best"),
    [
        (SCORES, 900),
        ((0.7, *SCORES[1:6], 0.8, 0.0), 600),  # of equals the later one
        (tuple(range(8)), 1000),
        (tuple(range(8))[::-1], 300),
        ((-1.0,) * 8, 1000),
    ],
    ids=["peak", "equals", "rising", "falling", "all alike"],
)
def test_the_tables_that_scored_best_are_kept(scores, best):
    _, practice = practice_of(scores)
    finish(practice)
    assert practice.kept_after == best
    for robot, values in enumerate(practice.values_kept()):
        assert (values == best * (1.0, 10.0)[robot]).all()
    for robot, values in enumerate(practice.values_now()):
        assert (values == 1000 * (1.0, 10.0)[robot]).all()
    kept = [row["trials"] for row in practice.at.checks if row["kept"]]
    running = [300 + 100 * n for n, score in enumerate(scores) if score == max(scores[: n + 1])]
    assert kept == running
    assert practice.at.best_score == max(scores)


def test_checks_before_the_rule_lets_them_are_told_but_keep_nothing():
    _, practice = practice_of((9.0, 8.0, *SCORES), early=True)
    finish(practice)
    assert [(row["trials"], row["score"]) for row in practice.at.checks] == [
        (100 * (n + 1), score) for n, score in enumerate((9.0, 8.0, *SCORES))
    ]
    assert [row["kept"] for row in practice.at.checks[:3]] == [0, 0, 1]
    assert practice.kept_after == 900


def test_a_check_is_due_when_its_number_of_trials_is_passed_and_at_the_end():
    _, practice = practice_of((1.0,) * 9, total=1050, block=100, check_every=250, check_from=0.0)
    finish(practice)
    assert [row["trials"] for row in practice.at.checks] == [300, 500, 800, 1000, 1050]


@pytest.mark.parametrize("rule", [{"check_every": 0}, {}], ids=["no checks", "no check"])
def test_without_checks_the_last_tables_are_kept(rule):
    scene, practice = practice_of((), **rule)
    if not rule:
        practice = Practice(scene, (0, 1), 1000, scene.run, block=100)
    finish(practice)
    assert practice.kept_after == 1000
    assert (practice.values_kept()[0] == 1000.0).all()
    assert practice.at.checks == []


def test_blocks_are_run_one_after_the_other_and_results_are_joined():
    scene, practice = practice_of((), total=250, block=100, check_every=0)
    assert [len(practice.advance().ends) for _ in range(3)] == [100, 100, 50]
    assert scene.ran == [(0, 100), (100, 100), (200, 50)]
    assert practice.at.results.ends.tolist() == list(range(250))
    assert practice.at.results.nearer.tolist() == list(range(3, 253))
    assert practice.is_finished


def test_only_tables_of_robots_that_learn_grow_by_what_a_block_may_visit():
    scene, practice = practice_of((), total=150, block=100, learners=(1,), check_every=0)
    finish(practice)
    assert scene.grown == [(1, 100 * 4), (1, 50 * 4)]  # 7 steps, at least 3 a decision: 3 decisions, and the last state
    assert len(practice.at.tables) == 1
    assert practice.at.tables[0] is scene.minds[1].table


@pytest.mark.parametrize("stop", range(11))
def test_a_practice_that_goes_on_from_where_it_stood_ends_as_if_it_had_not_stopped(stop):
    whole = finish(practice_of(SCORES)[1])
    scene, practice = practice_of(SCORES)
    for _ in range(stop):
        practice.advance()
    standing = Standing.unpack(*practice.at.pack())
    assert standing.best_score == practice.at.best_score
    again = Scene()
    for mind, table in zip(again.minds, standing.tables, strict=True):
        mind.table = table
    after = Practice(
        again, (0, 1), 1000, again.run, check=practice._check, rule=practice._rule, block=100, standing=standing
    )
    finish(after)
    assert scene.ran + again.ran == [(n, 100) for n in range(0, 1000, 100)]
    assert after.at.checks == whole.at.checks
    assert after.kept_after == whole.kept_after
    for one, other in zip(after.values_kept(), whole.values_kept(), strict=True):
        assert np.array_equal(one, other)
    for one, other in zip(after.at.results, whole.at.results, strict=True):
        assert np.array_equal(one, other)


def test_results_are_joined_column_by_column():
    columns = range(len(Results._fields))
    one, two = (Results(*(np.full(length, value) for value in columns)) for length in (2, 3))
    assert [column.tolist() for column in joined([one, two])] == [[value] * 5 for value in columns]
