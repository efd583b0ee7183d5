"""How good the actions of a state are when several rewards have a say, compiled (Uchibe 1999, 5.3.2)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import helper

__all__ = ["CHOICES", "VOTES", "score"]

CHOICES = ("votes", "votes-then-sum", "sum", "priority")
VOTES, VOTES_THEN_SUM, SUM, PRIORITY = range(4)


@helper
def _add_standardised(preferences: NDArray[np.float64], n: int, tolerance: float, scores: NDArray[np.float64]) -> None:
    """Add a channel's preferences in standard deviations from their mean; it abstains where it is flat."""
    actions = preferences.shape[0]
    low, high, mean = preferences[0, n], preferences[0, n], 0.0
    for a in range(actions):
        low, high = min(low, preferences[a, n]), max(high, preferences[a, n])
        mean += preferences[a, n] / actions
    if high - low <= tolerance:
        return
    variance = 0.0
    for a in range(actions):
        variance += (preferences[a, n] - mean) * (preferences[a, n] - mean) / actions
    for a in range(actions):
        scores[a] += (preferences[a, n] - mean) / math.sqrt(variance)


@helper
def _add_votes(preferences: NDArray[np.float64], n: int, tolerance: float, scores: NDArray[np.float64]) -> None:
    """Give a channel's vote to its best action (5.11), and to all within the tolerance of it."""
    best = preferences[0, n]
    for a in range(preferences.shape[0]):
        best = max(best, preferences[a, n])
    for a in range(preferences.shape[0]):
        if preferences[a, n] >= best - tolerance:
            scores[a] += 1.0


@helper
def _filter(preferences: NDArray[np.float64], tolerances: NDArray[np.float64], scores: NDArray[np.float64]) -> None:
    """Count how many channels, one after the other, found an action among the best of those that were left."""
    actions, channels = preferences.shape
    for n in range(channels):
        best = -np.inf
        for a in range(actions):
            if scores[a] == n:
                best = max(best, preferences[a, n])
        for a in range(actions):
            if scores[a] == n and preferences[a, n] >= best - tolerances[n]:
                scores[a] += 1.0


@helper
def score(
    choice: int, preferences: NDArray[np.float64], tolerances: NDArray[np.float64], scores: NDArray[np.float64]
) -> None:
    """Fill (actions,) scores of a state, of which the highest is chosen.

    Votes: how many channels are for an action, the rank of (5.12). Votes, then sum: with the standardised sum between
    equals. Sum: of the channels' preferences, each standardised over the actions. Priority: how many channels, one
    after the other, found the action among the best of those that were left.

    Args:
        choice: number of one of CHOICES.
        preferences: (actions, channels), p(x, u) of the state.
        tolerances: (channels,).
        scores: filled.
    """
    actions, channels = preferences.shape
    for a in range(actions):
        scores[a] = 0.0
    if choice == PRIORITY:
        _filter(preferences, tolerances, scores)
        return
    if choice != VOTES:
        for n in range(channels):
            _add_standardised(preferences, n, tolerances[n], scores)
        if choice == SUM:
            return
        low, high = scores[0], scores[0]
        for a in range(actions):
            low, high = min(low, scores[a]), max(high, scores[a])
        for a in range(actions):  # less than a vote
            scores[a] = 0.5 * (scores[a] - low) / (high - low) if high > low else 0.0
    for n in range(channels):
        _add_votes(preferences, n, tolerances[n], scores)
