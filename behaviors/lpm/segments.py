"""Segments of actions and observations, checked on the way in and standardised for the algebra."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

__all__ = ["Segment", "Signals", "check_segment", "check_segments"]

Array = NDArray[np.float64]
Segment = tuple[Array, Array]
"""(actions (T, m), observations (T, q)); `actions[t]` is the action that led to `observations[t]`."""

_PAIR = 2  # actions and observations
_CONSTANT = 1e-12  # a signal whose deviation is this small a share of its size is rounding noise


def check_segment(actions: ArrayLike, observations: ArrayLike, name: str) -> Segment:
    """Return the two arrays as float64.

    Raises:
        ValueError: if they are not (T, m) and (T, q) with the same T and m, q >= 1.
    """
    u, y = np.asarray(actions, dtype=np.float64), np.asarray(observations, dtype=np.float64)
    if (u.ndim, y.ndim) != (2, 2) or len(u) != len(y) or 0 in {u.shape[1], y.shape[1]}:
        raise ValueError(
            f"{name} must be actions (T, m) and observations (T, q) with the same T and m, q >= 1, but has "
            f"shapes {u.shape} and {y.shape}; give a single feature as a column, x[:, None]"
        )
    return u, y


def check_segments(segments: Sequence[tuple[ArrayLike, ArrayLike]]) -> list[Segment]:
    """Return all segments as float64.

    Raises:
        ValueError: if there are none, or one has a wrong shape, another m or q than the first, or values that
            are not finite.
    """
    checked: list[Segment] = []
    for index, segment in enumerate(segments):
        if len(segment) != _PAIR:
            raise ValueError(
                f"segment {index} has {len(segment)} parts; expected a list of pairs (actions (T, m), "
                "observations (T, q)), also where there is only one: [(actions, observations)]"
            )
        u, y = check_segment(*segment, f"segment {index}")
        checked.append((u, y))
        m, q = (signal.shape[1] for signal in checked[0])
        if (u.shape[1], y.shape[1]) != (m, q):
            raise ValueError(
                f"segment {index} has m = {u.shape[1]} and q = {y.shape[1]}, segment 0 has m = {m} and "
                f"q = {q}; identify one model from segments of the same signals"
            )
        finite = np.isfinite(u).all(axis=1) & np.isfinite(y).all(axis=1)
        if not finite.all():
            raise ValueError(
                f"segment {index} holds NaN or infinite values, first in row {int(np.argmin(finite))}; "
                "expected finite ones: end a segment where the object is lost, begin another where it is back"
            )
    if not checked:
        raise ValueError("no segments came; expected at least one pair (actions (T, m), observations (T, q))")
    return checked


@dataclass(frozen=True, eq=False)
class Signals:
    """Standardised segments (each signal mean-free with unit variance), and the way back to the data's units.

    What never varies is 0 in the segments and has scale 1.
    """

    segments: list[Segment]
    action_mean: Array
    action_scale: Array
    observation_mean: Array
    observation_scale: Array

    @classmethod
    def standardised(cls, segments: list[Segment], shortest_history: int) -> Signals:
        """Standardise the segments that hold a window of `shortest_history`, T >= 2l, and drop the others.

        Raises:
            ValueError: if none does, or no observation varies.
        """
        usable = [segment for segment in segments if len(segment[0]) >= 2 * shortest_history]
        if not usable:
            longest = max(len(actions) for actions, _ in segments)
            raise ValueError(
                f"history_length {shortest_history} needs a segment of at least {2 * shortest_history} rows, "
                f"the longest of {len(segments)} has {longest}; record longer ones or use a shorter history"
            )
        u, u_mean, u_scale, _ = _standardise([actions for actions, _ in usable])
        y, y_mean, y_scale, y_varies = _standardise([observations for _, observations in usable])
        if not y_varies.any():
            raise ValueError(
                f"all {len(y_scale)} observations are constant; expected at least one that varies: record "
                "data in which the object or the robot moves"
            )
        return cls(list(zip(u, y, strict=True)), u_mean, u_scale, y_mean, y_scale)

    @property
    def inputs(self) -> int:
        """Number of inputs, m."""
        return len(self.action_mean)

    @property
    def outputs(self) -> int:
        """Number of outputs, q."""
        return len(self.observation_mean)


def _standardise(parts: list[Array]) -> tuple[list[Array], Array, Array, NDArray[np.bool_]]:
    rows = np.concatenate(parts)
    mean, deviation = rows.mean(axis=0), rows.std(axis=0)
    varies = deviation > _CONSTANT * np.abs(rows).max(axis=0)
    scale = np.where(varies, deviation, 1.0)
    return [np.where(varies, (part - mean) / scale, 0.0) for part in parts], mean, scale, varies
