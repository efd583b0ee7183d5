"""Choice among actions by several rewards, against slow references written from (5.10) to (5.12)."""

from __future__ import annotations

import numpy as np
import pytest

from behaviors.actor_critic.choice import CHOICES, score

RNG = np.random.default_rng(5)


def scored(choice, preferences, tolerances):
    scores = np.full(len(preferences), 7.0)
    score(CHOICES.index(choice), np.ascontiguousarray(preferences), np.array(tolerances), scores)
    return scores


def ranks(preferences, tolerances):
    """Return rank(u) of (5.12), by counting for each action the channels to which no other is clearly better."""
    rank = []
    for mine in preferences:
        better = [(other - mine > tolerances) for other in preferences]
        rank.append(sum(not any(column) for column in zip(*better, strict=True)))
    return rank


def lexicographic(preferences, tolerances):
    left = list(range(len(preferences)))
    passed = np.zeros(len(preferences))
    for n, tolerance in enumerate(tolerances):
        best = max(preferences[a][n] for a in left)
        left = [a for a in left if preferences[a][n] >= best - tolerance]
        passed[left] += 1
    return passed


def cases(count):
    """Return (preferences, tolerances), many with equals and with flat channels."""
    for _ in range(count):
        actions, channels = RNG.integers(2, 10), RNG.integers(1, 7)
        preferences = RNG.integers(-2, 3, (actions, channels)) / 4.0
        preferences[:, RNG.random(channels) < 0.2] = 0.25
        yield preferences, RNG.choice([0.0, 1e-9, 0.25, 0.5], channels)


def test_votes_are_those_of_a_slow_reference():
    for preferences, tolerances in cases(5000):
        assert scored("votes", preferences, tolerances).tolist() == ranks(preferences, tolerances)


def test_priority_is_a_filter_one_channel_after_the_other():
    for preferences, tolerances in cases(3000):
        assert np.array_equal(scored("priority", preferences, tolerances), lexicographic(preferences, tolerances))


def test_the_sum_is_of_standard_scores_and_knows_neither_offset_nor_scale():
    for preferences, _ in cases(1000):
        spread = preferences.std(axis=0)
        told = preferences[:, spread > 0]
        expected = ((told - told.mean(axis=0)) / told.std(axis=0)).sum(axis=1)
        none = np.zeros(preferences.shape[1])
        assert scored("sum", preferences, none) == pytest.approx(expected)
        changed = preferences * RNG.uniform(1.0, 9.0, preferences.shape[1]) + RNG.normal(size=preferences.shape[1])
        assert scored("sum", changed, none + 1e-12) == pytest.approx(expected)


def test_between_equals_in_votes_the_sum_decides():
    for preferences, tolerances in cases(1000):
        votes, both = (scored(choice, preferences, tolerances) for choice in ("votes", "votes-then-sum"))
        total = scored("sum", preferences, tolerances)
        best = np.flatnonzero(votes == votes.max())
        assert both.argmax() in best
        assert total[both.argmax()] == pytest.approx(total[best].max())
        assert (np.floor(both) == votes).all()


def test_a_flat_channel_abstains_and_a_single_one_decides_alone():
    preferences = np.array([[0.1, 3.0], [0.1, 5.0], [0.1, 4.0]])
    for choice in CHOICES:
        assert scored(choice, preferences, [1e-9, 0.0]).argmax() == 1
        assert scored(choice, preferences[:, 1:], [0.0]).argmax() == 1


def test_whoever_is_best_in_votes_is_weakly_pareto_optimal():
    for preferences, _ in cases(1000):
        best = preferences[scored("votes", preferences, np.zeros(preferences.shape[1])).argmax()]
        assert not (preferences > best).all(axis=1).any()
