"""Sets of chapter 3 as arrays: what tables and figures are made from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coevo.study import read_sets

__all__ = ["KEYS", "Method", "read_methods", "successes"]

KEYS = ("passing", "shooting", "collisions")
_SUCCESS, _COLLISION = 1, 3  # how a trial ends, in trials.csv: a goal of the shooter, a collision


@dataclass(frozen=True)
class Method:
    """The finished sets of one method: for each its summary, rows of trials, of error traces, and of checks.

    trials: (trials, 3) int64 each: how it ended, passes, steps. periods: (trials,) each, the name of the period.
    """

    name: str
    summaries: list[dict[str, Any]]
    periods: list[NDArray[np.str_]]
    trials: list[NDArray[np.int64]]
    traces: list[list[dict[str, str]]]
    checks: list[list[dict[str, str]]]


def read_methods(folder: Path) -> list[Method]:
    """Read the sets of every method in a folder.

    Raises:
        InputError: there is none.
    """
    methods = []
    for name, sets in read_sets(folder).items():
        trials = [one.rows("trials.csv") for one in sets]
        methods.append(
            Method(
                name,
                [one.summary for one in sets],
                [np.array([row["period"] for row in rows]) for rows in trials],
                [np.array([[int(row[k]) for k in ("end", "passes", "steps")] for row in rows]) for rows in trials],
                [one.rows("errors.csv") for one in sets],
                [one.rows("checks.csv") for one in sets],
            )
        )
    return methods


def successes(trials: NDArray[np.int64]) -> dict[str, NDArray[np.bool_]]:
    """Return whether each trial had a pass, ended with the shooter's goal, or with a collision, (trials,) each."""
    return {"passing": trials[:, 1] > 0, "shooting": trials[:, 0] == _SUCCESS, "collisions": trials[:, 0] == _COLLISION}
