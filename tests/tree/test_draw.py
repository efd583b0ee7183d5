"""Drawings of trees: well formed, with every node and every branch."""

from __future__ import annotations

import re
from collections import Counter
from itertools import pairwise
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from coevo.tree import Tree, parse
from coevo.tree.draw import as_dot, as_svg, as_text

trees = st.from_type(Tree)
SVG = "{http://www.w3.org/2000/svg}"
EXAMPLE = parse("IF_ball_is_left(shoot, IF_opponent_goal_is_lost(search, avoid))")
STEPS = np.array([200, 50, 150, 150, 0])


def labels(tree):
    return [
        name[3:].replace("_is_", " is ").replace("_", " ") + "?" if name.startswith("IF_") else name
        for name in tree.names
    ]


def edges(tree):
    return {
        (node, child, answer)
        for node, second in enumerate(tree.second)
        for child, answer in ((node + 1, "yes"), (second, "no"))
        if second
    }


@given(tree=trees)
def test_text_has_a_line_a_node_indented_by_depth(tree):
    lines = as_text(tree).split("\n")
    assert len(lines) == tree.nodes
    answer = {child: f"{answer}: " for _, child, answer in edges(tree)}
    for node, (line, label, depth) in enumerate(zip(lines, labels(tree), tree.depths, strict=True)):
        assert line == "  " * depth + answer.get(node, "") + label


@given(tree=trees)
def test_dot_holds_every_node_and_every_branch(tree):
    dot = as_dot(tree)
    assert dot.startswith("digraph tree {\n")
    assert dot.endswith("\n}")
    named = re.findall(r'^  n(\d+) \[label="([^"]*)"', dot, re.MULTILINE)
    assert [(int(node), label) for node, label in named] == list(enumerate(labels(tree)))
    drawn = re.findall(r'^  n(\d+) -> n(\d+) \[label="(yes|no)"\];$', dot, re.MULTILINE)
    assert {(int(a), int(b), answer) for a, b, answer in drawn} == edges(tree)
    assert len(drawn) == tree.nodes - 1


@given(tree=trees)
def test_svg_is_xml_with_every_node_and_every_branch_inside_the_picture(tree):
    root = ET.fromstring(as_svg(tree))  # noqa: S314 - made here
    texts = list(root.iter(f"{SVG}text"))
    assert Counter(text.text for text in texts if text.get("font-size") is None) == Counter(labels(tree))
    assert Counter(text.text for text in texts if text.get("font-size")) == Counter(
        answer for _, _, answer in edges(tree)
    )
    assert len(list(root.iter(f"{SVG}path"))) == tree.nodes - 1
    width, height = float(root.get("width")), float(root.get("height"))
    boxes = [
        tuple(float(box.get(name)) for name in ("x", "y", "width", "height"))
        for box in root.iter(f"{SVG}rect")
        if box.get("width") != "100%"
    ]
    assert len(boxes) == tree.nodes
    for x, y, across, down in boxes:
        assert x >= 0.0
        assert y >= 0.0
        assert x + across <= width + 1.0  # the picture's size is rounded to whole pixels
        assert y + down <= height + 1.0


@given(tree=trees)
@example(tree=parse("IF_ball_is_left(shoot, IF_opponent_goal_is_left(shoot, shoot))"))
def test_boxes_of_one_row_of_an_svg_do_not_overlap(tree):
    root = ET.fromstring(as_svg(tree))  # noqa: S314 - made here
    rows: dict[str, list[tuple[float, float]]] = {}
    for box in root.iter(f"{SVG}rect"):
        if box.get("width") != "100%":
            rows.setdefault(box.get("y"), []).append((float(box.get("x")), float(box.get("width"))))
    for row in rows.values():
        row.sort()
        for (x, width), (following, _) in pairwise(row):
            assert x + width <= following + 0.2  # coordinates are rounded to tenths


def test_shares_of_steps_are_shown_at_every_node():
    shares = ["100.0%", "25.0%", "75.0%", "75.0%", "0.0%"]
    assert [line.split()[0] for line in as_text(EXAMPLE, STEPS).split("\n")] == shares
    assert re.findall(r"\\n([\d.]+%)", as_dot(EXAMPLE, STEPS)) == shares
    root = ET.fromstring(as_svg(EXAMPLE, STEPS))  # noqa: S314 - made here
    assert [text.text for text in root.iter(f"{SVG}text") if text.text.endswith("%")] == shares


def test_an_unused_branch_is_grey_and_thin_in_an_svg():
    root = ET.fromstring(as_svg(EXAMPLE, STEPS))  # noqa: S314 - made here
    lines = [(path.get("stroke"), float(path.get("stroke-width"))) for path in root.iter(f"{SVG}path")]
    # In the order of their upper nodes: shoot 25 %, the other question 75 %, search 75 %, avoid 0 %.
    assert [stroke for stroke, _ in lines] == ["#475569"] * 3 + ["#cbd5e1"]
    widths = [width for _, width in lines]
    assert widths[3] < widths[0] < widths[1] == pytest.approx(widths[2])


@pytest.mark.parametrize("draw", [as_text, as_dot, as_svg])
def test_a_tree_that_was_never_used_is_drawn_as_if_nothing_was_counted(draw):
    assert draw(EXAMPLE, np.zeros(5, np.int64)) == draw(EXAMPLE)
