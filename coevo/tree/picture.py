"""A tree as an SVG picture that is read from the top, a row a node, so that it is as wide as a page or a phone.

An answer that is a terminal or a folded branch stands under its question, one step to the right. Of two answers that
ask on, "yes" does so too, and "no" comes straight below; where only one asks on, that one comes straight below. So a
chain of questions, however long, stays a column.
"""

from __future__ import annotations

import hashlib
import html
import textwrap
from collections.abc import Mapping, Sequence

from coevo.tree.fold import Part

__all__ = ["svg_of"]

_ROW, _BOX, _INDENT = 25.0, 20.0, 22.0  # px: height of a row, of a box in it, and width of a step to the right
_MARGIN, _HEAD = 14.0, 48.0
_LETTER, _SMALL = 7.2, 6.2  # px, the widest usual sans-serif's mean letter at 13 and at 11 px
_SMALL_ROW, _WORDS = 16.0, 52  # px between the lines of a legend, and letters of one
_TRUNK = 10.0  # px from a box's left edge to the line that leaves it downwards
_INK, _QUIET, _LINE, _FAINT, _PAPER = "#0f172a", "#57606f", "#64748b", "#94a3b8", "#ffffff"


def svg_of(
    parts: Sequence[Part],
    labels: Sequence[str],
    shares: Sequence[float] | None,
    told: Sequence[str] | None,
    colours: Mapping[str, str],
    title: str,
    nodes: int,
    descriptions: Mapping[str, str],
) -> str:
    """Return a picture of the parts of a tree.

    Args:
        parts: of ``coevo.tree.fold.fold_tree``.
        labels: what stands in each one's box.
        shares: of the steps that passed each; None draws all lines alike.
        told: the same in words.
        colours: of terminals.
        title: of the picture.
        nodes: how many the tree has.
        descriptions: what terminals do; stands below the tree, of those that are in it.
    """
    rows = _rows(parts)
    place = {part: row for row, (part, _) in enumerate(rows)}
    xs = {part: _MARGIN + level * _INDENT for part, level in rows}
    ys = {part: _HEAD + _ROW * row for part, row in place.items()}
    subtitle = _subtitle(parts, nodes, counted=shares is not None)
    wide = max(_MARGIN + _LETTER * 1.1 * len(title), _MARGIN + _SMALL * len(subtitle))
    below = [part for part, _ in reversed(rows) if parts[part].parent >= 0]
    if shares is not None:
        below.sort(key=lambda part: shares[part])  # where lines share a way, the wider one lies on top
    lines = [_line(parts[part].parent, part, xs, ys, None if shares is None else shares[part]) for part in below]
    boxes = []
    for part, _ in rows:
        words = None if told is None else told[part]
        box, right = _box(parts[part], labels[part], words, colours, (xs[part], ys[part]))
        boxes.append(box)
        wide = max(wide, right)
    bottom = _HEAD + _ROW * len(rows)
    there = {name: descriptions[name] for name in colours if name in descriptions and _is_in(name, parts)}
    legend, right, end = _legend(there, colours, bottom + 0.5 * _ROW)
    width, height = max(wide, right) + _MARGIN, (end if there else bottom - (_ROW - _BOX)) + _MARGIN
    said = html.escape(title)
    about = html.escape(f"{subtitle} {_outcome(parts, labels, told)}")
    # Several pictures may stand on one page, where a name may stand once.
    name = hashlib.sha256("\n".join([title, *boxes]).encode()).hexdigest()[:12]
    head = [
        (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}"'
            f' viewBox="0 0 {width:.0f} {height:.0f}" style="max-width:100%;height:auto" role="img"'
            f' aria-labelledby="title-{name} about-{name}">'
            f'<title id="title-{name}">{said}</title><desc id="about-{name}">{about}</desc>'
        ),
        f'<rect class="paper" width="100%" height="100%" rx="8" fill="{_PAPER}"/>',
        f'<g font-family="Helvetica, Arial, sans-serif" font-size="13" fill="{_INK}">',
        f'<text class="title" x="{_MARGIN}" y="20" font-weight="bold">{said}</text>',
        (f'<text class="subtitle" x="{_MARGIN}" y="37" font-size="11" fill="{_QUIET}">{html.escape(subtitle)}</text>'),
    ]
    return "\n".join([*head, *lines, *boxes, *legend, "</g></svg>"])


def _is_in(terminal: str, parts: Sequence[Part]) -> bool:
    return any(terminal == part.name or terminal in dict(part.use) for part in parts)


