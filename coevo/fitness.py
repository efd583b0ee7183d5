"""Fitness of a robot from what happened in its games; smaller is better (Uchibe 1999, 6.3.3).

All arguments may be numbers or arrays of one shape: goals and lost goals of the robot's team, steps in which it
touched the ball, its collisions, and the steps of all games together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coevo.config import FitnessSettings, FitnessWeights
from coevo.errors import InputError, nearest_name

__all__ = ["fixed", "score", "varying"]

_DEFAULTS = FitnessSettings()
_WEIGHTS = ("goals", "lost", "kicks", "collisions", "steps", "enough_kicks")


def _short_of(value: ArrayLike, enough: float) -> NDArray[np.float64]:
    """h(x, y) of (6.2): how much is missing to ``enough``."""
    return np.maximum(0.0, enough - np.asarray(value, np.float64))


def _weights(defaults: FitnessWeights, given: dict[str, float]) -> dict[str, float]:
    for name in given:
        if name not in (*_WEIGHTS, "games"):
            raise InputError(f"unknown weight {name!r}.{nearest_name(name, _WEIGHTS)} Known: {', '.join(_WEIGHTS)}, games")
    return {"games": 20.0} | {name: getattr(defaults, name) for name in _WEIGHTS} | given


def fixed(
    goals: ArrayLike, lost: ArrayLike, kicks: ArrayLike, collisions: ArrayLike, steps: ArrayLike, **weights: float
) -> NDArray[np.float64]:
    """Return the fixed fitness (6.1).

    Args:
        goals, lost, kicks, collisions, steps: what happened, see above.
        **weights: replace constants of Table 6.2: goals, lost, kicks, collisions, steps, enough_kicks; ``games``
            is the number of games T_max (20).

    Raises:
        InputError: a weight is unknown.
    """
    w = _weights(_DEFAULTS.fixed, weights)
    return (
        w["goals"] * _short_of(goals, w["games"])
        + w["lost"] * np.asarray(lost, np.float64)
        + w["kicks"] * _short_of(kicks, w["enough_kicks"])
        + w["collisions"] * np.asarray(collisions, np.float64)
        + w["steps"] * np.asarray(steps, np.float64)
    )


def varying(
    goals: ArrayLike,
    lost: ArrayLike,
    kicks: ArrayLike,
    collisions: ArrayLike,
    steps: ArrayLike,
    *,
    generation: int,
    generations: int,
    **weights: float,
) -> NDArray[np.float64]:
    """Return the varying fitness (6.3): kicks count less and less, collisions and time more and more.

    Args:
        goals, lost, kicks, collisions, steps: what happened, see above.
        generation, generations: g, from 0, and G.
        **weights: as for ``fixed``.

    Raises:
        InputError: a weight is unknown.
    """
    w = _weights(_DEFAULTS.varying, weights)
    past = generation / generations
    return (
        w["goals"] * _short_of(goals, w["games"])
        + w["lost"] * np.asarray(lost, np.float64)
        + (1.0 - past) * w["kicks"] * _short_of(kicks, w["enough_kicks"])
        + past * w["collisions"] * np.asarray(collisions, np.float64)
        + past * w["steps"] * np.asarray(steps, np.float64)
    )


def score(
    settings: FitnessSettings,
    counts: dict[str, NDArray[np.int64]],
    *,
    games: int,
    generation: int,
    generations: int,
) -> NDArray[np.float64]:
    """Return the fitness that the settings ask for; ``counts`` holds the five arguments of ``fixed`` by name."""
    chosen = settings.fixed if settings.kind == "fixed" else settings.varying
    weights = {name: getattr(chosen, name) for name in _WEIGHTS} | {"games": float(games)}
    given = (counts["goals"], counts["lost"], counts["kicks"], counts["collisions"], counts["steps"])
    if settings.kind == "fixed":
        return fixed(*given, **weights)
    return varying(*given, generation=generation, generations=generations, **weights)
