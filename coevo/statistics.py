"""How sure a number is: 95 % confidence intervals, by scipy, which is loaded when one is needed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEVEL", "mean_interval", "paired_difference", "share_interval"]

LEVEL = 0.95


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
