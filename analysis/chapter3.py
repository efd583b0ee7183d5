"""Tables 3.2 and 3.3 and Figs. 3.8 to 3.10 of the dissertation, from sets that 'coevo reproduce chapter3' has run.

Every method's folder is read; the tables are printed and written as CSV, the figures as SVG and CSV, into ``report``.
Intervals are 95 % ones by Student's t over sets; with one set there is none.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from analysis._figure import Line, line_chart
from coevo.console import output_options, show, table
from coevo.errors import InputError
from coevo.statistics import mean_interval
from coevo.study import read_sets

__all__ = ["Method", "read_methods", "report"]

_SUCCESS, _COLLISION = 1, 3  # how a trial ends, in trials.csv: a goal of the shooter, a collision
_BLOCKS = 100  # of Fig. 3.10, over all trials in simulation
_PROPOSED = "schedule"  # the method that others are compared with
_KEYS = ("passing", "shooting", "collisions")
_TRUTH = {  # Table 3.2: orders and histories, simulation, simulation, real
    ("shooter", "opponent_goal"): ("2 2 3", "1 1 1"),
    ("shooter", "ball"): ("4 4 4", "2 2 4"),
    ("shooter", "mate"): ("6 6 4", "3 3 5"),
    ("passer", "opponent_goal"): ("3", "2"),
    ("passer", "ball"): ("4 4 4", "2 2 4"),
    ("passer", "mate"): ("5 5 4", "3 3 5"),
}
_REAL = {"E": {"shooting": "57/100", "passing": "30/100", "collisions": "25/100"}}
_REAL["F"] = {"shooting": "32/50", "passing": "22/50", "collisions": "6/50"}
Rows = list[list[str]]
Report = dict[str, tuple[list[str], Rows]]  # name of a table: its header and rows


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


def _interval(values: Sequence[float], *, least: float = 0.0, most: float = np.inf) -> str:
    """Return the mean over sets with its interval, cut at what it can be; nothing of no set."""
    if not len(values):
        return ""
    mean, low, high = mean_interval(values)
    return f"{mean:.3f}" + (f" [{max(least, low):.3f}, {min(most, high):.3f}]" if len(values) > 1 else "")


def _successes(trials: NDArray[np.int64]) -> dict[str, NDArray[np.bool_]]:
    return {"passing": trials[:, 1] > 0, "shooting": trials[:, 0] == _SUCCESS, "collisions": trials[:, 0] == _COLLISION}


def _grouped(method: Method, part: str, keys: Sequence[str], value: str) -> dict[tuple[str, ...], list[float]]:
    """Return a number of each set's rows by what identifies the row."""
    found: dict[tuple[str, ...], list[float]] = {}
    for summary in method.summaries:
        for row in summary[part]:
            if value in row:
                found.setdefault(tuple(str(row[key]) for key in keys), []).append(float(row[value]))
    return found


def orders(methods: Sequence[Method]) -> Report:
    """Return Table 3.2: orders and histories, those used and those that 3.2.3 and (3.6) choose (medians over sets)."""
    header = ["method", "observer", "target", "period", "order", "history", "chosen order", "chosen history", "kept"]
    rows: Rows = []
    for method in methods:
        keys = ("robot", "object", "period")
        columns = [
            _grouped(method, "models", keys, name)
            for name in ("order", "history_length", "chosen_order", "chosen_history_length")
        ]
        kept = _grouped(method, "models", keys, "kept")
        for key in columns[0]:
            numbers = [f"{np.median(column[key]):g}" if key in column else "" for column in columns]
            rows.append([method.name, key[0], key[1], key[2], *numbers, f"{sum(kept[key]):g} of {len(kept[key])}"])
    truth = [["dissertation", *key, "sim sim real", *numbers, "", "", ""] for key, numbers in _TRUTH.items()]
    return {"table-3-2": (header, rows + truth)}


def other_world(methods: Sequence[Method]) -> Report:
    """Return Table 3.3: successes and collisions in the other world."""
    rows: Rows = []
    for method in methods:
        for period in ("E", "F"):
            of_period = [t[p == period] for p, t in zip(method.periods, method.trials, strict=True)]
            if len(of_period[0]):
                shares = [{key: float(v.mean()) for key, v in _successes(t).items()} for t in of_period]
                found = [_interval([one[key] for one in shares], most=1.0) for key in _KEYS]
                rows.append([method.name, period, f"{len(of_period[0])}", *found])
        told = [one["periods"] for one in method.summaries if {"E", "F"} <= set(one.get("periods", {}))]
        if told:
            gains = [_interval([one["F"][key] - one["E"][key] for one in told], least=-1.0, most=1.0) for key in _KEYS]
            rows.append([method.name, "F - E", "", *gains])
    real = [["dissertation", p, "", *(told[key] for key in _KEYS)] for p, told in _REAL.items()]
    return {"table-3-3": (["method", "period", "trials a set", *_KEYS], rows + real)}


