"""How sure a number is: 95 % confidence intervals, by scipy, which is loaded when one is needed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEVEL", "mean_interval", "share_interval"]

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
