"""Draw a tree: indented text, Graphviz' dot, or a picture in SVG. Branches may show how many steps passed them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle

from coevo.tree.fold import Part, Steps, fold_tree
from coevo.tree.nodes import Nodes
from coevo.tree.picture import svg_of
from coevo.tree.rules import question
from coevo.vocabulary import SKILLS

__all__ = ["TERMINAL_COLOURS", "as_dot", "as_svg", "as_text", "percent", "terminal_colours"]

# Of terminals, in pictures of trees and of games: apart for any eye, light enough for dark letters, and used again
# when there are more.
TERMINAL_COLOURS = ("#e8641b", "#56b4e9", "#f0e442", "#a6a6a6", "#cc79a7", "#2fb58c", "#d2b48c", "#b39ddb")


def terminal_colours(terminals: Iterable[str]) -> dict[str, str]:
    """Return a colour for each terminal, by its place among them."""
    return dict(zip(terminals, cycle(TERMINAL_COLOURS), strict=False))


def _colours(tree: Nodes, terminals: Sequence[str]) -> dict[str, str]:
    there = [name for name, second in zip(tree.names, tree.second, strict=True) if not second]
    return terminal_colours(dict.fromkeys([*terminals, *there]))


def _label(part: Part) -> str:
    """Return what a part is, in a few words."""
    if part.kind == "unused":
        return f"never used: {part.nodes} nodes"
    if part.kind == "same":
        return f"always {part.name}: {part.nodes} nodes"
    if part.kind == "rare":
        used = ", ".join(f"{name} {percent(steps / (part.steps or 1), 0)}" for name, steps in part.use[:2])
        return f"rarely used, {part.nodes} nodes: {used}{', ...' if len(part.use) > 2 else ''}"
    return question(part.name)


def percent(share: float, digits: int = 1) -> str:
    """Return a share in per cent; what is there is never told as nothing, nor what lacks a little as all."""
    text, least = f"{share:.{digits}%}", 10.0 ** -(digits + 2)
    if share > 0.0 and text == f"{0.0:.{digits}%}":
        return f"<{least:.{digits}%}"
    if share < 1.0 and text == f"{1.0:.{digits}%}":
        return f">{1.0 - least:.{digits}%}"
    return text


def _share(part: Part, parts: Sequence[Part]) -> float | None:
    return None if part.steps is None else part.steps / (parts[0].steps or 1)


def as_text(tree: Nodes, steps: Steps | None = None, *, fold: float | None = None) -> str:
    """Return a line for each node or folded branch, indented by depth.

    Args:
        tree: any tree.
        steps: (nodes,) how often each node was passed.
        fold: branches below this share of all steps are one line, as are those whose questions never mattered; None
            shows all nodes.

    Example:
        >>> from coevo.tree import parse
        >>> from coevo.tree.draw import as_text
        >>> print(as_text(parse("IF_ball_is_lost(search, IF_r1_is_left(pass, shoot))"), [10, 4, 6, 0, 6], fold=0.0))
         100.0%  ball is lost?
          40.0%    yes: search
          60.0%    no: always shoot: 3 nodes
    """
    parts = fold_tree(tree, steps, fold)
    lines = []
    for part in parts:
        share = _share(part, parts)
        use = "" if share is None else f"{percent(share):>7}  "
        answer = f"{part.answer}: " if part.answer else ""
        lines.append(f"{use}{'  ' * part.depth}{answer}{_label(part)}")
    return "\n".join(lines)


def as_dot(
    tree: Nodes, steps: Steps | None = None, *, fold: float | None = None, terminals: Sequence[str] = SKILLS
) -> str:
    """Return the tree for Graphviz; see ``as_text``, and ``as_svg`` for ``terminals``."""
    colours = _colours(tree, terminals)
    parts = fold_tree(tree, steps, fold)
    lines = [
        "digraph tree {",
        '  node [shape=box, style="rounded,filled", fillcolor=white, fontname="sans-serif"];',
    ]
    for part in parts:
        share = _share(part, parts)
        use = "" if share is None else f"\\n{percent(share)}"
        look = ', color="#94a3b8", fontcolor="#64748b"' if part.steps == 0 else ""
        if part.kind in ("terminal", "same") and part.steps != 0:
            look = f', fillcolor="{colours[part.name]}"'
        lines.append(f'  n{part.node} [label="{_label(part)}{use}"{look}];')
        if part.parent >= 0:
            wide = "" if share is None else f", penwidth={1.0 + 5.0 * share:.2f}"
            lines.append(f'  n{parts[part.parent].node} -> n{part.node} [label="{part.answer}"{wide}];')
    return "\n".join([*lines, "}"])


def as_svg(
    tree: Nodes,
    steps: Steps | None = None,
    *,
    fold: float | None = None,
    terminals: Sequence[str] = SKILLS,
    title: str = "",
    descriptions: Mapping[str, str] | None = None,
) -> str:
    """Return the tree as an SVG picture, read from the top like a text; see ``coevo.tree.picture``.

    Args:
        tree: any tree.
        steps: (nodes,) how often each node was passed; wider lines carried more steps, dashed ones none.
        fold: as of ``as_text``.
        terminals: a terminal's place among these is its colour.
        title: stands above the picture, and is what a screen reader says first.
        descriptions: what terminals do, as of ``FunctionSet.descriptions``; stands below.
    """
    parts = fold_tree(tree, steps, fold)
    labels = [_label(part) for part in parts]
    found = [_share(part, parts) for part in parts]
    shares = None if found[0] is None else [share or 0.0 for share in found]
    told = None if shares is None else [percent(share) for share in shares]
    colours = _colours(tree, terminals)
    return svg_of(parts, labels, shares, told, colours, title or "A tree", tree.nodes, descriptions or {})
