"""Canonical variate analysis on windows of many segments: the algebra behind `behaviors.lpm`.

Everything here expects standardised signals (unit variance), so that one cut-off tells which directions are
degenerate, whatever the units of the features. Rows are windows and columns coordinates; `l` is the history
length, `m` the number of inputs and `q` the number of outputs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = [
    "RELATIVE_CUTOFF",
    "CanonicalVariates",
    "OrderFit",
    "Windows",
    "canonical_variates",
    "fit_orders",
    "lagged",
    "relative_conditioning",
    "stack_windows",
    "window_count",
]

Array = NDArray[np.float64]

RELATIVE_CUTOFF = 1e-10
"""A direction with at most this share of the total variance is degenerate: 1e-5 of the standard deviation,
far above rounding and far below any sensor."""

_SIGN_TIE = 1e-6  # weights this close (relative) to the largest tie; the first of them fixes the sign


@dataclass(frozen=True, eq=False)
class Windows:
    """All windows of one history length; row i of each array belongs to the same time t, (A.3).

    past, next_past: (windows, l (m + q)): p_t and p_{t+1}, newest first.
    future: (windows, l q): f_t = [y_t .. y_{t+l-1}].
    future_actions: (windows, l m): [u_t .. u_{t+l-1}].
    actions: (windows, m): u_t.
    observations: (windows, q): y_t.
    """

    past: Array
    next_past: Array
    future: Array
    future_actions: Array
    actions: Array
    observations: Array


@dataclass(frozen=True, eq=False)
class CanonicalVariates:
    """Canonical directions of the past, and how much each says of the future.

    weights: (rank, l (m + q)): the rows of M that belong to non-degenerate directions, (A.10).
    correlations: (rank,): the diagonal of S_aux, descending, within [0, 1], (A.8).
    """

    weights: Array
    correlations: Array


@dataclass(frozen=True, eq=False)
class OrderFit:
    """How well y_t is predicted one step ahead from the first n states, for n = 1 .. rank.

    log_determinant: (rank,): log|R| on the non-degenerate subspace of y_t, (3.5).
    norm: (rank,): spectral norm of R.
    """

    log_determinant: Array
    norm: Array


def window_count(lengths: Sequence[int], history_length: int) -> int:
    """Number of windows N', the sum of T - 2l + 1 over the segments that hold at least one, (A.4)."""
    return sum(max(0, length - 2 * history_length + 1) for length in lengths)


def lagged(signal: Array, length: int) -> Array:
    """The blocks [s_{t-1} .. s_{t-length}] of one segment for t = length .. T, newest first.

    signal: (T, d) with T >= length; the result: (T - length + 1, length d).
    """
    return (
        sliding_window_view(signal, length, axis=0)[:, :, ::-1].transpose(0, 2, 1).reshape(-1, length * signal.shape[1])
    )


def stack_windows(segments: Sequence[tuple[Array, Array]], history_length: int) -> Windows:
    """The windows of all segments that hold any (T >= 2l), none of them across two segments, (A.3).

    segments: (actions (T, m), observations (T, q)) each; at least one of them holds a window.
    """
    size = history_length
    columns: tuple[list[Array], ...] = ([], [], [], [], [], [])
    for actions, observations in segments:
        count = len(actions) - 2 * size + 1
        if count < 1:
            continue
        past = np.hstack([lagged(actions, size), lagged(observations, size)])
        rows = (
            past[:count],
            past[1 : count + 1],
            _leading(observations[size:], size),
            _leading(actions[size:], size),
            actions[size : size + count],
            observations[size : size + count],
        )
        for column, row in zip(columns, rows, strict=True):
            column.append(row)
    return Windows(*(np.concatenate(column) for column in columns))


def relative_conditioning(rows: Array) -> float:
    """Smallest over largest eigenvalue of the covariance of mean-free rows (windows, d); 0 for constants."""
    singular = np.linalg.svd(rows, compute_uv=False)
    if len(singular) < rows.shape[1] or singular[0] <= _limit(*rows.shape):
        return 0.0
    return float((singular[-1] / singular[0]) ** 2)


