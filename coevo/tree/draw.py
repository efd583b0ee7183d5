"""Draw a tree: indented text, Graphviz' dot, or a picture in SVG. Branches may show how many steps passed them."""

from __future__ import annotations

import html
from collections.abc import Sequence
from itertools import cycle

import numpy as np
from numpy.typing import NDArray

from coevo.tree.text import Tree
from coevo.vocabulary import SKILLS, in_words

__all__ = ["as_dot", "as_svg", "as_text"]

# Of terminals, dark enough to be read and apart for any eye, and used again when there are more.
_COLOURS = ("#c2410c", "#1d4ed8", "#7c3aed", "#047857", "#a16207", "#0e7490", "#be185d", "#525252")
_QUESTION = "#0f172a"
_CELL_X, _CELL_Y, _BOX_H = 15.0, 58.0, 22.0


def _colours(tree: Tree, terminals: Sequence[str]) -> dict[str, str]:
    """Return a colour for each terminal of a tree: by its place among ``terminals``, then as they come."""
    there = [name for name, second in zip(tree.names, tree.second, strict=True) if not second]
    return dict(zip(dict.fromkeys([*terminals, *there]), cycle(_COLOURS), strict=False))


def _share(steps: Sequence[int] | NDArray[np.int64] | None, node: int) -> float | None:
    return None if steps is None or not steps[0] else float(steps[node]) / float(steps[0])


def as_text(tree: Tree, steps: Sequence[int] | NDArray[np.int64] | None = None) -> str:
    """Return a line a node, indented by depth; ``steps``: (nodes,) how often each was passed.

    Example:
        >>> from coevo.tree import parse
        >>> from coevo.tree.draw import as_text
        >>> print(as_text(parse("IF_ball_is_lost(search, shoot)"), [10, 4, 6]))
         100.0%  ball is lost?
          40.0%    yes: search
          60.0%    no: shoot
    """
    lines = []
    marks = _branches(tree)
    for node, (name, depth) in enumerate(zip(tree.names, tree.depths, strict=True)):
        share = _share(steps, node)
        use = "" if share is None else f"{share:7.1%}  "
        lines.append(f"{use}{'  ' * depth}{marks[node]}{in_words(name)}")
    return "\n".join(lines)


def _branches(tree: Tree) -> list[str]:
    marks = [""] * tree.nodes
    for node, second in enumerate(tree.second):
        if second:
            marks[node + 1], marks[second] = "yes: ", "no: "
    return marks


def as_dot(
    tree: Tree, steps: Sequence[int] | NDArray[np.int64] | None = None, *, terminals: Sequence[str] = SKILLS
) -> str:
    """Return the tree for Graphviz; a terminal's place among ``terminals`` is its colour."""
    colours = _colours(tree, terminals)
    lines = [
        "digraph tree {",
        '  node [shape=box, style="rounded,filled", fillcolor=white, fontname="sans-serif"];',
    ]
    for node, name in enumerate(tree.names):
        share = _share(steps, node)
        use = "" if share is None else f"\\n{share:.1%}"
        look = f', color="{colours[name]}", fontcolor="{colours[name]}"' if name in colours else ""
        lines.append(f'  n{node} [label="{in_words(name)}{use}"{look}];')
        if tree.second[node]:
            lines.append(f'  n{node} -> n{node + 1} [label="yes"];')
            lines.append(f'  n{node} -> n{tree.second[node]} [label="no"];')
    return "\n".join([*lines, "}"])


def _places(tree: Tree) -> list[float]:
    """Return where each node stands across, in columns: an IF in the middle of what its branches and its label need."""
    labels = [max(3.2, 0.62 * len(in_words(name)) + 1.2) for name in tree.names]
    widths = list(labels)
    for node in range(tree.nodes - 1, -1, -1):
        if tree.second[node]:
            widths[node] = max(labels[node], widths[node + 1] + widths[tree.second[node]])
    starts, places = [0.0] * tree.nodes, [0.0] * tree.nodes
    for node, second in enumerate(tree.second):
        places[node] = starts[node] + 0.5 * widths[node]
        if second:
            spare = 0.5 * (widths[node] - widths[node + 1] - widths[second])
            starts[node + 1] = starts[node] + spare
            starts[second] = starts[node + 1] + widths[node + 1]
    return places


def as_svg(
    tree: Tree, steps: Sequence[int] | NDArray[np.int64] | None = None, *, terminals: Sequence[str] = SKILLS
) -> str:
    """Return the tree as an SVG picture: "yes" to the left; wider lines carried more steps, grey ones none."""
    colours = _colours(tree, terminals)
    places, depths = _places(tree), tree.depths
    margin = 70.0
    xs = [margin + place * _CELL_X for place in places]
    ys = [30.0 + depth * _CELL_Y for depth in depths]
    width, height = max(xs) + margin, max(ys) + 40.0
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}">',
        '<g font-family="sans-serif" font-size="11">',
        f'<title>{html.escape(str(tree)[:200])}</title><rect width="100%" height="100%" fill="white"/>',
    ]
    for node, second in enumerate(tree.second):
        for child, answer in ((node + 1, "yes"), (second, "no")) if second else ():
            share = _share(steps, child)
            used = share is None or share > 0.0
            wide = 1.0 if share is None else 0.8 + 4.0 * share
            parts.append(
                f'<path d="M{xs[node]:.1f} {ys[node] + 11:.1f} L{xs[child]:.1f} {ys[child] - 11:.1f}" fill="none"'
                f' stroke="{"#475569" if used else "#cbd5e1"}" stroke-width="{wide:.2f}"/>'
            )
            x, y = 0.5 * (xs[node] + xs[child]), 0.5 * (ys[node] + ys[child])
            parts.append(
                f'<text x="{x + (-4 if answer == "yes" else 4):.1f}" y="{y:.1f}" fill="#64748b" font-size="9"'
                f' text-anchor="{"end" if answer == "yes" else "start"}">{answer}</text>'
            )
    for node, name in enumerate(tree.names):
        text, share = in_words(name), _share(steps, node)
        box = 6.4 * len(text) + 12.0
        unused = share is not None and share == 0.0
        colour = "#94a3b8" if unused else colours.get(name, _QUESTION)
        parts.append(
            f'<rect x="{xs[node] - box / 2:.1f}" y="{ys[node] - 11:.1f}" width="{box:.1f}" height="{_BOX_H}" rx="6"'
            f' fill="white" stroke="{colour}"/>'
            f'<text x="{xs[node]:.1f}" y="{ys[node] + 4:.1f}" text-anchor="middle" fill="{colour}">'
            f"{html.escape(text)}</text>"
        )
        if share is not None:
            parts.append(
                f'<text x="{xs[node]:.1f}" y="{ys[node] + 21:.1f}" text-anchor="middle" fill="#64748b" font-size="9">'
                f"{share:.1%}</text>"
            )
    return "\n".join([*parts, "</g></svg>"])
