"""How many trials arms of chapter 4 need, and by what factor one needs more than another.

A run that never met the criteria on the highest level is not left out: what it needed lies between what it had and
infinity, and whatever is said of it holds for all of that. So a ratio lies between two as well. Medians need no more:
an interval of the median by order statistics begins with the lower ends and closes with the upper ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.chapter4_runs import Learned
from coevo.statistics import mean_interval, median_interval, probability_of_improvement

__all__ = ["Between", "between_words", "common", "faster", "geometric", "needs", "of_medians", "ratios"]

Between = tuple[float, float, float, float]
"""The least and the most that a median may be, and its interval."""


def needs(runs: Sequence[Learned], what: str = "trials") -> NDArray[np.float64]:
    """Return the least and the most that each run needed, (runs, 2); see ``Learned.needed``."""
    return np.array([run.needed(what) for run in runs], np.float64).reshape(-1, 2)


def common(groups: Sequence[Sequence[Learned]]) -> list[list[Learned]]:
    """Return groups of runs with the seeds that all of them have, in one order."""
    seeds = sorted(set.intersection(*({run.seed for run in runs} for runs in groups)))
    return [[next(run for run in runs if run.seed == seed) for seed in seeds] for runs in groups]


def ratios(powers: Mapping[str, float], arms: Mapping[str, Sequence[Learned]], what: str) -> NDArray[np.float64]:
    """Return a product of powers of what arms needed in each set, as the least and the most it may be, (sets, 2).

    Args:
        powers: by the name of an arm; ``{"a": 1, "b": -1}`` is by what factor a needed more than b.
        arms: runs by the name of an arm.
        what: is compared; see ``Learned.needed``.
    """
    groups = common([arms[name] for name in powers])
    found = np.zeros((len(groups[0]), 2))
    for power, runs in zip(powers.values(), groups, strict=True):
        needed = np.maximum(needs(runs, what), 1.0)  # net of the floor there may be nothing left
        found += power * np.log(needed[:, :: 1 if power > 0 else -1])
    return np.exp(found)


def of_medians(values: NDArray[np.float64]) -> Between:
    """Return the median of what lies between two values each, and its interval by order statistics.

    Args:
        values: (n, 2), the least and the most.

    Example:
        >>> import numpy as np
        >>> from analysis.chapter4_compared import of_medians
        >>> of_medians(np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0], [4.0, np.inf], [5.0, np.inf], [6.0, np.inf]]))
        (3.5, inf, 1.0, inf)
    """
    least, low, _ = median_interval(values[:, 0])
    most, _, high = median_interval(values[:, 1])
    return least, most, max(low, 0.0), high


def geometric(values: NDArray[np.float64]) -> tuple[float, float, float] | None:
    """Return the geometric mean of ratios and its interval by Student's t; None where one of them is not known.

    Args:
        values: (n, 2), the least and the most.
    """
    if not len(values) or (values[:, 0] != values[:, 1]).any():
        return None
    mean, low, high = np.exp(mean_interval(np.log(values[:, 0])))
    return float(mean), float(low), float(high)


def faster(first: Sequence[Learned], second: Sequence[Learned], what: str = "trials") -> tuple[float, float, float]:
    """Return the probability that a run of one arm needs less than one of another, and its interval.

    Runs that never met the criteria count as slower than all that did, and as equal among themselves.
    """
    most = 1.0 + max(run.needed(what)[0] for run in [*first, *second])
    ends = [np.where(np.isinf(needs(runs, what)[:, 1]), most, needs(runs, what)[:, 0]) for runs in (second, first)]
    return probability_of_improvement(*ends)


def between_words(value: Between, digits: int = 2) -> str:
    """Return a median with its interval in words; an open end is one that runs without an end leave open."""
    least, most, low, high = value
    said = f"{least:,.{digits}f}"
    if least != most:
        upper = f"{most:,.{digits}f}"
        said = f"{said} to {upper}" if least > 0.0 and most < np.inf else f"< {upper}" if most < np.inf else f"> {said}"
    if (least, most) == (0.0, np.inf):
        said = "?"
    if (low, high) == (0.0, np.inf):
        return said
    return f"{said} [{low:,.{digits}f}, {f'{high:,.{digits}f}' if np.isfinite(high) else '...'}]"
