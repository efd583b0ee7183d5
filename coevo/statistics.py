"""How sure a number is: 95 % intervals, by scipy, which is loaded when one is needed.

Nothing here draws anew: the same values give the same interval, in every process and whatever was asked before.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "ESTIMATORS",
    "LEVEL",
    "bootstrap_interval",
    "estimate",
    "mean_interval",
    "median_interval",
    "paired_difference",
    "probability_of_improvement",
    "share_interval",
]

LEVEL = 0.95
ESTIMATORS = ("mean", "iqm")
_TRIM = {"mean": 0.0, "iqm": 0.25}  # of each end
_FEWEST = 8  # of which resamples can say something; below that Student's t does
_RESAMPLES = 4000
_AT_ONCE = 512  # columns whose resamples are held in memory together


def mean_interval(values: Sequence[float] | NDArray[np.float64]) -> tuple[float, float, float]:
    """Return the mean of independent values and its interval by Student's t (mean, low, high).

    Args:
        values: (n,), at least one; of one value, or of equal ones, the interval is the mean itself.

    Example:
        >>> from coevo.statistics import mean_interval
        >>> print("{:.2f} [{:.2f}, {:.2f}]".format(*mean_interval([0.1, 0.2, 0.3])))
        0.20 [-0.05, 0.45]
    """
    data = np.asarray(values, np.float64)
    mean = float(data.mean())
    if len(data) < 2 or float(data.std()) == 0.0:
        return mean, mean, mean
    from scipy import stats

    error = float(data.std(ddof=1)) / float(np.sqrt(len(data)))
    half = float(stats.t.ppf(0.5 + 0.5 * LEVEL, len(data) - 1)) * error
    return mean, mean - half, mean + half


def median_interval(values: Sequence[float] | NDArray[np.float64]) -> tuple[float, float, float]:
    """Return the median of independent values and its interval by order statistics (median, low, high).

    It assumes nothing of how values are distributed, so that infinite ones may stand for runs that never came to an
    end. The interval holds the median of the population in at least 95 of 100 cases; below six values none of them can
    bound it, and it is (-inf, inf).

    Args:
        values: (n,), at least one; no NaN.

    Example:
        >>> import math
        >>> from coevo.statistics import median_interval
        >>> median_interval([3.0, 5.0, 4.0, 6.0, 9.0, 8.0, 7.0, 2.0, math.inf, math.inf])
        (6.5, 3.0, inf)
    """
    from scipy import stats

    data = np.sort(np.asarray(values, np.float64))
    place = int(stats.binom.ppf(0.5 - 0.5 * LEVEL, len(data), 0.5))  # from each end, counted from 1
    middle = float(np.median(data))
    if place < 1:
        return middle, -np.inf, np.inf
    return middle, float(data[place - 1]), float(data[-place])


def share_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the interval of a share (Wilson 1927), which is sound near 0 and 1 too (low, high).

    Args:
        successes, trials: counts; 0 <= successes <= trials, and at least one trial.

    Example:
        >>> from coevo.statistics import share_interval
        >>> print("[{:.3f}, {:.3f}]".format(*share_interval(0, 10)))
        [0.000, 0.278]
    """
    from scipy import stats

    interval = stats.binomtest(successes, trials).proportion_ci(LEVEL, method="wilson")
    return float(interval.low), float(interval.high)


