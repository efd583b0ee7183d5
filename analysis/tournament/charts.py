"""Charts of the tables of a tournament; needs altair (see ``analysis.charts.altair``)."""

from __future__ import annotations

import altair as alt
import pandas as pd

__all__ = ["against_chart", "cross_chart", "master_chart", "matrix_chart", "ratings_chart"]

_CELLS = 360  # of a matrix, side length [px]


def matrix_chart(table: pd.DataFrame, *, alone: bool = False) -> alt.TopLevelMixin:
    """Return the matrices of ``matrix_table`` side by side: bright where a generation of the side won.

    Args:
        table: of ``matrix_table``.
        alone: whether there is one team only, whose columns are repetitions.
    """
    cells = len(table["generation"].unique())
    size = max(160, min(_CELLS, 14 * cells))
    met = "set of starts" if alone else "generation of the other side"
    chart: alt.TopLevelMixin = (
        alt.Chart(table)
        .mark_rect()
        .encode(
            x=alt.X("met:O", title=met, axis=alt.Axis(labelOverlap=True, labelAngle=0)),
            y=alt.Y("generation:O", title="generation", sort="descending", axis=alt.Axis(labelOverlap=True)),
            color=alt.Color(
                "share:Q",
                title="games won",
                scale=alt.Scale(scheme="viridis", domain=[0.0, 1.0]),
                legend=alt.Legend(format=".0%", type="gradient"),
            ),
            tooltip=[
                alt.Tooltip("side:N"),
                alt.Tooltip("generation:O"),
                alt.Tooltip("met:O", title=met),
                alt.Tooltip("share:Q", title="won", format=".0%"),
                alt.Tooltip("lost:Q", title="lost", format=".0%"),
            ],
        )
        .properties(width=size, height=size)
        .facet(column=alt.Column("side:N", title=None, header=alt.Header(labelFontWeight="bold")))
    )
    return chart


def master_chart(table: pd.DataFrame) -> alt.TopLevelMixin:
    """Return the curves of ``master_table`` with their bands."""
    base = alt.Chart(table).encode(
        x=alt.X("generation:Q", title="generation", axis=alt.Axis(tickMinStep=1)), color=alt.Color("side:N", title=None)
    )
    band = base.mark_area(opacity=0.18).encode(
        y=alt.Y("low:Q", title="games won against all generations", axis=alt.Axis(format=".0%")), y2="high:Q"
    )
    chart: alt.TopLevelMixin = (band + base.mark_line().encode(y="share:Q")).properties(width=460, height=240)
    return chart


def against_chart(table: pd.DataFrame) -> alt.TopLevelMixin:
    """Return the curves of ``against_table``, a panel a side."""
    base = alt.Chart(table).encode(
        x=alt.X("generation:Q", title="generation", axis=alt.Axis(tickMinStep=1)),
        color=alt.Color("outsider:N", title="against"),
    )
    band = base.mark_area(opacity=0.12).encode(
        y=alt.Y("low:Q", title="games won", axis=alt.Axis(format=".0%")), y2="high:Q"
    )
    chart: alt.TopLevelMixin = (
        (band + base.mark_line().encode(y="share:Q"))
        .properties(width=320, height=220)
        .facet(column=alt.Column("side:N", title=None, header=alt.Header(labelFontWeight="bold")))
    )
    return chart


def ratings_chart(table: pd.DataFrame, sides: dict[int, str]) -> alt.TopLevelMixin:
    """Return the curves of ``Ratings.table`` with their bands.

    Args:
        table: of ``rate``.
        sides: a name for each team.
    """
    named = table.assign(side=table["team"].map(sides))
    base = alt.Chart(named).encode(
        x=alt.X("generation:Q", title="generation", axis=alt.Axis(tickMinStep=1)), color=alt.Color("side:N", title=None)
    )
    band = base.mark_area(opacity=0.18).encode(y=alt.Y("low:Q", title="rating [points]"), y2="high:Q")
    chart: alt.TopLevelMixin = (band + base.mark_line().encode(y="rating:Q")).properties(width=460, height=240)
    return chart


def cross_chart(table: pd.DataFrame) -> alt.TopLevelMixin:
    """Return the matrices of ``analysis.tournament.cross_play``, a panel a side."""
    runs = len(table["run"].unique())
    size = max(140, min(_CELLS, 26 * runs))
    order = list(dict.fromkeys(table["run"]))
    chart: alt.TopLevelMixin = (
        alt.Chart(table)
        .mark_rect()
        .encode(
            x=alt.X("met:O", title="met", sort=list(dict.fromkeys(table["met"]))),
            y=alt.Y("run:O", title=None, sort=order),
            color=alt.Color(
                "share:Q",
                title="games won",
                scale=alt.Scale(scheme="viridis", domain=[0.0, 1.0]),
                legend=alt.Legend(format=".0%", type="gradient"),
            ),
            tooltip=["side:N", "run:N", "met:N", alt.Tooltip("share:Q", title="won", format=".0%")],
        )
        .properties(width=size, height=size)
        .facet(column=alt.Column("side:N", title=None, header=alt.Header(labelFontWeight="bold")))
    )
    return chart
