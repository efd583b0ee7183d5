"""Figs. 3.8 to 3.10 of the dissertation: for each a tidy table, and a chart of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.chapter3_sets import KEYS, Method, successes
from analysis.charts import line_chart
from coevo.statistics import mean_interval

if TYPE_CHECKING:
    import altair as alt

__all__ = ["contributions", "errors_of_a_trial", "figures", "learning", "periods_of"]

_BLOCKS = 100  # of Fig. 3.10, over all trials in simulation
_STEPS_PER_S = 30.0


def learning(methods: Sequence[Method]) -> pd.DataFrame:
    """Return Fig. 3.10: shares of successes in each block of trials in simulation.

    Returns:
        Columns ``method``, ``what``, ``trial`` (the last of the block), ``share`` (mean over sets), ``low``, ``high``.
    """
    parts = []
    for method in methods:
        for what in KEYS:
            shares = []
            for periods, trials in zip(method.periods, method.trials, strict=True):
                success = successes(trials[~np.isin(periods, ["E", "F"])])[what].astype(np.float64)
                blocks = np.array_split(success, min(_BLOCKS, len(success)))
                shares.append([float(block.mean()) for block in blocks])
                ends = np.cumsum([len(block) for block in blocks])
            band = np.array([mean_interval(column) for column in np.array(shares).T])
            low, high = np.clip(band[:, 1:], 0.0, 1.0).T
            columns = {"trial": ends, "share": band[:, 0], "low": low, "high": high}
            parts.append(pd.DataFrame({"method": method.name, "what": what, **columns}))
    return pd.concat(parts, ignore_index=True)


def contributions(methods: Sequence[Method]) -> pd.DataFrame:
    """Return Fig. 3.9: the contributions of each object's newest model, means over sets.

    Returns:
        Columns ``method``, ``robot``, ``object``, ``element`` (of the state, from 1), ``mu``.
    """
    rows: list[tuple[str, str, str, int, float]] = []
    for method in methods:
        found: dict[tuple[str, str], list[list[float]]] = {}
        for summary in method.summaries:
            newest = {(row["robot"], row["object"]): row for row in summary["models"] if "contribution" in row}
            for key, row in newest.items():
                found.setdefault(key, []).append(row["contribution"])
        for (robot, kind), lists in found.items():
            most = min(len(one) for one in lists)
            mean = np.mean([one[:most] for one in lists], axis=0)
            rows += [(method.name, robot, kind, element + 1, float(mu)) for element, mu in enumerate(mean)]
    return pd.DataFrame(rows, columns=["method", "robot", "object", "element", "mu"])


def errors_of_a_trial(methods: Sequence[Method]) -> pd.DataFrame:
    """Return Fig. 3.8: prediction errors over one trial of the first set, in the other world if there is one.

    Returns:
        Columns ``method``, ``robot``, ``object``, ``time_s``, ``error_px``: NaN where the object goes out of view.
    """
    parts = []
    for method in methods:
        traces = method.traces[0]
        for robot in ("passer", "shooter"):
            mine = [row for row in traces if row["robot"] == robot]
            where = "transfer" if any(row["where"] == "transfer" for row in mine) else "simulation"
            for kind in dict.fromkeys(row["object"] for row in mine if row["where"] == where):
                chosen = [row for row in mine if row["object"] == kind and row["where"] == where]
                steps, errors = (np.array([float(row[key]) for row in chosen]) for key in ("step", "error_px"))
                gone = np.flatnonzero(np.diff(steps) > 1.0) + 1
                columns = {
                    "time_s": np.insert(steps, gone, steps[gone]) / _STEPS_PER_S,
                    "error_px": np.insert(errors, gone, np.nan),
                }
                parts.append(pd.DataFrame({"method": method.name, "robot": robot, "object": kind, **columns}))
    empty = pd.DataFrame(columns=["method", "robot", "object", "time_s", "error_px"])
    return pd.concat(parts, ignore_index=True) if parts else empty


def periods_of(methods: Sequence[Method]) -> pd.DataFrame:
    """Return where each period in simulation begins, of the first method that has several.

    Returns:
        Columns ``trial``, ``period``.
    """
    tables = [_begin(method.periods[0][~np.isin(method.periods[0], ["E", "F"])]) for method in methods]
    return next((table for table in tables if len(table) > 1), tables[0])


def _begin(periods: NDArray[np.str_]) -> pd.DataFrame:
    starts = [0, *(np.flatnonzero(periods[1:] != periods[:-1]) + 1).tolist()] if len(periods) else []
    return pd.DataFrame({"trial": starts, "period": [f"period {periods[start]}" for start in starts]})


def figures(methods: Sequence[Method]) -> dict[str, alt.LayerChart]:
    """Return the charts by the names of their files."""
    found = {}
    curves, marks = learning(methods), periods_of(methods)
    for what in KEYS:
        titles = (f"Fig. 3.10: {what}, share of the trials of a block while learning", "trial", what)
        part = curves[curves["what"] == what].drop(columns="what")
        found[f"figure-3-10-{what}.svg"] = line_chart(
            part, x="trial", y="share", by="method", titles=titles, marks=marks
        )
    for (name, robot), part in contributions(methods).groupby(["method", "robot"], sort=False):
        titles = (f"Fig. 3.9: contributions, {robot}, {name}", "element of the state", "mu")
        found[f"figure-3-9-{name}-{robot}.svg"] = line_chart(part, x="element", y="mu", by="object", titles=titles)
    for (name, robot), part in errors_of_a_trial(methods).groupby(["method", "robot"], sort=False):
        titles = (f"Fig. 3.8: prediction error of the centre's y, {robot}, {name}", "time [s]", "error [px]")
        found[f"figure-3-8-{name}-{robot}.svg"] = line_chart(part, x="time_s", y="error_px", by="object", titles=titles)
    return found
