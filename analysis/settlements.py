"""How games between the last champions of several runs end: the patterns of ``coevo.settlement``, by runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from coevo.settlement import PATTERNS, Settled
from coevo.statistics import bootstrap_interval, share_interval

__all__ = ["RATIO", "over_runs"]

RATIO = "pass and shoot : interception"


def over_runs(settled: Sequence[Settled]) -> pd.DataFrame:
    """Return what runs of one kind settled in; the unit is a run.

    Args:
        settled: of each run, at least one.

    Returns:
        A row a pattern, and one (``RATIO``) for the ratio of 6.4.3: ``pattern``, ``runs`` (in
        which it can be said), ``share``, ``low``, ``high`` (mean share of games with its interval over runs), ``most``
        (number of runs in which it is the most frequent of the decided), ``most_low``, ``most_high`` (the interval of
        their share; of the ratio: among runs of which most games end by either).
    """
    rows: list[tuple[object, ...]] = []
    most = [one.most for one in settled]
    for name in PATTERNS:
        count = most.count(name)
        shares = _over_runs([one.share(name) for one in settled])
        rows.append((name, len(settled), *shares, count, *share_interval(count, len(settled))))
    ratios = [one.ratio() for one in settled if np.isfinite(one.ratio())]
    passed, taken = most.count("pass and shoot"), most.count("interception")
    interval = share_interval(passed, passed + taken) if passed + taken else (np.nan, np.nan)
    rows.append((RATIO, len(ratios), *_over_runs(ratios), passed, *interval))
    return pd.DataFrame(rows, columns=["pattern", "runs", "share", "low", "high", "most", "most_low", "most_high"])


def _over_runs(shares: Sequence[float]) -> list[float]:
    """Return the mean of shares and its interval, cut at 0 and 1; NaN if there are none."""
    if not shares:
        return [float("nan")] * 3
    return [float(value) for value in np.clip(bootstrap_interval(shares), 0.0, 1.0)]