def canonical_variates(past: Array, future: Array, given: Array | None = None) -> CanonicalVariates:
    """Canonical variate analysis of `past` and `future`, (A.7) to (A.10).

    past: (windows, a), future: (windows, b), given: (windows, c) or None; all mean-free. A `given` is first
    regressed out of both (the CVA weighting of Van Overschee and De Moor 1996); the weights are then
    orthonormal in the covariance of what is left of the past.

    Any square root of the inverse covariance serves in (A.8) and (A.10), the rotation makes up for it. The
    singular value decomposition of the windows gives one without squaring their condition number.
    """
    windows = len(past)
    if given is None:
        past, future = _compressed(past, future)
    else:
        past, future, given = _compressed(past, future, given)
        basis = _principal(given, windows).basis
        past = past - basis @ (basis.T @ past)
        future = future - basis @ (basis.T @ future)
    p, f = _principal(past, windows), _principal(future, windows)
    rotation, correlations, _ = np.linalg.svd(p.basis.T @ f.basis, full_matrices=False)  # (A.8)
    whitening = np.sqrt(windows) / p.singular[:, None] * p.directions
    return CanonicalVariates(
        weights=_with_fixed_signs(rotation.T @ whitening),  # (A.10)
        correlations=np.clip(correlations, 0.0, 1.0),
    )


def fit_orders(states: Array, actions: Array, observations: Array) -> OrderFit:
    """One-step residuals of y_t = C x_t + D u_t + eps_t for every order at once, (3.5) and (A.11).

    states: (windows, rank), actions: (windows, m), observations: (windows, q); all mean-free.

    The state of order n is the first n columns, so that one QR decomposition, inputs first, serves all
    orders. Eigenvalues of R are lifted to `RELATIVE_CUTOFF` of the variance of y_t: a direction that can be
    predicted exactly would otherwise give log|R| = -inf, or the logarithm of rounding noise.
    """
    windows = len(states)
    actions, states, observations = _compressed(actions, states, observations)
    inputs, y = _principal(actions, windows).basis, _principal(observations, windows)
    target = y.basis - inputs @ (inputs.T @ y.basis)
    basis, triangle = np.linalg.qr(states - inputs @ (inputs.T @ states))
    # A state that inputs and earlier states determine leaves a column of rounding noise: it explains nothing.
    adds = np.abs(np.diag(triangle)) > np.sqrt(RELATIVE_CUTOFF) * np.linalg.norm(states, axis=0)
    explained = (basis.T @ target) * adds[:, None]
    residual = target.T @ target - np.cumsum(explained[:, :, None] * explained[:, None, :], axis=0)
    share = np.maximum(np.linalg.eigvalsh(residual), RELATIVE_CUTOFF)  # (rank, r): of the variance of y_t
    deviations = y.singular / np.sqrt(windows)
    loading = deviations[:, None] * y.directions
    norm = np.linalg.eigvalsh(loading.T @ residual @ loading)[:, -1]
    return OrderFit(np.log(share).sum(axis=1) + 2.0 * np.log(deviations).sum(), np.maximum(norm, 0.0))


def _compressed(*blocks: Array) -> list[Array]:
    """Return the blocks in a basis with at most as many rows as columns; all inner products are the same."""
    triangle = np.linalg.qr(np.hstack(blocks), mode="r")
    return np.split(triangle, np.cumsum([block.shape[1] for block in blocks])[:-1], axis=1)


@dataclass(frozen=True, eq=False)
class _Principal:
    """The non-degenerate part of mean-free rows, basis diag(singular) directions."""

    basis: Array
    singular: Array
    directions: Array


def _principal(rows: Array, windows: int) -> _Principal:
    basis, singular, directions = np.linalg.svd(rows, full_matrices=False)
    kept = singular > _limit(windows, rows.shape[1])
    return _Principal(basis[:, kept], singular[kept], directions[kept])


def _limit(windows: int, variables: int) -> float:
    """Singular values up to here are degenerate: columns had unit variance before any regression."""
    return float(np.sqrt(RELATIVE_CUTOFF * windows * variables))


def _leading(signal: Array, length: int) -> Array:
    """The blocks [s_t .. s_{t+length-1}], oldest first, for every t at which the block is complete."""
    return sliding_window_view(signal, length, axis=0).transpose(0, 2, 1).reshape(-1, length * signal.shape[1])


def _with_fixed_signs(weights: Array) -> Array:
    """Rows with their (first) largest absolute entry positive, so that no LAPACK build chooses the sign."""
    size = np.abs(weights)
    leading = np.argmax(size >= (1.0 - _SIGN_TIE) * size.max(axis=1, keepdims=True, initial=0.0), axis=1)
    return np.where(np.take_along_axis(weights, leading[:, None], axis=1) < 0.0, -weights, weights)
