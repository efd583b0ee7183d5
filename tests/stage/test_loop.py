"""The one loop of games and trials: who is called when, and when it ends."""

from __future__ import annotations

import numpy as np
import pytest

from coevo.compiled import entry
from coevo.stage import GOING, run_episode

RNG = np.array([5], np.uint64)


class Episode:
    """Notes every call; its judge ends it at a time with a verdict, or never."""

    def __init__(self, end=None, verdict=3) -> None:
        self.end, self.verdict, self.calls = end, verdict, []

    def run(self, limit):
        return run_episode.py_func(self, limit, RNG, Episode.sense, Episode.act, Episode.judge)

    def sense(self, time, rng):
        assert rng is RNG
        self.calls.append(("sense", time))

    def act(self, time, rng):
        assert rng is RNG
        self.calls.append(("act", time))

    def judge(self, time):
        self.calls.append(("judge", time))
        return self.verdict if time == self.end else GOING


def test_robots_see_are_judged_and_act_in_this_order_until_time_is_up():
    one = Episode()
    assert one.run(2) == (GOING, 2)
    assert one.calls == [
        ("sense", 0),
        ("act", 0),
        ("sense", 1),
        ("judge", 1),
        ("act", 1),
        ("sense", 2),
        ("judge", 2),
    ]


@pytest.mark.parametrize("end", [1, 2, 7])
def test_a_verdict_ends_it_after_the_step_that_brought_it(end):
    one = Episode(end)
    assert one.run(100) == (3, end)
    assert one.calls[-2:] == [("sense", end), ("judge", end)]
    assert [time for name, time in one.calls if name == "act"] == list(range(end))


def test_a_verdict_in_the_last_step_counts():
    assert Episode(4).run(4) == (3, 4)
    assert Episode(5).run(4) == (GOING, 4)


@pytest.mark.parametrize("verdict", [1, 4, -1])
def test_anything_but_going_is_an_end(verdict):
    assert Episode(2, verdict).run(9) == (verdict, 2)


@entry
def _compiled(counts, limit, rng):
    return run_episode(counts, limit, rng, _sense, _act, _judge)


@entry
def _sense(counts, time, _rng):
    counts[0] += time


@entry
def _act(counts, time, _rng):
    counts[1] += 10 * time


@entry
def _judge(counts, _time):
    counts[2] += 1
    return 7 if counts[2] == 4 else 0


def test_compiled_it_is_the_same_loop():
    for limit in (3, 4, 9):
        one, two = np.zeros(3, np.int64), np.zeros(3, np.int64)
        plain = run_episode.py_func(two, limit, RNG, _sense.py_func, _act.py_func, _judge.py_func)
        assert _compiled(one, limit, RNG) == plain
        assert one.tolist() == two.tolist()
