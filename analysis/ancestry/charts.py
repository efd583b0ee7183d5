"""The ancestry of a champion as pictures; needs altair (see ``analysis.charts.altair``)."""

from __future__ import annotations

import altair as alt

from analysis.ancestry.family import USE, family_table, link_table, origin_table
from analysis.ancestry.inheritance import Ancestry
from analysis.charts import COLOURS
from coevo.records import OPERATORS

__all__ = ["ancestry_chart", "family_chart", "origin_chart"]

# All can be seen on white and on dark pages.
_COLOUR = dict(zip(OPERATORS, (COLOURS[2], COLOURS[3], "#b9b9b9", COLOURS[0], COLOURS[1]), strict=True))
_NEW = ("creation", "mutation", "crossover")  # by which nodes come into being: of a crossover by its small changes
_ROOT, _BRANCH = "#6b757c", "#a3afb8"  # lines
_WIDTH = 760  # [px], as _LANE, from lane to lane
_LANE = 24


def _title(ancestry: Ancestry, what: str, subtitle: str) -> alt.TitleParams:
    whose = f"{ancestry.robot}'s individual {ancestry.index} of generation {ancestry.generation}"
    return alt.Title(f"{what} {whose}", subtitle=subtitle, frame="group", offset=8)


def _generations(ancestry: Ancestry, title: str) -> alt.X:
    last = ancestry.generation
    axis = alt.Axis(grid=False, tickMinStep=1, format="d", tickCount=min(last + 1, 12))
    scale = alt.Scale(domain=[-0.5, last + 0.5], nice=False, padding=0)
    return alt.X("generation:Q", title=title, scale=scale, axis=axis)


def family_chart(ancestry: Ancestry) -> alt.LayerChart:
    """Return the picture of a family: generations from left to right, the root line on top.

    Ancestors of which nothing is left in the champion are left out.
    """
    table = family_table(ancestry)
    lanes = int(table["lane"].max()) + 1
    x = _generations(ancestry, "generation")
    y = alt.Y("lane:Q", axis=None, scale=alt.Scale(domain=[lanes - 0.5, -0.6], nice=False))
    rules = (
        alt.Chart(link_table(table))
        .mark_rule(strokeCap="round")
        .encode(
            x=x,
            y=y,
            x2="generation_parent:Q",
            y2="lane_parent:Q",
            color=alt.condition("datum.is_root", alt.value(_ROOT), alt.value(_BRANCH)),
            strokeWidth=alt.condition("datum.is_root", alt.value(3), alt.value(1.2)),
            tooltip=["generation", "index", "index_parent", alt.Tooltip("came", title="nodes that came")],
        )
    )
    points = (
        alt.Chart(table)
        .mark_circle(opacity=1.0)
        .encode(
            x=x,
            y=y,
            color=alt.Color(
                "operator:N",
                title="came about by",
                scale=alt.Scale(domain=list(OPERATORS), range=[_COLOUR[name] for name in OPERATORS]),
                legend=alt.Legend(symbolType="circle", symbolStrokeWidth=0, symbolOpacity=1, orient="bottom"),
            ),
            size=alt.Size(
                "share:Q",
                title="share of the last tree in it",
                scale=alt.Scale(domain=[0, 1], range=[22, 110]),
                legend=alt.Legend(
                    symbolType="circle",
                    symbolStrokeWidth=0,
                    symbolFillColor="#777777",
                    format=".0%",
                    values=[0.01, 0.1, 0.5, 1.0],
                    orient="bottom",
                ),
            ),
            tooltip=[
                *("generation", "index", "operator", "parent_1", "parent_2", "nodes"),
                alt.Tooltip("fitness", format=".4f"),
                alt.Tooltip("carried", title="nodes of the last tree"),
                alt.Tooltip("arisen", title="of these new in it"),
            ],
        )
    )
    told = f"Those who had some of its {len(ancestry.nodes)} nodes, and its root line, which is thick."
    chart: alt.LayerChart = (rules + points).properties(
        width=_WIDTH,
        height=max(lanes, 2) * _LANE,
        title=_title(ancestry, "Ancestors of", f"{told} Thin lines: where its other branches came from."),
    )
    return chart


def origin_chart(ancestry: Ancestry) -> alt.LayerChart:
    """Return how many of a champion's nodes came into being in which generation."""
    table = origin_table(ancestry)
    table["kind"] = (table["operator"] + ", " + table["use"]).str.removesuffix(f", {USE[2]}")
    totals = table.groupby("generation", as_index=False)["nodes"].sum()
    kinds = [f"{operator}{use}" for operator in _NEW for use in (f", {USE[0]}", f", {USE[1]}", "")]
    shades = [shade for name in _NEW for shade in (_COLOUR[name], f"{_COLOUR[name]}59", _COLOUR[name])]
    colours = dict(zip(kinds, shades, strict=True))
    shown = [kind for kind in kinds if kind in set(table["kind"])]
    x = _generations(ancestry, "generation that they came into being in")
    bars = (
        alt.Chart(table)
        .mark_bar(size=min(9.0, 0.7 * _WIDTH / (ancestry.generation + 1)))
        .encode(
            x=x,
            y=alt.Y("nodes:Q", title="nodes", axis=alt.Axis(tickMinStep=1, format="d", tickCount=4)),
            color=alt.Color(
                "kind:N",
                title=None,
                scale=alt.Scale(domain=shown, range=[colours[kind] for kind in shown]),
                legend=alt.Legend(
                    symbolType="square", symbolStrokeWidth=0, symbolOpacity=1, orient="bottom", columnPadding=24
                ),
            ),
            order=alt.Order("kind:O"),
            tooltip=["generation", "operator", "use", "nodes"],
        )
    )
    numbers = alt.Chart(totals).mark_text(dy=-7, fontSize=11).encode(x=x, y="nodes:Q", text="nodes:Q")
    chart: alt.LayerChart = (bars + numbers).properties(
        width=_WIDTH,
        height=110,
        title=_title(ancestry, "Age of the nodes of", "How many came into being in which generation."),
    )
    return chart


def ancestry_chart(ancestry: Ancestry) -> alt.TopLevelMixin:
    """Return both pictures of an ancestry, one above the other."""
    both = alt.vconcat(family_chart(ancestry), origin_chart(ancestry))
    chart: alt.TopLevelMixin = both.resolve_scale(color="independent", size="independent")
    return chart
