"""The ancestry of a champion as pictures: who handed down what, and when its nodes came into being."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pandas as pd

from analysis.ancestry.inheritance import Ancestry
from analysis.charts import COLOURS, altair
from coevo.records import OPERATORS

if TYPE_CHECKING:
    import altair as alt

__all__ = ["ancestry_chart", "family_chart", "family_table", "origin_chart", "origin_table"]

_COLOUR = dict(zip(OPERATORS, (COLOURS[2], "#5f5f5f", "#c0c0c0", COLOURS[0], COLOURS[1]), strict=True))
_FAINT = {"creation": "#a6dccb", "mutation": "#f1c6a5"}
_WIDTH = 760
_LANE = 24  # pixels from lane to lane
_USE = ("in use", "never used", "not counted")


_Member = tuple[int, int]  # generation and index


def _chains(table: pd.DataFrame) -> list[list[_Member]]:
    """Cut the family into chains from child to parent, the root line first; none is in two of them.

    But for the root line, a chain begins with whom it leads to, who is in another.
    """
    rows = {(row["generation"], row["index"]): row for row in table.to_dict("records")}

    def givers(member: _Member) -> list[_Member]:
        row = rows[member]
        return [(member[0] - 1, int(row[f"parent_{which}"])) for which in (1, 2) if row[f"from_{which}"]]

    line = table[table["root_line"]].sort_values("generation", ascending=False)
    chains = [[(int(g), int(i)) for g, i in zip(line["generation"], line["index"], strict=True)]]
    placed = set(chains[0])
    waiting = [(member, giver) for member in chains[0] for giver in givers(member)]
    while waiting:
        child, member = waiting.pop(0)
        chain = [child]
        while member not in placed:
            placed.add(member)
            chain.append(member)
            before = givers(member)
            if not before:
                break
            waiting += [(member, giver) for giver in before[1:]]
            member = before[0]
        if len(chain) > 1:
            chains.append(chain)
    return chains


def family_table(ancestry: Ancestry) -> pd.DataFrame:
    """Return the ancestors of which something is left in the champion, and those of its root line, with their places.

    Returns:
        The columns of ``Ancestry.ancestors``; ``share``, of the champion's nodes that each carried; and ``lane``: 0 for
        the root line, and for each other line of descent one that is free as long as it lasts, near whom it leads to.
    """
    table = ancestry.ancestors
    table = table[(table["carried"] > 0) | table["root_line"]].reset_index(drop=True)
    root, *others = _chains(table)
    lanes = dict.fromkeys(root, 0)
    taken: list[list[tuple[int, int]]] = []  # of each other lane the generations, first and last, that are drawn in it
    for child, *chain in others:
        first, last = chain[-1][0] - 1, child[0]  # with the lines that lead into it and out of it
        free = [n for n, spans in enumerate(taken) if all(last <= a or b <= first for a, b in spans)]
        if not free:
            free = [len(taken)]
            taken.append([])
        lane = min(free, key=lambda n: (abs(n + 1 - lanes[child]), n))
        taken[lane].append((first, last))
        lanes |= dict.fromkeys(chain, lane + 1)
    return table.assign(
        share=table["carried"] / len(ancestry.nodes),
        lane=[lanes[member] for member in zip(table["generation"], table["index"], strict=True)],
    )


def _links(table: pd.DataFrame, which: int) -> pd.DataFrame:
    """Return a line for each of these parents that something came from, with both its ends."""
    ends = table[["generation", "index", "lane", "root_line"]].add_suffix("_parent")
    children = table[(table[f"from_{which}"] > 0) | (table["root_line"] & (which == 1))]
    children = children.assign(generation_parent=children["generation"] - 1)
    return children.merge(
        ends,
        left_on=["generation_parent", f"parent_{which}"],
        right_on=["generation_parent", "index_parent"],
    ).assign(
        is_root=lambda of: of["root_line"] & of["root_line_parent"] & (which == 1),
        came=lambda of: of[f"from_{which}"],
    )


def _title(ancestry: Ancestry, what: str, subtitle: str) -> Any:
    whose = f"{ancestry.robot}'s individual {ancestry.index} of generation {ancestry.generation}"
    return altair().Title(f"{what} {whose}", subtitle=subtitle, subtitleColor="#666666", frame="group", offset=8)


def _generations(ancestry: Ancestry, title: str) -> Any:
    alt, last = altair(), ancestry.generation
    axis = alt.Axis(grid=False, tickMinStep=1, format="d", tickCount=min(last + 1, 12))
    scale = alt.Scale(domain=[-0.5, last + 0.5], nice=False, padding=0)
    return alt.X("generation:Q", title=title, scale=scale, axis=axis)


def family_chart(ancestry: Ancestry) -> alt.LayerChart:
    """Return the picture of a family: generations from left to right, the root line on top.

    Ancestors of which nothing is left in the champion are left out.
    """
    alt = altair()
    table = family_table(ancestry)
    links = pd.concat([_links(table, 1), _links(table, 2)], ignore_index=True)
    lanes = int(table["lane"].max()) + 1
    x = _generations(ancestry, "generation")
    y = alt.Y("lane:Q", axis=None, scale=alt.Scale(domain=[lanes - 0.5, -0.6], nice=False))
    rules = (
        alt.Chart(links)
        .mark_rule(strokeCap="round")
        .encode(
            x=x,
            y=y,
            x2="generation_parent:Q",
            y2="lane_parent:Q",
            color=alt.condition("datum.is_root", alt.value("#333333"), alt.value("#aaaaaa")),
            strokeWidth=alt.condition("datum.is_root", alt.value(4), alt.value(1.2)),
            tooltip=["generation", "index", "index_parent", alt.Tooltip("came", title="nodes that came")],
        )
    )
    points = (
        alt.Chart(table)
        .mark_circle(opacity=1.0, stroke="white", strokeWidth=0.6)
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
                scale=alt.Scale(domain=[0, 1], range=[14, 100]),
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


def origin_table(ancestry: Ancestry) -> pd.DataFrame:
    """Return how many of a champion's nodes came into being when: ``generation, operator, use, nodes``.

    ``use`` is ``in use``, ``never used``, or ``not counted`` where that is not known.
    """
    steps = ancestry.nodes["steps"]
    use = steps.gt(0).map({True: _USE[0], False: _USE[1]}).where(steps.notna(), _USE[2])
    counted = ancestry.nodes.assign(use=use).groupby(["generation", "operator", "use"]).size()
    return counted.rename("nodes").reset_index()


def origin_chart(ancestry: Ancestry) -> alt.LayerChart:
    """Return how many of a champion's nodes came into being in which generation."""
    alt = altair()
    table = origin_table(ancestry)
    table["kind"] = table["operator"] + ", " + table["use"]
    totals = table.groupby("generation", as_index=False)["nodes"].sum()
    kinds = [f"{operator}, {use}" for operator in ("creation", "mutation") for use in _USE]
    shades = [shade for name in ("creation", "mutation") for shade in (_COLOUR[name], _FAINT[name], _COLOUR[name])]
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
                legend=alt.Legend(symbolType="square", symbolStrokeWidth=0, symbolOpacity=1, orient="bottom"),
            ),
            order=alt.Order("kind:N"),
            tooltip=["generation", "operator", "use", "nodes"],
        )
    )
    numbers = alt.Chart(totals).mark_text(dy=-7, fontSize=11, color="#444444").encode(x=x, y="nodes:Q", text="nodes:Q")
    chart: alt.LayerChart = (bars + numbers).properties(
        width=_WIDTH,
        height=110,
        title=_title(ancestry, "Age of the nodes of", "How many came into being in which generation."),
    )
    return chart


def ancestry_chart(ancestry: Ancestry) -> alt.VConcatChart:
    """Return both pictures of an ancestry, one above the other."""
    both = altair().vconcat(family_chart(ancestry), origin_chart(ancestry))
    chart: alt.VConcatChart = both.resolve_scale(color="independent", size="independent")
    return chart
