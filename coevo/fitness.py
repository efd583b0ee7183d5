"""Fitness of a robot from what happened in its games; smaller is better (Uchibe 1999, 6.3.3).

Goals and lost goals are those of the robot's team, kicks the steps in which it touched the ball, collisions its
own, steps those of all games together. All may be numbers or arrays of one shape. The weights carry the names of
Table 6.2; ``t_max`` is the number of games.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from coevo.config import FitnessSettings

__all__ = ["fixed", "score", "varying"]


def _short_of(value: ArrayLike, enough: float) -> NDArray[np.float64]:
    """h(x, y) of (6.2): how much is missing to ``enough``."""
    return np.maximum(0.0, enough - np.asarray(value, np.float64))


def fixed(
    goals: ArrayLike,
    lost: ArrayLike,
    kicks: ArrayLike,
    collisions: ArrayLike,
    steps: ArrayLike,
    *,
    alpha_g: float = 1.0,
    alpha_l: float = 0.5,
    alpha_k: float = 1e-3,
    alpha_c: float = 5e-3,
    alpha_s: float = 1e-4,
    beta: float = 4000.0,
    t_max: float = 20.0,
) -> NDArray[np.float64]:
    """Return the fixed fitness (6.1)."""
    return (
        alpha_g * _short_of(goals, t_max)
        + alpha_l * np.asarray(lost, np.float64)
        + alpha_k * _short_of(kicks, beta)
        + alpha_c * np.asarray(collisions, np.float64)
        + alpha_s * np.asarray(steps, np.float64)
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
    alpha_g: float = 1.0,
    alpha_l: float = 1.0,
    alpha_k: float = 1e-2,
    alpha_c: float = 1e-2,
    alpha_s: float = 1e-2,
    beta: float = 4000.0,
    t_max: float = 20.0,
) -> NDArray[np.float64]:
    """Return the varying fitness (6.3): kicks count less and less, collisions and time more and more.

    Args:
        goals, lost, kicks, collisions, steps: what happened.
        generation: g, from 0.
        generations: G, at least 1.
        alpha_g, alpha_l, alpha_k, alpha_c, alpha_s, beta, t_max: see Table 6.2.
    """
    past = generation / generations
    return fixed(
        goals,
        lost,
        kicks,
        collisions,
        steps,
        alpha_g=alpha_g,
        alpha_l=alpha_l,
        alpha_k=(1.0 - past) * alpha_k,
        alpha_c=past * alpha_c,
        alpha_s=past * alpha_s,
        beta=beta,
        t_max=t_max,
    )


def score(
    settings: FitnessSettings,
    counts: Mapping[str, NDArray[np.int64]],
    *,
    games: int,
    generation: int,
    generations: int,
) -> NDArray[np.float64]:
    """Return the fitness that the settings ask for; ``counts`` holds goals, lost, kicks, collisions, steps."""
    chosen = settings.fixed if settings.kind == "fixed" else settings.varying
    weights = msgspec.structs.asdict(chosen)
    what = [counts[name] for name in ("goals", "lost", "kicks", "collisions", "steps")]
    if settings.kind == "fixed":
        return fixed(*what, **weights, t_max=float(games))
    return varying(*what, generation=generation, generations=generations, **weights, t_max=float(games))
