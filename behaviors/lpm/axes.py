"""Which way the axes of a state point: canonical variates turned until each says one thing about the image.

Canonical variate analysis leaves the axes open where correlations mu are nearly equal, and a state of unit
variance stays one under any rotation. The cells of (3.9) cut along the axes, so another sample of the same
experience gave another partition: the ball's bearing and distance on one axis each, or both mixed on two.
Varimax (Kaiser 1958), usual for canonical variates since Cliff and Krus (1976), turns the axes until each
correlates with few features.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from behaviors.lpm.model import LocalPredictionModel

__all__ = ["simple_axes", "varimax"]

Array = NDArray[np.float64]

_SWEEPS, _SMALL_RAD = 200, 1e-9


def varimax(loadings: Array) -> Array:
    """Return the rotation (n, n) that makes each column of ``loadings @ rotation`` large in few rows.

    Kaiser's own way: pairs of columns are turned by the best angle, which has a closed form, until none turns.

    Args:
        loadings: (features, n).
    """
    features, order = loadings.shape
    rotation = np.eye(order)
    for _ in range(_SWEEPS):
        largest = 0.0
        for i in range(order):
            for j in range(i):
                one, two = loadings @ rotation[:, i], loadings @ rotation[:, j]
                u, v = one * one - two * two, 2.0 * one * two
                above = 2.0 * (features * (u @ v) - u.sum() * v.sum())
                below = features * (u @ u - v @ v) - (u.sum() ** 2 - v.sum() ** 2)
                angle = 0.25 * float(np.arctan2(above, below))
                cosine, sine = np.cos(angle), np.sin(angle)
                turned_i = cosine * rotation[:, i] + sine * rotation[:, j]
                rotation[:, j] = cosine * rotation[:, j] - sine * rotation[:, i]
                rotation[:, i] = turned_i
                largest = max(largest, abs(angle))
        if largest < _SMALL_RAD:
            break
    return rotation


def simple_axes(model: LocalPredictionModel, segments: Sequence[tuple[Array, Array]]) -> Array:
    """Return the rotation (n, n) from the model's axes, as columns, to simple ones.

    Loadings are correlations with the newest features. An axis points so that its largest loading is
    positive; axes are in the order of how much they say of the features, most first.

    Args:
        model: identified from the segments.
        segments: (actions (T, m), observations (T, q)) of each stretch in view.
    """
    parts = [(model.states(u, y)[1:], y[:-1]) for u, y in segments if len(u) > model.history_length]
    states, seen = np.vstack([x for x, _ in parts]), np.vstack([y for _, y in parts])
    known = np.isfinite(states).all(axis=1)
    states, seen = states[known], seen[known]
    deviation, centred = states - states.mean(axis=0), seen - seen.mean(axis=0)
    scale = np.outer(centred.std(axis=0), deviation.std(axis=0))
    covariance = centred.T @ deviation / len(states)
    loadings = np.divide(covariance, scale, out=np.zeros_like(covariance), where=scale > 0.0)
    rotation = varimax(loadings)
    turned = loadings @ rotation
    rotation = rotation[:, np.argsort(-(turned**2).sum(axis=0), kind="stable")]
    turned = loadings @ rotation
    strongest = turned[np.abs(turned).argmax(axis=0), np.arange(model.order)]
    return np.asarray(rotation * np.where(strongest < 0.0, -1.0, 1.0))
