"""Arms of chapter 4 after as many trials each: what the greedy policy is worth in the hardest world by then."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from analysis.chapter4_compared import common
from analysis.chapter4_runs import Arms, Learned
from analysis.written import Report, Rows, mean_words
from coevo.statistics import mean_interval, probability_of_improvement

__all__ = ["at_equal_trials", "means_of_checks"]

_BASE = "full-speed-n4"  # what others are compared with: all axes, no levels
_KEY = "in-view"  # starts
_PARTS = 4  # of the trials, at whose ends it is told


def at_equal_trials(arms: Arms) -> Report:
    """Return what checks found after each quarter of the trials: greedy success at the highest k, from starts in view.

    Only runs that were checked so far are there: those of ``at_the_top = "stay"`` with ``learning.check_every``.
    Differences are within sets.
    """
    checked = _checked(arms)
    rows: Rows = []
    for name, runs in checked.items():
        limit = min(run.limit for run in runs)
        first = max(int(run.checks["trials"].iloc[0]) for run in runs)
        for trials in (limit * part // _PARTS for part in range(1, _PARTS + 1)):
            if trials < first:
                continue
            row = [name, str(len(runs)), f"{trials:,}", mean_words(_after(runs, trials), most=1.0)]
            mine, base = common([runs, checked.get(_BASE, [])])
            if name != _BASE and mine:
                rates = [_after(one, trials) for one in (mine, base)]
                above = [a - b for a, b in zip(*rates, strict=True)]
                more = "{:.2f} [{:.2f}, {:.2f}]".format(*probability_of_improvement(*rates))
                row += [mean_words(above, least=-1.0, most=1.0), more]
            rows.append(row + [""] * (6 - len(row)))
    header = ["arm", "sets", "trials", "greedy success", f"above {_BASE}", "probability of more"]
    return {"at-equal-trials": (header, rows)} if rows else {}


def _checked(arms: Arms) -> Arms:
    """Return the runs that were checked up to their last trial."""
    found = {name: [run for run in runs if len(run.checks) and _last(run) == run.limit] for name, runs in arms.items()}
    return {name: runs for name, runs in found.items() if runs}


def _last(run: Learned) -> int:
    return int(run.checks["trials"].iloc[-1])


def _after(runs: Sequence[Learned], trials: int) -> list[float]:
    """Return what the last check up to so many trials found in each run."""
    return [float(run.checks[_KEY][run.checks["trials"] <= trials].iloc[-1]) for run in runs]


def means_of_checks(arms: Arms) -> pd.DataFrame:
    """Return what each check found, means over sets.

    Returns:
        Columns ``arm``, ``trial``, ``share``, and ``low``, ``high`` of its interval; without rows, where nothing was
        checked.
    """
    rows = []
    for name, runs in _checked(arms).items():
        for trials in runs[0].checks["trials"]:
            mean, low, high = mean_interval(_after(runs, trials))
            rows.append((name, int(trials), mean, max(low, 0.0), min(high, 1.0)))
    return pd.DataFrame(rows, columns=["arm", "trial", "share", "low", "high"])
