"""Charts of the curves of ``analysis.curves``: a column a robot, a row a measure, a colour a group of runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pandas as pd

from analysis.charts import COLOURS, altair
from analysis.curves import STATISTICS
from analysis.groups import group_names
from coevo.config import RunSettings
from coevo.run import Run

if TYPE_CHECKING:
    import altair as alt

__all__ = ["Words", "chart", "words_for"]

_HEIGHT = {1: 260, 2: 170}  # of a row, by how many rows there are; more are lower still
_LOW = 110
_WIDTH = {1: 420, 2: 320, 3: 240}  # of a column, by how many there are
_NARROW = 200
_ACROSS = 3  # measures in a row, if there is one robot
_MOST_NAMED = 2  # groups in a title; the legend names all
_ROOM = 0.15  # of the range of the lines that a band may go beyond it
_AXIS = 38  # room for the numbers of an axis, the same everywhere, so that panels stand in columns
_STROKES = {"best": 2.4, "mean": 1.2, "worst": 1.0}
_DASHES: dict[str, list[int]] = {"best": [1, 0], "mean": [1, 0], "worst": [3, 3]}
_ONE_GROUP = {"best": COLOURS[0], "mean": COLOURS[1], "worst": COLOURS[6]}
_SOCCER = {
    "goals": "goals",
    "lost": "goals lost",
    "kicks": "steps of contact",
    "collisions": "collisions",
    "steps": "steps",
    "passes": "passes",
    "own_goals": "own goals",
}
_SIZES = {
    "fitness": "fitness (smaller is better)",
    "depth": "depth of the tree",
    "nodes": "nodes of the tree",
    "diversity_trees": "share of different trees",
    "diversity_tops": "evenness of tree tops (0 to 1)",
}
_ESTIMATES = {"mean": "mean", "iqm": "interquartile mean"}


@dataclass(frozen=True)
class Words:
    """What stands around a chart.

    Attributes:
        title, subtitle: above it.
        measures: what the axis of a measure is called, with its unit.
    """

    title: str = ""
    subtitle: str = ""
    measures: dict[str, str] = field(default_factory=dict)


def words_for(runs: Sequence[Run], estimator: str = "mean") -> Words:
    """Return the words for a chart of some runs: what it is about, and over how many games counts are summed."""
    groups = group_names(runs)
    names = list(dict.fromkeys(groups.values()))
    games = {run.config.evaluation.games for run in runs}
    over = f" in {next(iter(games))} games" if games != {1} and len(games) == 1 else ""
    measures = dict(_SIZES)
    for run in runs:
        known = _SOCCER if isinstance(run.config, RunSettings) else {}
        measures |= {name: known.get(name, name.replace("_", " ")) + over for name in run.game.counts}
        for role in run.evolving:
            measures |= {f"use_{name}": f"share of {name}" for name in run.game.function_set(role).terminals}
    populations = sorted({run.config.gp.population for run in runs})
    trees = " or ".join(str(number) for number in populations)
    subtitle = f"best (by fitness), mean and worst of {trees} trees a generation"
    most = max(list(groups.values()).count(name) for name in names)
    if most > 1:
        sizes = sorted({list(groups.values()).count(name) for name in names})
        told = " to ".join(dict.fromkeys([str(sizes[0]), str(sizes[-1])]))
        subtitle += f"; {_ESTIMATES[estimator]} over {told} runs, bands: 95 % intervals over runs of best and mean"
    title = ", ".join(names) if len(names) <= _MOST_NAMED else f"{len(names)} groups of runs"
    return Words(title, subtitle, measures)


def chart(curves: pd.DataFrame, words: Words | None = None) -> alt.VConcatChart:
    """Return a chart of curves: a row a measure and a column a robot, or measures side by side of one robot.

    Best is a strong line, mean and worst are thin ones. One group has a colour a statistic, several have one each.
    Bands are intervals over runs; where few runs make them much wider than the lines reach, they are cut off.

    Args:
        curves: of ``analysis.curves.summary``.
        words: what stands around it.

    Raises:
        InputError: altair is not installed.
    """
    vega = altair()
    words = words or Words()
    measures, robots = list(dict.fromkeys(curves["measure"])), list(dict.fromkeys(curves["robot"]))
    by_measure = len(robots) == 1 and len(measures) > 1
    across = min(_ACROSS, len(measures)) if by_measure else len(robots)
    panels = [(measure, robot) for measure in measures for robot in robots]
    lines = [panels[first : first + across] for first in range(0, len(panels), across)]
    size = {"width": _WIDTH.get(across, _NARROW), "height": _HEIGHT.get(len(lines), _LOW)}
    encode = _Encoding(vega, curves)
    rows = []
    for number, line in enumerate(lines):
        cells = []
        for place, (measure, robot) in enumerate(line):
            part = curves[(curves["measure"] == measure) & (curves["robot"] == robot)]
            title = words.measures.get(measure, measure.replace("_", " "))
            heading = title if by_measure else robot if number == 0 and len(robots) > 1 else ""
            axis = _two_lines(title) if place == 0 and not by_measure else None
            domain = _domain(curves[curves["measure"] == measure])
            x_title = "generation" if number * across + place + across >= len(panels) else None
            cells.append(
                encode.panel(part, axis, x_title, domain).properties(title={"text": heading, "frame": "group"}, **size)
            )
        rows.append(vega.hconcat(*cells, spacing=14))
    heading = {"text": words.title, "subtitle": words.subtitle, "anchor": "start", "fontSize": 15}
    if len(robots) == 1 and not words.title.endswith(robots[0]):
        heading["text"] = f"{words.title} {robots[0]}".strip()
    whole = vega.vconcat(*rows, spacing=10, title=heading).resolve_scale(
        color="shared", strokeDash="shared", strokeWidth="shared"
    )
    return cast("alt.VConcatChart", whole)


def _domain(part: pd.DataFrame) -> tuple[float, float]:
    """Return the range of the axis of a measure: of its lines, from 0 if that is near, and a little more for bands."""
    values, bands = part["value"].dropna(), part[["low", "high"]].dropna()
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    low = 0.0 if 0.0 <= low < 0.5 * high else low
    least, most = (float(bands["low"].min()), float(bands["high"].max())) if len(bands) else (low, high)
    size = high - low or 1.0
    below, above = (float(np.clip(far, 0.03 * size, _ROOM * size)) for far in (low - least, most - high))
    return low - (below if low else 0.0), high + above


def _two_lines(title: str) -> list[str]:
    """Return a title in two lines if it has a second part, so that it is no longer than a low panel is high."""
    first, between, second = title.partition(" in ") if " in " in title else title.partition(" (")
    return [first, (between + second).strip()] if second else [first]


class _Encoding:
    """How numbers become marks, the same in all panels."""

    def __init__(self, alt: Any, curves: pd.DataFrame) -> None:
        self._alt = alt
        groups = [str(group) for group in dict.fromkeys(curves["group"])]
        self._statistics = [name for name in STATISTICS if name in set(curves["statistic"])]
        self._banded = [name for name in self._statistics if name != "worst"] or self._statistics
        self._last = max(1, int(curves["generation"].max()))
        if len(groups) == 1:
            self._colour = self._channel(alt.Color, "statistic", {name: _ONE_GROUP[name] for name in self._statistics})
        else:
            colours = {group: COLOURS[number % len(COLOURS)] for number, group in enumerate(groups)}
            self._colour = self._channel(alt.Color, "group", colours)
        self._stroke = {
            "strokeWidth": self._channel(alt.StrokeWidth, "statistic", {n: _STROKES[n] for n in self._statistics}),
            "strokeDash": self._channel(alt.StrokeDash, "statistic", {n: _DASHES[n] for n in self._statistics}),
        }

    def _channel(self, channel: Any, column: str, values: Mapping[str, Any]) -> Any:
        """Return a channel with a value for each word of a column, and a legend if there are several."""
        symbols = {"symbolType": "stroke", "symbolSize": 400, "symbolOpacity": 1}
        legend = {"orient": "bottom", "title": None, "labelLimit": 500, "columnPadding": 24, **symbols}
        scale = {"domain": list(values), "range": list(values.values())}
        # Ordinal: Vega-Lite warns of widths for what has no order.
        return channel(f"{column}:O", scale=scale, legend=legend if len(values) > 1 else None, sort=list(values))

    def panel(
        self, part: pd.DataFrame, y_title: list[str] | None, x_title: str | None, domain: tuple[float, float]
    ) -> Any:
        """Return the lines and bands of one robot and measure."""
        alt = self._alt
        generations = {"tickCount": min(6, self._last), "grid": False, "format": "d"}
        within = {"domain": [0, self._last], "nice": False}
        x = alt.X("generation:Q", title=x_title, axis=generations, scale=within)
        decimals = max(0, 2 - int(np.floor(np.log10(domain[1] - domain[0]))))
        up = {
            "title": y_title,
            "scale": {"domain": list(domain), "nice": False, "zero": False},
            "axis": {"tickCount": 4, "format": f",.{decimals}~f", "minExtent": _AXIS},
        }
        told = [alt.Tooltip(f"{name}:N") for name in ("group", "statistic")]
        told += [alt.Tooltip("generation:Q"), *(alt.Tooltip(f"{n}:Q", format=".4g") for n in ("value", "low", "high"))]
        data = part.drop(columns=["measure", "robot"])
        around = data[data["low"].notna() & data["statistic"].isin(self._banded)]
        layers = []
        if len(around):
            y, y2, detail = alt.Y("low:Q", **up), "high:Q", ["group:N", "statistic:N"]
            bands = alt.Chart(around).mark_area(opacity=0.13, clip=True)
            layers.append(bands.encode(x=x, y=y, y2=y2, color=self._colour, detail=detail))
        for name in reversed([one for one in self._statistics if one in set(data["statistic"])]):
            # Vega-Lite reads the width of a line from its mark; the channel makes the legend.
            lines = alt.Chart(data[data["statistic"] == name]).mark_line(size=_STROKES[name])
            layers.append(
                lines.encode(
                    x=x, y=alt.Y("value:Q", **up), color=self._colour, detail="group:N", tooltip=told, **self._stroke
                )
            )
        return alt.layer(*layers)
