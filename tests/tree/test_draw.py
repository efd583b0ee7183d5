"""Drawings of trees: well formed, with every node and every branch, readable however large the tree is."""

from __future__ import annotations

import re
from collections import Counter
from itertools import pairwise
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from coevo.tree import FunctionSet, Tree, parse, simplify
from coevo.tree.draw import TERMINAL_COLOURS, as_dot, as_svg, as_text, percent, terminal_colours
from coevo.tree.fold import fold_tree

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


def drawn(svg):
    """Return the picture, and of each part of it its box as numbers, its answer and its label."""
    root = ET.fromstring(svg)  # noqa: S314 - made here
    boxes = [
        tuple(float(box.get(name)) for name in ("x", "y", "width", "height"))
        for box in root.iter(f"{SVG}rect")
        if box.get("class") != "paper"
    ]
    texts = [text for text in root.iter(f"{SVG}text") if text.get("class") == "label"]
    said = []
    for text in texts:
        answer = text.find(f"{SVG}tspan")
        said.append(("", text.text) if answer is None else (answer.text, answer.tail.strip()))
    return root, boxes, said


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
    found = re.findall(r'^  n(\d+) -> n(\d+) \[label="(yes|no)"\];$', dot, re.MULTILINE)
    assert {(int(a), int(b), answer) for a, b, answer in found} == edges(tree)
    assert len(found) == tree.nodes - 1


@given(tree=trees)
def test_svg_is_xml_with_every_node_and_every_branch_inside_the_picture(tree):
    root, boxes, said = drawn(as_svg(tree))
    answer = {child: answer for _, child, answer in edges(tree)}
    assert Counter(said) == Counter((answer.get(node, ""), label) for node, label in enumerate(labels(tree)))
    assert len(list(root.iter(f"{SVG}path"))) == tree.nodes - 1
    width, height = float(root.get("width")), float(root.get("height"))
    assert root.get("viewBox") == f"0 0 {width:.0f} {height:.0f}"
    assert len(boxes) == tree.nodes
    for x, y, across, down in boxes:
        assert x >= 0.0
        assert y >= 0.0
        assert x + across <= width
        assert y + down <= height


@given(tree=trees)
@example(tree=parse("IF_ball_is_left(shoot, IF_opponent_goal_is_left(shoot, shoot))"))
def test_boxes_of_an_svg_stand_one_below_the_other(tree):
    _, boxes, _ = drawn(as_svg(tree))
    for (_, above, _, high), (_, below, _, _) in pairwise(boxes):
        assert above + high < below


def ways(svg):
    """Return for each line of a picture the box that it leaves and the one that it comes to."""
    root, boxes, said = drawn(svg)
    found = set()
    for path in root.iter(f"{SVG}path"):
        x, top, *way = (float(number) for number in re.findall(r"[\d.]+", path.get("d").replace("q0 6 6 6", "")))
        (source,) = [n for n, (left, y, wide, high) in enumerate(boxes) if y + high == top and left < x < left + wide]
        if len(way) == 1:  # straight down into a box
            (target,) = [n for n, (left, y, _, _) in enumerate(boxes) if y == way[0] and left < x]
        else:  # down and to the right
            (target,) = [
                n for n, (left, y, _, high) in enumerate(boxes) if y + high / 2 == way[0] + 6 and left == way[1]
            ]
        found.add((said[source][1], *said[target]))
        # What else it passes stands to the right of it.
        assert all(left > x for left, _, _, _ in boxes[source + 1 : target])
    return found


@given(tree=trees)
def test_lines_lead_from_each_question_to_its_answers_and_through_no_other_box(tree):
    expected = {(labels(tree)[a], answer, labels(tree)[b]) for a, b, answer in edges(tree)}
    assert ways(as_svg(tree)) == expected


def test_a_picture_speaks_to_a_screen_reader_and_brings_its_own_background():
    first, second = as_svg(EXAMPLE, STEPS, title="r0 <last> & best"), as_svg(EXAMPLE, title="r0")
    root, _, _ = drawn(first)
    title, about, paper = root[0], root[1], root[2]
    assert (root.get("role"), root.get("aria-labelledby")) == ("img", f"{title.get('id')} {about.get('id')}")
    assert (title.tag, title.text) == (f"{SVG}title", "r0 <last> & best")
    assert (about.tag, "5 nodes" in about.text) == (f"{SVG}desc", True)
    assert "search (75.0%); shoot (25.0%)" in about.text
    assert (paper.get("width"), paper.get("height"), paper.get("fill")) == ("100%", "100%", "#ffffff")
    names = [re.findall(r' id="([^"]+)"', picture) for picture in (first, second)]
    assert len({*names[0], *names[1]}) == 4  # both may stand on one page


def test_shares_of_steps_are_shown_at_every_node():
    shares = ["100.0%", "25.0%", "75.0%", "75.0%", "0.0%"]
    assert [line.split()[0] for line in as_text(EXAMPLE, STEPS).split("\n")] == shares
    assert re.findall(r"\\n([\d.]+%)", as_dot(EXAMPLE, STEPS)) == shares
    root, _, _ = drawn(as_svg(EXAMPLE, STEPS))
    assert [text.text for text in root.iter(f"{SVG}text") if text.get("class") == "share"] == shares


def test_lines_are_as_wide_as_they_were_used_and_dashed_where_nobody_went():
    root, _, _ = drawn(as_svg(EXAMPLE, STEPS))
    lines = {
        (float(path.get("stroke-width")), path.get("stroke-dasharray") is None) for path in root.iter(f"{SVG}path")
    }
    ordered = sorted(lines)
    # avoid 0 %, shoot 25 %, the other question and search 75 %.
    assert [full for _, full in ordered] == [False, True, True]
    assert ordered[2][0] - ordered[1][0] == pytest.approx(2 * (ordered[1][0] - ordered[0][0]), abs=0.02)