def _legend(descriptions: Mapping[str, str], colours: Mapping[str, str], y: float) -> tuple[list[str], float, float]:
    """Return what terminals do, a colour and a few lines each from ``y`` on, and where that ends, right and below."""
    entries, right = [], 0.0
    x = _MARGIN + _INDENT
    for name, words in descriptions.items():
        first, *more = textwrap.wrap(f"{name}: {words}", _WORDS)
        rest = "".join(f'<tspan x="{x:.1f}" dy="{_SMALL_ROW}">{html.escape(line)}</tspan>' for line in more)
        entries.append(
            f'<circle cx="{_MARGIN + _TRUNK:.1f}" cy="{y:.1f}" r="6" fill="{colours[name]}"/>'
            f'<text class="legend" x="{x:.1f}" y="{y + 4.0:.1f}" font-size="11" fill="{_QUIET}">'
            f"{html.escape(first)}{rest}</text>"
        )
        right = max(right, x + _SMALL * max(len(line) for line in (first, *more)))
        y += _SMALL_ROW * (len(more) + 1)
    return entries, right, y


def _subtitle(parts: Sequence[Part], nodes: int, *, counted: bool) -> str:
    shown = f"{nodes} nodes" if len(parts) == nodes else f"{nodes} nodes in {len(parts)} rows"
    return f"{shown}; wider lines and per cent: how often it went there" if counted else shown


def _outcome(parts: Sequence[Part], labels: Sequence[str], told: Sequence[str] | None) -> str:
    """Return for screen readers what the ends of the tree are, those that were used most first."""
    ends = [number for number, part in enumerate(parts) if part.kind != "question" and part.steps != 0]
    ends.sort(key=lambda number: -(parts[number].steps or 0))
    if told is None:
        return f"It ends in: {', '.join(dict.fromkeys(labels[number] for number in ends))}."
    some = [f"{labels[number]} ({told[number]})" for number in ends[:12]]
    more = f", and {len(ends) - 12} more" if len(ends) > 12 else ""
    return f"Its ends, by use: {'; '.join(some)}{more}."


def _rows(parts: Sequence[Part]) -> list[tuple[int, int]]:
    """Return the parts in the order of their rows, each with how many steps to the right it stands."""
    children: list[list[int]] = [[] for _ in parts]
    for number, part in enumerate(parts):
        if part.parent >= 0:
            children[part.parent].append(number)
    rows = []
    stack = [(0, 0)]
    while stack:
        number, level = stack.pop()
        rows.append((number, level))
        if children[number]:
            yes, no = children[number]
            if children[yes] and not children[no]:
                stack += [(yes, level), (no, level + 1)]
            else:
                stack += [(no, level if children[no] else level + 1), (yes, level + 1)]
    return rows


def _line(parent: int, part: int, xs: Mapping[int, float], ys: Mapping[int, float], share: float | None) -> str:
    """Return the way from a question down to one of its answers."""
    x, top, middle = xs[parent] + _TRUNK, ys[parent] + _BOX, ys[part] + 0.5 * _BOX
    way = (
        f"M{x:.1f} {top:.1f} V{ys[part]:.1f}"
        if xs[part] == xs[parent]
        else f"M{x:.1f} {top:.1f} V{middle - 6.0:.1f} q0 6 6 6 H{xs[part]:.1f}"
    )
    wide = 1.5 if share is None else 1.2 + 8.0 * share
    look = f'stroke="{_FAINT}" stroke-dasharray="3 3"' if share == 0.0 else f'stroke="{_LINE}"'
    return f'<path d="{way}" fill="none" {look} stroke-width="{wide:.2f}"/>'


def _box(
    part: Part, label: str, told: str | None, colours: Mapping[str, str], at: tuple[float, float]
) -> tuple[str, float]:
    """Return the box of a part with what stands in and beside it, and where it ends on the right."""
    x, y = at
    answer = f'<tspan fill="{_QUIET}" font-size="11">{part.answer}</tspan> ' if part.answer else ""
    long = _LETTER * len(label) + (_SMALL * (len(part.answer) + 1) if part.answer else 0.0) + 16.0
    fill, edge, ink, dashes = _PAPER, _LINE, _INK, ""
    if part.steps == 0:
        edge, ink, dashes = _FAINT, _QUIET, ' stroke-dasharray="3 3"'
    elif part.kind in ("terminal", "same"):
        fill = edge = colours[part.name]
        answer = answer.replace(_QUIET, _INK)
    elif part.kind == "rare":
        dashes = ' stroke-dasharray="3 3"'
    radius = 4 if part.kind == "question" else 10
    right = x + long
    box = (
        f'<rect class="{part.kind}" x="{x:.1f}" y="{y:.1f}" width="{long:.1f}" height="{_BOX:.0f}" rx="{radius}"'
        f' fill="{fill}" stroke="{edge}"{dashes}/>'
        f'<text class="label" x="{x + 8.0:.1f}" y="{y + 14.5:.1f}" fill="{ink}">{answer}{html.escape(label)}</text>'
    )
    if told is not None:
        box += (
            f'<text class="share" x="{right + 6.0:.1f}" y="{y + 14.0:.1f}" font-size="11" fill="{_QUIET}">'
            f"{html.escape(told)}</text>"
        )
        right += 6.0 + _SMALL * len(told)
    return box, right