def paired_difference(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Return by how much one share is above another of the same trials, with its interval (difference, low, high).

    The interval is sound where the two hardly differ, or not at all (A. Agresti and Y. Min, "Simple improved confidence
    intervals for comparing matched proportions", Statistics in Medicine 24, 2005).

    Args:
        first, second: (trials,), whether each trial was a success.

    Example:
        >>> import numpy as np
        >>> from coevo.statistics import paired_difference
        >>> always, never = np.ones(50, bool), np.zeros(50, bool)
        >>> print("{:.2f} [{:.2f}, {:.2f}]".format(*paired_difference(always, never)))
        1.00 [0.90, 1.00]
        >>> print("{:.2f} [{:.2f}, {:.2f}]".format(*paired_difference(never, never)))
        0.00 [-0.04, 0.04]
    """
    from scipy import stats

    trials = len(first)
    more, fewer = int((first & ~second).sum()), int((second & ~first).sum())
    centre = (more - fewer) / (trials + 2)
    error = float(np.sqrt(more + fewer + 1 - (more - fewer) ** 2 / (trials + 2))) / (trials + 2)
    half = float(stats.norm.ppf(0.5 + 0.5 * LEVEL)) * error
    return (more - fewer) / trials, max(-1.0, centre - half), min(1.0, centre + half)


def estimate(values: ArrayLike, estimator: str = "mean") -> NDArray[np.float64]:
    """Return the mean over runs, or the mean of their middle half (IQM), which one lucky run does not move.

    Args:
        values: (runs, ...), finite.
        estimator: one of ``ESTIMATORS``. A quarter of the runs, rounded down, is left out at each end of an IQM
            (Agarwal et al. 2021, "Deep reinforcement learning at the edge of the statistical precipice").

    Returns:
        (...).

    Raises:
        ValueError: there is no such estimator, or no run.

    Example:
        >>> from coevo.statistics import estimate
        >>> float(estimate([1.0, 2.0, 3.0, 100.0], "iqm"))
        2.5
    """
    data = _checked(values, estimator)
    from scipy import stats

    # Rounding may put the mean of equal values beside them.
    return np.clip(np.asarray(stats.trim_mean(data, _TRIM[estimator], axis=0)), data.min(axis=0), data.max(axis=0))


def bootstrap_interval(
    values: ArrayLike, estimator: str = "mean"
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return an estimate over runs and its interval (value, low, high), of many columns at once.

    A percentile bootstrap over runs with wider percentiles, as few runs need it, and Student's t below eight runs:
    docs/decisions/0010-intervals-over-runs.md says why, and 'coevo reproduce coverage' how often it holds the truth.
    The resamples depend on the number of runs alone. The interval changes sign, unit and origin with the values, and
    does not depend on the order of runs. From eight runs on it lies within the values.

    Args:
        values: (runs, ...), finite; of one run, or of equal ones, the interval is the value itself.
        estimator: one of ``ESTIMATORS``.

    Returns:
        Three arrays (...).

    Raises:
        ValueError: there is no such estimator, or no run.

    Example:
        >>> from coevo.statistics import bootstrap_interval
        >>> value, low, high = bootstrap_interval([3.0, 4.0, 4.0, 5.0, 5.0, 6.0, 7.0, 7.0, 8.0, 40.0], "iqm")
        >>> print(f"{value:.2f} [{low:.2f}, {high:.2f}]")
        5.67 [4.33, 12.50]
    """
    data = _checked(values, estimator)
    runs = len(data)
    value = estimate(data, estimator)
    if runs == 1:
        return value, value, value
    if runs < _FEWEST:
        from scipy import stats

        half = stats.t.ppf(0.5 + 0.5 * LEVEL, runs - 1) * data.std(axis=0, ddof=1) / np.sqrt(runs)
        half = np.where(np.ptp(data, axis=0) == 0.0, 0.0, half)
        return value, value - half, value + half
    ordered = np.sort(data.reshape(runs, -1), axis=0)
    weights = _resamples(runs, estimator)
    below = round(_tail(runs, estimator) * (len(weights) - 1))
    ends = [below, len(weights) - 1 - below]
    found = np.empty((2, ordered.shape[1]))
    for first in range(0, ordered.shape[1], _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        resampled = ordered[:, part].T @ weights.T
        resampled.partition(ends, axis=1)
        found[:, part] = resampled[:, ends].T
    low, high = np.clip(found, ordered[0], ordered[-1]).reshape(2, *value.shape)
    return value, np.minimum(low, value), np.maximum(high, value)


def probability_of_improvement(first: ArrayLike, second: ArrayLike) -> tuple[float, float, float]:
    """Return the probability that a run of one group is above one of another, and its interval (share, low, high).

    It is P(X > Y) + P(X = Y) / 2, as all pairs of runs say, with the interval of Newcombe (2006, "Confidence intervals
    for an effect size measure based on the Mann-Whitney statistic", part 2, method 5), which is sound near 0 and 1 and
    for a few runs too. Where smaller is better, hand the groups over the other way round.

    Args:
        first, second: (runs,) each, finite.

    Raises:
        ValueError: a group has no run.

    Example:
        >>> from coevo.statistics import probability_of_improvement
        >>> print("{:.2f} [{:.2f}, {:.2f}]".format(*probability_of_improvement([4, 5, 6], [1, 2, 3])))
        1.00 [0.50, 1.00]
    """
    x, y = np.asarray(first, np.float64).ravel(), np.asarray(second, np.float64).ravel()
    if not len(x) or not len(y):
        raise ValueError("expected at least one run in each group")
    share = float((0.5 * (np.sign(x[:, None] - y) + 1.0)).mean())
    return share, 1.0 - _newcombe_high(1.0 - share, len(x), len(y)), _newcombe_high(share, len(x), len(y))


def _newcombe_high(share: float, first: int, second: int) -> float:
    """Return the greatest probability whose own deviation, times the normal quantile, reaches down to a share."""
    from scipy import optimize, special

    if share >= 1.0:
        return 1.0
    z2, more = special.ndtri(0.5 + 0.5 * LEVEL) ** 2, 0.5 * (first + second) - 1.0

    def beyond(p: float) -> float:
        spread = 1.0 + more * ((1.0 - p) / (2.0 - p) + p / (1.0 + p))
        return float((p - share) ** 2 - z2 * p * (1.0 - p) * spread / (first * second))

    return float(optimize.brentq(beyond, max(share, 1e-9), 1.0, xtol=1e-12))


def _checked(values: ArrayLike, estimator: str) -> NDArray[np.float64]:
    if estimator not in ESTIMATORS:
        raise ValueError(f"expected an estimator of {', '.join(ESTIMATORS)}, got {estimator!r}")
    data = np.asarray(values, np.float64)
    if data.ndim == 0 or not len(data):
        raise ValueError(f"expected values of at least one run, (runs, ...), got shape {data.shape}")
    return data


@cache
def _resamples(runs: int, estimator: str) -> NDArray[np.float64]:
    """Return the weights of the runs, from lowest to highest, in the estimate of each resample, (resamples, runs).

    With them one product gives all estimates: neither does the order of runs matter, nor need resamples be sorted.
    Each resample comes with its mirror image, so that intervals change sign with the values.
    """
    drawn = np.random.default_rng(runs).integers(0, runs, (_RESAMPLES // 2, runs))
    ranks = np.sort(np.concatenate([drawn, runs - 1 - drawn]), axis=1)
    cut = int(_TRIM[estimator] * runs)
    kept = ranks[:, cut : runs - cut]
    weights: NDArray[np.float64] = (kept[:, :, None] == np.arange(runs)).mean(axis=1)
    return weights


def _tail(runs: int, estimator: str) -> float:
    """Return the share of resamples below the interval.

    Resamples vary less than their source, by (n - 1) / n, which this mends; for a mean it also puts Student's quantile
    for the normal one (Hesterberg 2015, "What teachers should know about the bootstrap"). An IQM does not need that.
    """
    from scipy import special, stats

    half = 0.5 + 0.5 * LEVEL
    quantile = stats.t.ppf(half, runs - 1) if estimator == "mean" else special.ndtri(half)
    return float(special.ndtr(-np.sqrt(runs / (runs - 1)) * quantile))
