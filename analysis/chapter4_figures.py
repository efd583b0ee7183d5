"""Figs. 4.5 to 4.9 of the dissertation, for each arm the run in the middle, and how soon sets came to the end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import pandas as pd

from analysis.chapter4_equal import means_of_checks
from analysis.chapter4_runs import Arms, Learned
from analysis.charts import line_chart

if TYPE_CHECKING:
    import altair as alt

__all__ = ["figures", "marks_of", "middle", "rates_of", "shares_met"]

# Of the figures of the dissertation: of the shooter, and of the defender, whose levels begin with k = 0.
_NUMBERS = {
    1: {"n1": "4.5", "n2": "4.5", "n3": "4.5", "n4": "4.5", "variable": "4.6"},
    0: {"n1": "4.7", "n2": "4.7", "n3": "4.8", "n4": "4.8", "variable": "4.9"},
}
_COMPARED = ("n4", "variable", "variable-from-2", "full-speed-n4", "full-speed-variable", "full-speed-variable-from-2")


def middle(runs: Sequence[Learned]) -> Learned:
    """Return the run in the middle by the trials that runs needed, of two the faster."""
    ordered = sorted(runs, key=lambda run: (run.needed()[1], run.seed))
    return ordered[(len(ordered) - 1) // 2]


def rates_of(run: Learned) -> pd.DataFrame:
    """Return the rates of each block of trials, of collisions if there was one.

    Returns:
        Columns ``what``, ``trial`` (the last of the block), ``share``.
    """
    names = ["success", *(["collisions"] if run.blocks["collisions"].any() else [])]
    parts = [
        pd.DataFrame({"what": name, "trial": run.blocks["trial"], "share": run.blocks[name] / run.blocks["trials"]})
        for name in names
    ]
    return pd.concat(parts, ignore_index=True)


def marks_of(run: Learned) -> pd.DataFrame:
    """Return where the level changed and where an axis was added.

    Returns:
        Columns ``trial``, ``name`` (the new k or n), ``kind`` (``level`` or ``axis``).
    """
    rows = []
    for event in run.events:
        if event["event"] in ("raised", "lowered"):
            rows.append((int(event["trial"]), str(int(event["level"]) + run.lowest), "level"))
        if event["event"] == "axis_added":
            rows.append((int(event["trial"]), f"n = {event['dimension']}", "axis"))
    return pd.DataFrame(rows, columns=["trial", "name", "kind"])


def shares_met(arms: Arms) -> pd.DataFrame:
    """Return which share of the sets had met the criteria on the highest level, by trials: a staircase an arm.

    Returns:
        Columns ``arm``, ``trial``, ``share``.
    """
    rows: list[tuple[str, int, float]] = []
    for name, runs in arms.items():
        share = 0.0
        rows.append((name, 0, share))
        for trial in sorted(run.met for run in runs if run.met > 0):
            rows += [(name, int(trial), share), (name, int(trial), share + 1.0 / len(runs))]
            share += 1.0 / len(runs)
        rows.append((name, max(run.limit for run in runs), share))
    return pd.DataFrame(rows, columns=["arm", "trial", "share"]).round({"share": 6})


def figures(arms: Arms) -> dict[str, alt.LayerChart]:
    """Return the charts by the names of their files."""
    found = {}
    for name, runs in arms.items():
        run = middle(runs)
        numbers = _NUMBERS[run.lowest]
        figure = f"Fig. {numbers[name]}: " if name in numbers else ""
        about = f"{figure}{name}, seed {run.seed}; numbers above are k"
        file = f"figure-{numbers.get(name, 'arm').replace('.', '-')}-{name}.svg"
        titles = (about, "trial", "share of 100 trials" if run.settings["trials"] == 100 else "share of a block")
        found[file] = line_chart(rates_of(run), x="trial", y="share", by="what", titles=titles, marks=marks_of(run))
    chosen = [name for name in arms if name in _COMPARED] or list(arms)
    staircases = shares_met(arms)
    titles = ("sets that met the criteria on the highest level", "trial", "share of sets")
    found["shares-met.svg"] = line_chart(
        staircases[staircases["arm"].isin(chosen)], x="trial", y="share", by="arm", titles=titles
    )
    checks = means_of_checks(arms)
    if len(checks):
        titles = ("greedy policy at the highest k, mean over sets", "trial", "share of 300 trials")
        found["greedy-success.svg"] = line_chart(checks, x="trial", y="share", by="arm", titles=titles)
    return found