@pytest.mark.parametrize("draw", [as_text, as_dot, as_svg])
def test_a_tree_that_was_never_used_is_drawn_as_if_nothing_was_counted(draw):
    assert draw(EXAMPLE, np.zeros(5, np.int64), fold=0.1) == draw(EXAMPLE)


FOLDED = parse(
    "IF_ball_is_lost(IF_r1_is_left(search, IF_r1_is_right(search, pass)),"
    " IF_ball_is_left(IF_r2_is_left(avoid, IF_r2_is_lost(pass, shoot)), IF_r2_is_small(pass, shoot)))"
)
# ball is lost 200: search 150, 50 | ball is left 800: r2 is left 10: avoid 1, pass 2, shoot 7 | unused
COUNTS = [1010, 200, 150, 50, 50, 0, 810, 10, 1, 9, 2, 7, 800, 0, 800]


def test_what_was_folded_is_said_in_every_drawing():
    said = ["always search: 5 nodes", "rarely used, 5 nodes: shoot 70%, pass 20%, ...", "always shoot: 3 nodes"]
    assert as_text(FOLDED, COUNTS, fold=0.02).split("\n") == [
        " 100.0%  ball is lost?",
        f"  19.8%    yes: {said[0]}",
        "  80.2%    no: ball is left?",
        f"   1.0%      yes: {said[1]}",
        f"  79.2%      no: {said[2]}",
    ]
    dot, svg = as_dot(FOLDED, COUNTS, fold=0.02), as_svg(FOLDED, COUNTS, fold=0.02)
    assert all(f'label="{text}\\n' in dot for text in said)
    assert {text for _, text in drawn(svg)[2]} == {"ball is lost?", "ball is left?", *said}
    nowhere = as_text(FOLDED, [10, 10, 10, 0, 0, 0, *[0] * 9], fold=0.0)
    assert nowhere == " 100.0%  always search: 15 nodes"
    never = as_text(
        parse("IF_ball_is_lost(IF_r1_is_left(search, pass), IF_r1_is_left(pass, avoid))"),
        [9, 9, 4, 5, 0, 0, 0],
        fold=0.0,
    )
    assert never.split("\n")[-1] == "   0.0%    no: never used: 3 nodes"


def test_a_terminal_has_one_colour_in_all_pictures():
    own = FunctionSet(("IF_dark",), tuple(f"t{n}" for n in range(10)))
    colours = terminal_colours(own.terminals)
    assert list(colours.values()) == [*TERMINAL_COLOURS, *TERMINAL_COLOURS[:2]]
    for text in ("IF_dark(t3, t1)", "t3", "IF_dark(t1, t3)"):
        root, _, said = drawn(as_svg(parse(text, own), terminals=own.terminals))
        boxes = [box for box in root.iter(f"{SVG}rect") if box.get("class") == "terminal"]
        for box, (_, name) in zip(boxes, [one for one in said if one[1] in colours], strict=True):
            assert box.get("fill") == colours[name]


def test_what_terminals_do_stands_below_the_tree_of_those_that_are_in_it():
    said = {"shoot": "kicks & runs", "avoid": "keeps " + "well " * 30 + "away", "other": "is not there"}
    root, boxes, _ = drawn(as_svg(EXAMPLE, descriptions=said))
    texts = [text for text in root.iter(f"{SVG}text") if text.get("class") == "legend"]
    words = [" ".join(" ".join(text.itertext()).split()) for text in texts]
    assert words == [f"{name}: {' '.join(said[name].split())}" for name in ("shoot", "avoid")]
    places = [float(text.get("y")) for text in texts]
    assert max(y + high for _, y, _, high in boxes) < places[0] < places[1]
    lines = len(list(texts[1].iter(f"{SVG}tspan")))
    assert places[1] + 16 * lines < float(root.get("height"))
    assert float(root.get("width")) < 390


def test_a_share_is_never_told_as_none_or_all_that_is_not():
    told = [percent(share) for share in (0.0, 0.0004, 0.0006, 0.1234, 0.9994, 0.9996, 1.0)]
    assert told == ["0.0%", "<0.1%", "0.1%", "12.3%", "99.9%", ">99.9%", "100.0%"]


@pytest.mark.parametrize(("nodes", "depth"), [(1001, 30), (3001, 30)])
def test_a_large_tree_is_drawn_whole_and_folded(nodes, depth, grow, walk):
    tree = grow(nodes, depth)
    steps = walk(tree, 5000)
    root, boxes, _ = drawn(as_svg(tree, steps))
    assert len(boxes) == nodes
    assert float(root.get("width")) < 1200
    parts = fold_tree(tree, steps)
    root, boxes, _ = drawn(as_svg(tree, steps, fold=0.005))
    assert len(boxes) == len(parts) < 150
    assert float(root.get("width")) < 800
    assert as_text(tree, steps).count("\n") == as_dot(tree, steps).count(" -> ") == nodes - 1
    assert as_text(tree, steps, fold=0.005).count("\n") == len(parts) - 1


@pytest.mark.parametrize("depth", [400, 3000])
def test_a_chain_of_questions_stays_a_column(depth, chain):
    tree = chain(depth)
    assert tree.depth == depth
    root, boxes, _ = drawn(as_svg(tree))
    assert len(boxes) == tree.nodes
    assert float(root.get("width")) < 390  # a phone's
    assert as_text(tree).count("\n") == tree.nodes - 1
    assert parse(str(tree)) == tree
    assert simplify(tree).nodes < tree.nodes  # the same conditions come back


def test_a_notebook_shows_the_picture():
    assert EXAMPLE._repr_svg_() == as_svg(EXAMPLE)
