"""Tables 3.2 and 3.3 and Figs. 3.8 to 3.10 of the dissertation, from sets that 'coevo reproduce chapter3' has run.

Every method's folder is read; the tables are printed and written as CSV, the figures as SVG and CSV, into ``report``.
Intervals are 95 % ones by Student's t over sets; with one set there is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np

from analysis.chapter3_figures import contributions, errors_of_a_trial, figures, learning
from analysis.chapter3_sets import KEYS, Method, read_methods, successes
from analysis.charts import altair
from analysis.written import Report, Rows, frame_table, mean_words, write_report
from coevo.console import output_options

__all__ = ["report"]

_PROPOSED = "schedule"  # the method that others are compared with
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
                shares = [{key: float(v.mean()) for key, v in successes(t).items()} for t in of_period]
                found = [mean_words([one[key] for one in shares], most=1.0) for key in KEYS]
                rows.append([method.name, period, f"{len(of_period[0])}", *found])
        told = [one["periods"] for one in method.summaries if {"E", "F"} <= set(one.get("periods", {}))]
        if told:
            gains = [mean_words([one["F"][key] - one["E"][key] for one in told], least=-1.0, most=1.0) for key in KEYS]
            rows.append([method.name, "F - E", "", *gains])
    real = [["dissertation", p, "", *(told[key] for key in KEYS)] for p, told in _REAL.items()]
    return {"table-3-3": (["method", "period", "trials a set", *KEYS], rows + real)}


def prediction(methods: Sequence[Method]) -> Report:
    """Return the summary of Fig. 3.8, and what the exchange of models between the robots does."""
    errors: Rows = []
    exchanged: Rows = []
    for method in methods:
        keys = ("where", "robot", "object")
        relative = _grouped(method, "prediction_errors", (*keys, "orders"), "relative")
        for key, values in _grouped(method, "prediction_errors", (*keys, "orders"), "rms_px").items():
            errors.append([method.name, *key, mean_words(values), mean_words(relative[key])])
        for key, values in _grouped(method, "exchange", keys, "error_ratio").items():
            exchanged.append([method.name, *key, mean_words(values)])
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
            shares = [mean_words([one[key] for one in measured], most=1.0) for key in KEYS]
            rows.append([method.name, str(len(measured)), nearer, *shares])
    return {"afterwards": (["method", "sets", "nearer to the ball", *KEYS], rows)}


def differences(methods: Sequence[Method]) -> Report:
    """Return by how much the proposed method is above each other one after the last period.

    Sets of one number have the same starts in all methods, so differences are taken within them.
    """
    mine = {one["set"]: one["after"] for method in methods if method.name == _PROPOSED for one in method.summaries}
    rows: Rows = []
    for method in methods:
        pairs = [(mine[one["set"]], one["after"]) for one in method.summaries if one["set"] in mine]
        if method.name != _PROPOSED and pairs:
            above = [mean_words([one[key] - other[key] for one, other in pairs], least=-1.0) for key in KEYS]
            rows.append([f"{_PROPOSED} - {method.name}", str(len(pairs)), *above])
    return {"differences": (["methods", "sets", *KEYS], rows)}


def periods(methods: Sequence[Method]) -> Report:
    """Return the successes in the last tenth of each period in simulation, where learning has come to."""
    rows: Rows = []
    for method in methods:
        for period in dict.fromkeys(method.periods[0].tolist()):
            if period in ("E", "F"):
                continue
            of_period = [t[p == period] for p, t in zip(method.periods, method.trials, strict=True)]
            ends = [successes(trials[-max(1, len(trials) // 10) :]) for trials in of_period]
            shares = [mean_words([float(one[key].mean()) for one in ends], most=1.0) for key in KEYS]
            rows.append([method.name, period, *shares])
    return {"periods": (["method", "last tenth of", *KEYS], rows)}


def within(methods: Sequence[Method]) -> Report:
    """Return how the greedy policies change within each period: the last fifth of its checks less the first.

    All checks of a period play the same starts, without the exploration that falls while a robot learns.
    """
    rows: Rows = []
    for method in methods:
        for period in dict.fromkeys(row["period"] for row in method.checks[0]):
            changes: dict[str, list[float]] = {key: [] for key in KEYS}
            for checks in method.checks:
                mine = [row for row in checks if row["period"] == period]
                part = max(1, len(mine) // 5)
                for key, found in changes.items():
                    shares = [float(row[key]) for row in mine]
                    found.append(float(np.mean(shares[-part:]) - np.mean(shares[:part])))
            told = [mean_words(found, least=-1.0, most=1.0) for found in changes.values()]
            rows.append([method.name, period, *told])
    return {"within": (["method", "greedy policies, last less first fifth of", *KEYS], rows)}


def _behind_figures(methods: Sequence[Method]) -> Report:
    """Return the tidy tables that the figures are drawn from."""
    frames = {
        "figure-3-8-trial": errors_of_a_trial(methods),
        "figure-3-9": contributions(methods),
        "figure-3-10": learning(methods),
    }
    return {name: frame_table(frame) for name, frame in frames.items()}


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
    altair()
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
    write_report(out, shown, _behind_figures(methods), figures(methods), as_json=as_json)