def prediction(methods: Sequence[Method]) -> Report:
    """Return the summary of Fig. 3.8, and what the exchange of models between the robots does."""
    errors: Rows = []
    exchanged: Rows = []
    for method in methods:
        keys = ("where", "robot", "object")
        relative = _grouped(method, "prediction_errors", (*keys, "orders"), "relative")
        for key, values in _grouped(method, "prediction_errors", (*keys, "orders"), "rms_px").items():
            errors.append([method.name, *key, _interval(values), _interval(relative[key])])
        for key, values in _grouped(method, "exchange", keys, "error_ratio").items():
            exchanged.append([method.name, *key, _interval(values)])
    who = ["method", "world", "observer", "target"]
    return {
        "figure-3-8": ([*who, "orders", "error of y [px]", "error / deviation of y"], errors),
        "exchange": ([*who, "error with the other's model / own"], exchanged),
    }


def afterwards(methods: Sequence[Method]) -> Report:
    """Return what both robots do greedily after the last period in simulation."""
    rows: Rows = []
    for method in methods:
        found = [summary["after"] for summary in method.summaries]
        parts = {"either": found}
        for robot in ("passer", "shooter"):
            parts[robot] = [one["nearer"][robot] for one in found if robot in one["nearer"]]
        for nearer, measured in parts.items():
            shares = [_interval([one[key] for one in measured], most=1.0) for key in _KEYS]
            rows.append([method.name, str(len(measured)), nearer, *shares])
    return {"afterwards": (["method", "sets", "nearer to the ball", *_KEYS], rows)}


def differences(methods: Sequence[Method]) -> Report:
    """Return by how much the proposed method is above each other one after the last period.

    Sets of one number have the same starts in all methods, so differences are taken within them.
    """
    mine = {one["set"]: one["after"] for method in methods if method.name == _PROPOSED for one in method.summaries}
    rows: Rows = []
    for method in methods:
        pairs = [(mine[one["set"]], one["after"]) for one in method.summaries if one["set"] in mine]
        if method.name != _PROPOSED and pairs:
            above = [_interval([one[key] - other[key] for one, other in pairs], least=-1.0) for key in _KEYS]
            rows.append([f"{_PROPOSED} - {method.name}", str(len(pairs)), *above])
    return {"differences": (["methods", "sets", *_KEYS], rows)}


