"""The tables behind the pictures of an ancestry: who handed down what, and when nodes came into being."""

from __future__ import annotations

import pandas as pd

from analysis.ancestry.inheritance import Ancestry

__all__ = ["USE", "family_table", "link_table", "origin_table"]

USE = ("in use", "never used", "not counted")

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
        first, last = chain[-1][0], child[0]  # the line that leads on to the child is drawn up to there
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


def link_table(family: pd.DataFrame) -> pd.DataFrame:
    """Return who handed something down to whom, of a ``family_table``, a row each.

    Returns:
        ``generation, index, lane`` of the child and, ending in ``_parent``, of the parent; ``came``, how many of the
        champion's nodes; and ``is_root``, whether it is a step of the root line, where nothing need have come.
    """
    links = pd.concat([_links(family, 1), _links(family, 2)], ignore_index=True)
    ends = ["generation", "index", "lane"]
    return links[[*ends, *(f"{name}_parent" for name in ends), "came", "is_root"]]


def _links(table: pd.DataFrame, which: int) -> pd.DataFrame:
    """Return the links to these parents, with more columns."""
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


def origin_table(ancestry: Ancestry) -> pd.DataFrame:
    """Return how many of a champion's nodes came into being when: ``generation, operator, use, nodes``.

    ``use`` is ``in use``, ``never used``, or ``not counted`` where that is not known.
    """
    steps = ancestry.nodes["steps"]
    use = steps.gt(0).map({True: USE[0], False: USE[1]}).where(steps.notna(), USE[2])
    counted = ancestry.nodes.assign(use=use).groupby(["generation", "operator", "use"]).size()
    return counted.rename("nodes").reset_index()
