"""What several rewards are worth against weighted sums of them, and Figs. 5.4 to 5.10, from a study of chapter 5.

Every finished run of the folder is read, so that a study under way can be looked at; tables are printed and written as
CSV, figures as SVG, into ``report``. Runs of one seed have the same models and the same trials to begin with, so arms
are compared within seeds.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
import pandas as pd

from analysis.chapter5_runs import CARD, WHILE, Arms, Rewarded, more_often, read_arms, within_sets
from analysis.chapter5_team import read_teams, team_figures, team_report
from analysis.charts import altair, line_chart
from analysis.written import Report, Rows, frame_table, mean_words, report_options, write_report

if TYPE_CHECKING:
    import altair as alt

__all__ = ["comparisons", "curves", "on_cards", "report", "two_by_two", "while_learning"]

_EARLY = 0.2  # share of the trials that "a little faster" is about
_CELLS = ("votes-one-discount", "votes", "sum-one-discount", "sum")


def on_cards(arms: Arms) -> Report:
    """Return what the skills of each arm are worth: the greedy policy on unseen starts, means over sets."""
    rows: Rows = []
    for name, runs in arms.items():
        told = [
            mean_words([run.on_card(what) for run in runs], most=np.inf if what == "contact" else 1.0) for what in CARD
        ]
        rows.append([name, str(len(runs)), *told])
    header = ["arm", "sets", "success", "success anywhere", "trials with collisions", "steps of contact a trial"]
    return {"on-cards": (header, rows)}


def while_learning(arms: Arms) -> Report:
    """Return how often what is rewarded happened while each arm learned, per trial, with exploration."""
    rows: Rows = []
    for name, runs in arms.items():
        early = mean_words([run.while_learning("goals", _EARLY) for run in runs], most=1.0)
        told = [mean_words([run.while_learning(what) for run in runs], most=1.0) for what in WHILE]
        best = mean_words([run.best_block for run in runs], most=1.0)
        rows.append([name, str(len(runs)), early, told[0], best, *told[1:]])
    header = ["arm", "sets", "goals, first fifth", "goals", "best block", "trials with collisions", "trials with kicks"]
    return {"while-learning": (header, rows)}


def _of_seeds(arms: Arms, what: Callable[[Rewarded], float]) -> dict[str, dict[int, float]]:
    """Return something of each run, by arm and seed."""
    return {name: {run.seed: what(run) for run in runs} for name, runs in arms.items()}


def comparisons(arms: Arms) -> Report:
    """Return by how much success and collisions on the card differ within sets, and how probably one arm is better."""
    header = ["arms", "sets", "success", "probability of more", "collisions", "goals, first fifth"]
    rows: Rows = []
    success = _of_seeds(arms, lambda run: run.on_card("success"))
    others = [
        _of_seeds(arms, lambda run: run.on_card("collisions")),
        _of_seeds(arms, lambda run: run.while_learning("goals", _EARLY)),
    ]
    for name in arms:
        for base in [one for one in ("votes", "w0", "q", "q-mild") if one in arms and one != name]:
            pairs = [within_sets(found[name], found[base]) for found in (success, *others)]
            if (base != "votes" and name == "votes") or not pairs[0].size:
                continue
            told = [mean_words((first - second).tolist(), least=-1.0, most=1.0) for first, second in pairs]
            rows.append([f"{name} - {base}", str(pairs[0].shape[1]), told[0], more_often(pairs[0]), *told[1:]])
    return {"comparisons": (header, rows)}


def two_by_two(arms: Arms) -> Report:
    """Return the 2 x 2 of discounts and choice: what each adds to success, over both ways of the other.

    The last is what both together add beyond the two.
    """
    success = _of_seeds(arms, lambda run: run.on_card("success"))
    cells = [success.get(name, {}) for name in _CELLS]
    seeds = sorted(set.intersection(*(set(cell) for cell in cells)))
    effects = {
        "a discount for each": (-0.5, 0.5, -0.5, 0.5),
        "votes, not the sum": (0.5, 0.5, -0.5, -0.5),
        "both, beyond the two": (-1.0, 1.0, 1.0, -1.0),
    }
    rows: Rows = []
    for effect, weights in effects.items():
        if seeds:
            sums = [sum(weight * cell[seed] for weight, cell in zip(weights, cells, strict=True)) for seed in seeds]
            rows.append([effect, str(len(seeds)), mean_words(sums, least=-2.0, most=2.0)])
    return {"two-by-two": (["effect of", "sets", "success"], rows)}


def curves(arms: Arms, what: str) -> pd.DataFrame:
    """Return one of WHILE per trial, means over sets, over windows of four blocks.

    Returns:
        Columns ``arm``, ``trial``, ``share``.
    """
    parts = [run.curve(what).assign(arm=name) for name, runs in arms.items() for run in runs]
    means = pd.concat(parts).groupby(["arm", "trial"], sort=False)["share"].mean()
    return means.reset_index()[["arm", "trial", "share"]]


def figures(arms: Arms) -> dict[str, alt.LayerChart]:
    """Return the charts by the names of their files: Fig. 5.4 is the first, Fig. 5.7 all where robots may collide."""
    names = {"goals": "goals", "trials with kicks": "kicks", "trials with collisions": "collisions"}
    found = {}
    for what, file in names.items():
        frame = curves(arms, what)
        if frame["share"].any():
            titles = (f"{what}, mean over sets", "trial", "share of 1,000 trials")
            found[f"{file}.svg"] = line_chart(frame, x="trial", y="share", by="arm", titles=titles)
    return found


@click.command()
@report_options
def report(*, folder: Path, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Make the tables and figures of chapter 5 from the study in FOLDER, which may be under way.

    \b
    Example: coevo reproduce chapter5 runs/shoot-study
             coevo reproduce chapter5 runs/pass-study
    """
    del quiet  # it shows no progress
    altair()
    teams = read_teams(folder)
    if teams:
        write_report(out or folder / "report", *team_report(teams), team_figures(teams), as_json=as_json)
        return
    arms = read_arms(folder)
    shown = {
        name: one for part in (on_cards, comparisons, two_by_two, while_learning) for name, one in part(arms).items()
    }
    others: Report = {"curves": frame_table(curves(arms, "goals"))}
    write_report(out or folder / "report", shown, others, figures(arms), as_json=as_json)