def periods(methods: Sequence[Method]) -> Report:
    """Return the successes in the last tenth of each period in simulation, where learning has come to."""
    rows: Rows = []
    for method in methods:
        for period in dict.fromkeys(method.periods[0].tolist()):
            if period in ("E", "F"):
                continue
            of_period = [t[p == period] for p, t in zip(method.periods, method.trials, strict=True)]
            ends = [_successes(trials[-max(1, len(trials) // 10) :]) for trials in of_period]
            shares = [_interval([float(one[key].mean()) for one in ends], most=1.0) for key in _KEYS]
            rows.append([method.name, period, *shares])
    return {"periods": (["method", "last tenth of", *_KEYS], rows)}


def within(methods: Sequence[Method]) -> Report:
    """Return how the greedy policies change within each period: the last fifth of its checks less the first.

    All checks of a period play the same starts, without the exploration that falls while a robot learns.
    """
    rows: Rows = []
    for method in methods:
        for period in dict.fromkeys(row["period"] for row in method.checks[0]):
            changes: dict[str, list[float]] = {key: [] for key in _KEYS}
            for checks in method.checks:
                mine = [row for row in checks if row["period"] == period]
                part = max(1, len(mine) // 5)
                for key, found in changes.items():
                    shares = [float(row[key]) for row in mine]
                    found.append(float(np.mean(shares[-part:]) - np.mean(shares[:part])))
            told = [_interval(found, least=-1.0, most=1.0) for found in changes.values()]
            rows.append([method.name, period, *told])
    return {"within": (["method", "greedy policies, last less first fifth of", *_KEYS], rows)}


def _curves(method: Method, key: str) -> Line:
    """Return the share of successes in each block of trials in simulation, with its interval over sets."""
    shares = []
    for periods, trials in zip(method.periods, method.trials, strict=True):
        here = ~np.isin(periods, ["E", "F"])
        success = _successes(trials[here])[key].astype(np.float64)
        parts = np.array_split(success, min(_BLOCKS, len(success)))
        shares.append([float(part.mean()) for part in parts])
        ends = np.cumsum([len(part) for part in parts]).astype(np.float64)
    band = np.array([mean_interval(column) for column in np.array(shares).T])
    return Line(method.name, ends, band[:, 0], np.clip(band[:, 1], 0.0, 1.0), np.clip(band[:, 2], 0.0, 1.0))


def _marks(method: Method) -> list[tuple[float, str]]:
    """Return where each period in simulation begins."""
    periods = method.periods[0]
    here = periods[~np.isin(periods, ["E", "F"])]
    starts = [0, *(np.flatnonzero(here[1:] != here[:-1]) + 1).tolist()]
    return [(float(start), f"period {here[start]}") for start in starts]


def _mu(method: Method, robot: str) -> list[Line]:
    """Return the contributions mu of each object's newest model, means over sets."""
    found: dict[str, list[list[float]]] = {}
    for summary in method.summaries:
        newest = {row["object"]: row for row in summary["models"] if row["robot"] == robot and "contribution" in row}
        for kind, row in newest.items():
            found.setdefault(kind, []).append(row["contribution"])
    lines = []
    for kind, lists in found.items():
        most = min(len(one) for one in lists)
        mean = np.mean([one[:most] for one in lists], axis=0)
        lines.append(Line(kind, np.arange(1.0, most + 1.0), mean))
    return lines


def _trace(method: Method, robot: str) -> list[Line]:
    """Return the prediction errors over one trial of the first set: in the other world if there is one."""
    rows = [row for row in method.traces[0] if row["robot"] == robot]
    where = "transfer" if any(row["where"] == "transfer" for row in rows) else "simulation"
    lines = []
    for kind in dict.fromkeys(row["object"] for row in rows):
        mine = [row for row in rows if row["object"] == kind and row["where"] == where]
        if mine:
            steps, errors = (np.array([float(row[key]) for row in mine]) for key in ("step", "error_px"))
            unseen = np.flatnonzero(np.diff(steps) > 1.0) + 1
            lines.append(Line(kind, np.insert(steps, unseen, steps[unseen]) / 30.0, np.insert(errors, unseen, np.nan)))
    return lines


def figures(methods: Sequence[Method]) -> dict[str, str]:
    """Return the figures as SVG by their file names."""
    found = {}
    marks = next((_marks(m) for m in methods if len(_marks(m)) > 1), _marks(methods[0]))
    for key in _KEYS:
        lines = [_curves(method, key) for method in methods]
        title = f"Fig. 3.10: {key}, share of the trials of a block while learning"
        found[f"figure-3-10-{key}.svg"] = line_chart(lines, title=title, x_label="trial", y_label=key, marks=marks)
    for method in methods:
        for robot in ("passer", "shooter"):
            mu, trace = _mu(method, robot), _trace(method, robot)
            if mu:
                title = f"Fig. 3.9: contributions, {robot}, {method.name}"
                found[f"figure-3-9-{method.name}-{robot}.svg"] = line_chart(
                    mu, title=title, x_label="element of the state", y_label="mu"
                )
            if trace:
                title = f"Fig. 3.8: prediction error of the centre's y, {robot}, {method.name}"
                found[f"figure-3-8-{method.name}-{robot}.svg"] = line_chart(
                    trace, title=title, x_label="time [s]", y_label="error [px]"
                )
    return found


def _curve_rows(methods: Sequence[Method]) -> Report:
    rows: Rows = []
    for method in methods:
        for key in _KEYS:
            line = _curves(method, key)
            assert line.low is not None
            assert line.high is not None
            columns = zip(line.x, line.y, line.low, line.high, strict=True)
            rows += [[method.name, key, f"{x:g}", f"{y:.4f}", f"{a:.4f}", f"{b:.4f}"] for x, y, a, b in columns]
    return {"figure-3-10": (["method", "what", "trial", "share", "low", "high"], rows)}


@click.command()
@click.argument("folder", default=Path("runs/chapter3"), type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Where tables and figures go; by default FOLDER/report.")
@output_options
def report(*, folder: Path, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Make the tables and figures of chapter 3 from the sets in FOLDER, by default runs/chapter3.

    \b
    Example: coevo reproduce chapter3-report runs/short
    """
    del quiet  # it shows no progress
    methods = read_methods(folder)
    out = out or folder / "report"
    shown = (
        periods(methods)
        | within(methods)
        | afterwards(methods)
        | differences(methods)
        | other_world(methods)
        | orders(methods)
        | prediction(methods)
    )
    everything = shown | _curve_rows(methods)
    texts = [f"{name}\n{table(header, rows)}\n" for name, (header, rows) in shown.items() if rows]
    pictures = figures(methods)
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, (header, rows) in everything.items():
            with (out / f"{name}.csv").open("w", encoding="utf-8", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows([header, *rows])
        for name, picture in pictures.items():
            (out / name).write_text(picture, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write into {out}: {error.strerror or error}; choose another --out") from None
    tables = {
        name: [dict(zip(header, row, strict=True)) for row in rows] for name, (header, rows) in everything.items()
    }
    written = {"folder": str(out), "figures": sorted(pictures), "tables": tables}
    show(written, "\n".join([*texts, f"Written: {out}"]), as_json=as_json)
