"""Trials to each level and in all, arms against each other, and Figs. 4.5 to 4.9, from a study of chapter 4.

Every finished run of the folder is read, so that a study under way can be looked at; tables are printed and written as
CSV, figures as SVG, into ``report``. Runs of one seed have the same models and the same trials to begin with, so arms
are compared within seeds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from analysis.chapter4_compared import between_words, common, faster, geometric, needs, of_medians, ratios
from analysis.chapter4_equal import at_equal_trials
from analysis.chapter4_figures import figures, shares_met
from analysis.chapter4_runs import Arms, Learned, read_arms
from analysis.charts import altair
from analysis.written import Report, Rows, frame_table, mean_words, report_options, write_report
from coevo.statistics import probability_of_improvement

__all__ = ["beside_the_dissertation", "comparisons", "held", "levels", "periods", "report", "two_by_two", "worlds"]

MAIN = ("variable", "n4")  # the comparison that was named before the study was run
_BASES = ("n4", "full-speed-n4")  # what every arm of the same world is compared with
_FAST = "full-speed-"
# What 4.5.2 gives for the defender with n = 4, by k: success and collisions. Its figure ends there.
_TOLD = {("n4", 4): ("0.385", "0.147")}
_TOLD_AT = (4, 10)  # k


def worlds(arms: Mapping[str, Sequence[Learned]]) -> dict[str, list[str]]:
    """Return which arms are of one world: by what their names begin with, if there is an arm ...n4 of it.

    Example:
        >>> from analysis.chapter4 import worlds
        >>> worlds({name: [] for name in ("n4", "variable", "full-speed-n4", "noise-n4", "noise-variable")})
        {'': ['n4', 'variable', 'full-speed-n4'], 'noise-': ['noise-n4', 'noise-variable']}
    """
    bases = [name.removesuffix("n4") for name in arms if name.endswith("n4") and not name.endswith(f"{_FAST}n4")]
    found: dict[str, list[str]] = {prefix: [] for prefix in sorted({*bases, ""}, key=len, reverse=True)}
    for name in arms:
        found[next(prefix for prefix in found if name.startswith(prefix))].append(name)
    return dict(reversed(found.items()))


def in_all(arms: Arms) -> Report:
    """Return what each arm needed in all: medians over sets, with how many met the criteria on the highest level."""
    header = ["arm", "sets", "met", "trials", "net of the floor"]
    header += ["million steps", "with the models'", "hours of the robot", "states"]
    rows: Rows = []
    for name, runs in arms.items():
        met = sum(run.met > 0 for run in runs)
        told = [between_words(of_medians(needs(runs, what)), 0) for what in ("trials", "net")]
        told += [between_words(of_medians(needs(runs, what) / 1e6)) for what in ("steps", "samples")]
        told.append(between_words(of_medians(needs(runs, "hours")), 1))
        states = np.median([float(run.row["states"]) for run in runs])
        rows.append([name, str(len(runs)), str(met), *told, f"{states:,.0f}"])
    return {"in-all": (header, rows)}


def at_the_end(arms: Arms) -> Report:
    """Return what the skills are worth in the world of the recipe, k = 10, by their cards: greedy, on unseen starts."""
    keys = [key for key in next(iter(arms.values()))[0].row if "_rate_" in key]
    rows: Rows = []
    for name, runs in arms.items():
        last = [run.stays[-1].last for run in runs if run.stays[-1].level == run.top and run.stays[-1].last >= 0.0]
        cards = [[float(run.row[key]) for run in runs if run.row.get(key)] for key in keys]
        told = [mean_words(values, most=1.0) for values in [last, *cards]]
        rows.append([name, str(len(runs)), str(len(last)), *told])
    header = ["arm", "sets", "of them at k = 10", "success while learning there", *(k.replace("_", " ") for k in keys)]
    return {"at-the-end": (header, rows)}


def levels(arms: Arms) -> Report:
    """Return what happened on each level: how many came there, and how many met the criteria and did not give up."""
    header = ["arm", "k", "came", "met", "after trials", "trials there", "success at first", "best", "at last"]
    rows: Rows = []
    collisions = any(run.minds_collisions for runs in arms.values() for run in runs)
    for name, runs in arms.items():
        for level in range(max(run.top for run in runs) + 1):
            stays = [[stay for stay in run.stays if stay.level == level] for run in runs]
            came = [mine for mine in stays if mine]
            if came:
                met = sum(any(stay.met > 0 for stay in mine) for mine in came)
                after = np.median([mine[0].began for mine in came])
                there = np.median([sum(stay.ended - stay.began for stay in mine) for mine in came])
                rates = [
                    [mine[0].first for mine in came],
                    [np.nanmax([stay.best for stay in mine] + [-1.0]) for mine in came],
                    [mine[-1].last for mine in came],
                    *([[mine[-1].collisions for mine in came]] if collisions else []),
                ]
                told = [mean_words([rate for rate in one if rate >= 0.0], most=1.0) for one in rates]
                k = str(level + runs[0].lowest)
                rows.append([name, k, str(len(came)), str(met), f"{after:,.0f}", f"{there:,.0f}", *told])
    return {"levels": ([*header, *(["collisions at last"] if collisions else [])], rows)}


def held(arms: Arms) -> Report:
    """Return up to which k the criteria were met, where collisions are minded: how many runs met them last where.

    Medians of trials are until then, and of axes there were then; runs that never met them are under ``never``.
    """
    rows: Rows = []
    for name, runs in arms.items():
        if not all(run.minds_collisions for run in runs):
            continue
        last = [[stay for stay in run.stays if stay.met > 0][-1:] for run in runs]
        found = [mine[0] for mine in last if mine]
        where = Counter(stay.level + runs[0].lowest for stay in found)
        told = [f"{k}: {count}" for k, count in sorted(where.items())]
        told += [f"never: {len(runs) - len(found)}"] if len(found) < len(runs) else []
        of = [[getattr(stay, key) for stay in found] for key in ("met", "dimension")]
        said = [f"{np.median(values):,.0f}" if values else "" for values in of]
        rows.append([name, str(len(runs)), ", ".join(told), *said])
    return {"held": (["arm", "sets", "k: runs", "trials until then", "axes"], rows)} if rows else {}


def beside_the_dissertation(arms: Arms) -> Report:
    """Return success and collisions at k = 4 and k = 10 where collisions are minded: over the last window there.

    They are those of learning, with exploration, as in 4.5.2; runs that did not come so far are left out, and counted.
    """
    header = ["arm", "sets", "k", "came", "success", "collisions", "more collisions", "dissertation"]
    rows: Rows = []
    for name, runs in arms.items():
        if not all(run.minds_collisions for run in runs):
            continue
        for k in _TOLD_AT:
            stays = [[stay for stay in run.stays if stay.level + run.lowest == k] for run in runs]
            ends = [mine[-1] for mine in stays if mine and mine[-1].last >= 0.0]
            if ends:
                told = [mean_words(one, most=1.0) for one in ([e.last for e in ends], [e.collisions for e in ends])]
                more = f"{sum(end.collisions > end.last for end in ends)} of {len(ends)}"
                theirs = " and ".join(_TOLD.get((name, k), ()))
                rows.append([name, str(len(runs)), str(k), str(len(ends)), *told, more, theirs])
    return {"success-and-collisions": (header, rows)} if rows else {}


def periods(arms: Arms) -> Report:
    """Return where axes were added, the weak critical periods: how many runs did so at which k."""
    rows: Rows = []
    for name, runs in arms.items():
        added = [
            (int(event["dimension"]), int(event["level"]) + run.lowest, int(event["trial"]))
            for run in runs
            for event in run.events
            if event["event"] == "axis_added"
        ]
        for dimension in sorted({one for one, _, _ in added}):
            mine = [(level, trial) for one, level, trial in added if one == dimension]
            where = Counter(level for level, _ in mine)
            told = ", ".join(f"{level}: {count}" for level, count in sorted(where.items()))
            after = np.median([trial for _, trial in mine])
            rows.append([name, f"{dimension - 1} to {dimension}", f"{len(mine)} of {len(runs)}", told, f"{after:,.0f}"])
    return {"weak-critical-periods": (["arm", "axes", "runs", "at k: runs", "after trials"], rows)}


def comparisons(arms: Arms) -> Report:
    """Return by what factor arms need more trials than the two with all axes, levels and none, in the same world."""
    header = ["arms", "sets", "trials", "geometric mean"]
    header += ["net", "steps", "with the models'", "probability of fewer trials"]
    rows: Rows = []
    for prefix, names in worlds(arms).items():
        for base in [prefix + name for name in _BASES if prefix + name in names]:
            for name in names:
                if name != base:
                    rows.append(_compared(arms, name, base))
    main = " / ".join(MAIN)
    return {"comparisons": (header, [row for row in sorted(rows, key=lambda row: row[0] != main) if row[1] != "0"])}


def _compared(arms: Arms, name: str, base: str) -> list[str]:
    powers = {name: 1.0, base: -1.0}
    mine, other = common([arms[name], arms[base]])
    if not mine:
        return [f"{name} / {base}", "0"]
    found = {what: ratios(powers, arms, what) for what in ("trials", "net", "steps", "samples")}
    told = {what: between_words(of_medians(values)) for what, values in found.items()}
    share = "{:.2f} [{:.2f}, {:.2f}]".format(*faster(mine, other))
    row = [f"{name} / {base}", str(len(mine)), told["trials"], _mean(found["trials"])]
    return [*row, told["net"], told["steps"], told["samples"], share]


def _mean(values: NDArray[np.float64]) -> str:
    mean = geometric(values)
    return "" if mean is None else "{:.2f} [{:.2f}, {:.2f}]".format(*mean)


def two_by_two(arms: Arms) -> Report:
    """Return the 2 x 2 of levels and growing axes: the factor of each, over both ways of the other.

    The last, how far the factor of growth with levels is from that at full speed, is 1 where the two do not matter to
    each other.
    """
    rows: Rows = []
    for prefix, names in worlds(arms).items():
        for grown in [name for name in names if name.startswith(f"{prefix}variable")]:
            cells = [f"{prefix}n4", grown, f"{prefix}{_FAST}n4", f"{prefix}{_FAST}{grown.removeprefix(prefix)}"]
            if not set(cells) <= set(names) or not common([arms[cell] for cell in cells])[0]:
                continue
            effects = {
                "levels": (0.5, 0.5, -0.5, -0.5),
                "growing axes": (-0.5, 0.5, -0.5, 0.5),
                "both, beyond the two": (-1.0, 1.0, 1.0, -1.0),
            }
            for effect, powers in effects.items():
                found = [ratios(dict(zip(cells, powers, strict=True)), arms, what) for what in ("trials", "net")]
                told = [between_words(of_medians(values)) for values in found]
                rows.append([effect, grown, str(len(found[0])), told[0], _mean(found[0]), told[1]])
    return {"two-by-two": (["factor of", "grown", "sets", "trials", "geometric mean", "net"], rows)}


def success(arms: Arms) -> Report:
    """Return how the skills of arms compare in success by the card, from starts in view."""
    key = "success_rate_in_view"
    rows: Rows = []
    for prefix, names in worlds(arms).items():
        for base in [prefix + name for name in _BASES if prefix + name in names]:
            for name in names:
                mine, other = common([arms[name], arms[base]])
                if name != base and mine and all(run.row.get(key) for run in [*mine, *other]):
                    rates = [[float(run.row[key]) for run in runs] for runs in (mine, other)]
                    above = mean_words((np.array(rates[0]) - rates[1]).tolist(), least=-1.0, most=1.0)
                    share = "{:.2f} [{:.2f}, {:.2f}]".format(*probability_of_improvement(*rates))
                    rows.append([f"{name} - {base}", str(len(mine)), above, share])
    return {"success": (["arms", "sets", "success in view", "probability of more"], rows)}


@click.command()
@report_options
def report(*, folder: Path, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Make the tables and figures of chapter 4 from the study in FOLDER, which may be under way.

    \b
    Example: coevo reproduce chapter4 runs/shooter-study
             coevo reproduce chapter4 runs/defender-study
    """
    del quiet  # it shows no progress
    altair()
    arms = read_arms(folder)
    parts: tuple[Callable[[Arms], Report], ...] = (in_all, comparisons, two_by_two, held, beside_the_dissertation)
    parts += (at_equal_trials, at_the_end, success, periods, levels)
    shown = {name: one for part in parts for name, one in part(arms).items()}
    curves: Report = {"shares-met": frame_table(shares_met(arms))}
    write_report(out or folder / "report", shown, curves, figures(arms), as_json=as_json)
