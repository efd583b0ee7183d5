"""Which history length, and which order: what each of them achieves, and the rules that choose.

The history length by the norm of R, as in Uchibe 1999, 3.2.3, by what a longer one gains, or by the AIC of a
regression, as in Larimore 1990; the order by AIC.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from behaviors.lpm.cva import (
    RELATIVE_CUTOFF,
    CanonicalVariates,
    Windows,
    canonical_variates,
    fit_orders,
    lagged,
    stack_windows,
    window_count,
)

if TYPE_CHECKING:
    from behaviors.lpm.segments import Signals

__all__ = ["MAX_HISTORY_LENGTH", "Analysis", "Candidate", "by_gain", "by_norm", "by_regression", "fixed"]

Array = NDArray[np.float64]

MAX_HISTORY_LENGTH = 10
"""Longest history that is tried where none is given; a given one may be longer."""

_MINIMUM_GAIN = 0.05  # "gain": a longer history has to shrink the norm of R by this share
_TOLERANCE = 0.01  # "norm": by how much more than the smallest the norm of R may be
_WINDOWS_PER_VARIABLE = 5  # with fewer, a longer history shrinks R by over-fitting alone


@dataclass(frozen=True)
class Analysis:
    """How a history length is analysed.

    project: regress future actions out of past and future.
    free: count in AIC the free parameters of the innovations form (Larimore 1990), not all entries (3.7).
    """

    project: bool
    free: bool


@dataclass(frozen=True, eq=False)
class Candidate:
    """Canonical variates of one history length and what each order achieves, all of standardised signals.

    windows: mean-free; past_mean, action_mean and observation_mean are what was taken away.
    states: (windows, rank): x_t of the highest order, (A.9).
    aic: (rank,): AIC(n) for n = 1 .. rank, of R in the units of the data, (3.6).
    norm: (rank,): spectral norm of R of standardised observations.
    """

    history_length: int
    windows: Windows
    past_mean: Array
    action_mean: Array
    observation_mean: Array
    variates: CanonicalVariates
    states: Array
    aic: Array
    norm: Array

    @property
    def rank(self) -> int:
        """Largest possible order."""
        return len(self.variates.weights)

    @property
    def best_order(self) -> int:
        """Order of the smallest AIC."""
        return int(np.argmin(self.aic)) + 1


def fixed(signals: Signals, how: Analysis, length: int, order: int | None) -> Candidate:
    """Analyse one history length.

    Raises:
        ValueError: for too few windows, nothing to predict, or an order that it does not allow.
    """
    _require_windows(signals, how, length)
    candidate = _analyse(signals, how, length)
    if order is not None and order > candidate.rank:
        raise _order_too_large(order, candidate)
    return candidate


def by_gain(signals: Signals, how: Analysis, order: int | None, threshold: float | None) -> Candidate:
    """Lengthen the history while the norm of R falls by a good share, from the first length that allows the order.

    Raises:
        ValueError: for too few windows, nothing to predict, or an order that no length allows.
    """
    best: Candidate | None = None
    best_norm = np.inf
    for candidate, norm in _lengthened(signals, how, order, threshold):
        if norm > (1.0 - _MINIMUM_GAIN) * best_norm:
            break
        best, best_norm = candidate, norm
    assert best is not None
    return best


def by_norm(signals: Signals, how: Analysis, order: int | None, threshold: float | None) -> Candidate:
    """Lengthen the history until the norm of R is small enough (3.2.3), from the first length that allows the order.

    Small enough is ``threshold``, or what is hardly more than the smallest norm of any length.

    Raises:
        ValueError: for too few windows, nothing to predict, or an order that no length allows.
    """
    m, q = signals.inputs, signals.outputs
    norms: dict[int, float] = {}
    for candidate, norm in _lengthened(signals, how, order, threshold):
        length, windows = candidate.history_length, len(candidate.states)
        # A longer history shrinks R in sample by fitting the noise: undo that as for a regression on all of it.
        norms[length] = norm * windows / max(windows - length * (m + q) - m, 1)
        if norm <= max(threshold or 0.0, RELATIVE_CUTOFF):
            return candidate
    shortest = min(length for length, norm in norms.items() if norm <= (1.0 + _TOLERANCE) * min(norms.values()))
    return _analyse(signals, how, shortest)


def _lengthened(
    signals: Signals, how: Analysis, order: int | None, threshold: float | None
) -> Iterator[tuple[Candidate, float]]:
    """Yield the analysis of each history length that allows the order, and its norm of R, until that is small enough.

    Raises:
        ValueError: for too few windows, nothing to predict, or an order that no length allows.
    """
    _require_windows(signals, how, 1)
    possible = False
    for length in range(1, _longest_history(signals, how) + 1):
        candidate = _analyse(signals, how, length)
        if candidate.rank < (order or 1):
            continue
        possible, norm = True, float(candidate.norm[(order or candidate.best_order) - 1])
        yield candidate, norm
        if norm <= max(threshold or 0.0, RELATIVE_CUTOFF):
            return
    if not possible:
        raise _order_too_large(order or 1, candidate)


def by_regression(signals: Signals, how: Analysis, order: int | None) -> Candidate:
    """Take the history length of the best autoregressive model (Larimore 1990), or the next that allows the order.

    Raises:
        ValueError: for too few windows, nothing to predict, or an order that no length allows.
    """
    _require_windows(signals, how, 1)
    longest = _longest_history(signals, how)
    for length in range(_regression_length(signals, longest), longest + 1):
        candidate = _analyse(signals, how, length)
        if candidate.rank >= (order or 1):
            return candidate
    raise _order_too_large(order or 1, candidate)


def _regression_length(signals: Signals, longest: int) -> int:
    """Return the number of past steps, up to ``longest``, of the smallest AIC where y_t is regressed on them and u_t.

    All lengths are compared on the same rows: those with ``longest`` steps before them.
    """
    usable = [segment for segment in signals.segments if len(segment[0]) > longest]
    # [u_{t-1}, y_{t-1}, u_{t-2}, ...]: the first l steps are the first l (m + q) columns.
    past = np.vstack([lagged(np.hstack(segment), longest)[:-1] for segment in usable])
    actions, observations = (np.vstack([segment[k][longest:] for segment in usable]) for k in (0, 1))
    past, actions, observations = (rows - rows.mean(axis=0) for rows in (past, actions, observations))
    m, q = signals.inputs, signals.outputs
    fit = fit_orders(past, actions, observations).log_determinant[m + q - 1 :: m + q]
    steps = np.arange(1, longest + 1)
    return int(np.argmin(len(past) * fit + 2.0 * q * (steps * (m + q) + m))) + 1


def _analyse(signals: Signals, how: Analysis, history_length: int) -> Candidate:
    raw = stack_windows(signals.segments, history_length)
    past_mean = raw.past.mean(axis=0)
    action_mean, observation_mean = raw.actions.mean(axis=0), raw.observations.mean(axis=0)
    windows = Windows(
        past=raw.past - past_mean,
        next_past=raw.next_past - past_mean,
        future=raw.future - raw.future.mean(axis=0),
        future_actions=raw.future_actions - raw.future_actions.mean(axis=0),
        actions=raw.actions - action_mean,
        observations=raw.observations - observation_mean,
    )
    variates = canonical_variates(windows.past, windows.future, windows.future_actions if how.project else None)
    rank = len(variates.weights)
    if rank == 0:
        raise ValueError(
            "no direction of the past and the future observations varies (beside what future actions "
            "explain, if those are projected out); expected at least one: record data in which the object "
            "moves"
        )
    states = windows.past @ variates.weights.T  # (A.9)
    fit = fit_orders(states, windows.actions, windows.observations)
    log_determinant = fit.log_determinant + 2.0 * np.log(signals.observation_scale).sum()
    n, m, q = np.arange(1, rank + 1), signals.inputs, signals.outputs
    parameters = n * (2 * q + m) + m * q + q * (q + 1) // 2 if how.free else n * (n + m + q) + m * q  # (3.7)
    return Candidate(
        history_length=history_length,
        windows=windows,
        past_mean=past_mean,
        action_mean=action_mean,
        observation_mean=observation_mean,
        variates=variates,
        states=states,
        aic=len(states) * log_determinant + 2.0 * parameters,  # (3.6)
        norm=fit.norm,
    )


def _windows_and_variables(signals: Signals, how: Analysis, history_length: int) -> tuple[int, int]:
    """Count windows, and the variables (past, future, projected actions) that are correlated in them."""
    windows = window_count([len(actions) for actions, _ in signals.segments], history_length)
    return windows, history_length * ((2 if how.project else 1) * signals.inputs + 2 * signals.outputs)


def _require_windows(signals: Signals, how: Analysis, history_length: int) -> None:
    """Refuse as many variables as windows: their correlations would be 1 whatever the data."""
    windows, variables = _windows_and_variables(signals, how, history_length)
    if windows <= variables:
        raise ValueError(
            f"history_length {history_length} with m = {signals.inputs} and q = {signals.outputs} needs more "
            f"than {variables} windows (a segment of T rows holds T - {2 * history_length - 1}), these "
            f"segments hold {windows}; record more data or use a shorter history"
        )


def _longest_history(signals: Signals, how: Analysis) -> int:
    longest = 1
    for length in range(2, MAX_HISTORY_LENGTH + 1):
        windows, variables = _windows_and_variables(signals, how, length)
        if windows < _WINDOWS_PER_VARIABLE * variables:
            break
        longest = length
    return longest


def _order_too_large(order: int, candidate: Candidate) -> ValueError:
    return ValueError(
        f"order {order} is too large: the data with history_length {candidate.history_length} allow at most "
        f"{candidate.rank} (the smallest of l q, l (m + q) and the rank); use a smaller order or a longer "
        "history"
    )
