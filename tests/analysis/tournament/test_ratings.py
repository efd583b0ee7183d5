"""Ratings against results that were drawn from known ones."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.tournament import Tournament, rate
from coevo.errors import InputError


def tournament(chances, games, random):
    """Return a tournament of two teams whose games team 0 wins by ``chances`` (n, n), and team 1 otherwise."""
    won = random.binomial(games, chances)
    n = len(chances)
    wins = np.stack([won, games - won], axis=-1)[None]
    totals = np.zeros((1, n, n, 2, 1), np.int64)
    foreign = np.zeros((1, n, n), np.int64)
    return Tournament((0, 1), (("a",), ("b",)), tuple(range(n)), games, "best", wins.astype(np.int64), foreign, totals)


def by_skill(first, second):
    return 1.0 / (1.0 + np.exp(-np.subtract.outer(first, second)))


def test_intervals_hold_the_true_ratings():
    random = np.random.default_rng(1)
    held = total = 0
    for _ in range(30):
        first, second = random.normal(0.0, 0.8, 12), random.normal(0.5, 0.8, 12)
        table = rate(tournament(by_skill(first, second), 20, random)).table
        truth = 400.0 / np.log(10.0) * np.concatenate([first - first.mean(), second - second.mean()])
        held += int(((table["low"] <= truth) & (truth <= table["high"])).sum())
        total += len(truth)
    assert 0.925 < held / total < 0.975  # 720 intervals of 95 %: five standard deviations would be 0.04


def test_ratings_without_luck_are_the_log_odds():
    first, second = np.array([-0.5, 0.0, 0.5]), np.array([0.3, 0.0, -0.3])
    games = 10**6
    exact = tournament(by_skill(first, second), games, np.random.default_rng(0))
    exact.wins[0, :, :, 0] = np.round(games * by_skill(first, second))
    exact.wins[0, :, :, 1] = games - exact.wins[0, :, :, 0]
    table = rate(exact).table
    assert table["rating"].to_numpy() == pytest.approx(400.0 / np.log(10.0) * np.concatenate([first, second]), abs=0.01)
    assert table.groupby("team")["rating"].mean().to_numpy() == pytest.approx(0.0, abs=1e-9)


def test_the_misfit_tells_cycles_from_one_order():
    random, n = np.random.default_rng(2), 20
    first, second = random.normal(0.0, 1.0, n), random.normal(0.0, 1.0, n)
    ordered = np.mean([rate(tournament(by_skill(first, second), 20, random)).misfit for _ in range(5)])
    phase = 2.0 * np.pi * np.arange(n) / 7
    cycling = 0.5 + 0.4 * np.sin(np.subtract.outer(phase, phase))
    assert ordered == pytest.approx(1.0, abs=0.15)
    assert rate(tournament(cycling, 20, random)).misfit > 3.0


def test_who_always_wins_has_a_finite_rating():
    chances = np.ones((3, 3))
    chances[0] = 0.5
    table = rate(tournament(chances, 20, np.random.default_rng(3))).table
    assert np.isfinite(table[["rating", "low", "high"]].to_numpy()).all()
    assert table["rating"][1] > table["rating"][0]


def test_a_drawn_game_counts_half_for_each():
    drawn = tournament(np.full((4, 4), 0.5), 20, np.random.default_rng(4))
    drawn.wins[:] = 0
    assert rate(drawn).table["rating"].to_numpy() == pytest.approx(0.0, abs=1e-6)


def test_a_team_alone_is_not_rated():
    parts = [np.zeros((1, 2, 2, *rest), int) for rest in ((1,), (), (1, 1))]
    alone = Tournament((0,), (("a",),), (0, 1), 2, "best", *parts)
    with pytest.raises(InputError, match="nobody to be rated against"):
        rate(alone)
