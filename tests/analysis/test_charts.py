"""Charts of lines, by the picture that is made of them."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
import pandas as pd
import pytest

from analysis.charts import COLOURS, chart_bytes, line_chart


def lines_of(chart):
    """Return the lines of a chart, as elements of its picture."""
    root = ET.fromstring(chart_bytes(chart, ".svg"))  # noqa: S314 - our own
    paths = root.iter("{http://www.w3.org/2000/svg}path")
    return [path for path in paths if path.get("aria-roledescription") == "line mark"]


def paths(chart):
    """Return the corners of each line of a chart, (points, 2) in pixels, a list for each unbroken piece."""
    return [
        [
            np.array(piece.replace("L", ",").split(","), float).reshape(-1, 2)
            for piece in line.attrib["d"].split("M")[1:]
        ]
        for line in lines_of(chart)
    ]


def test_a_chart_puts_points_where_their_values_are():
    table = pd.DataFrame({"x": [0.0, 5.0, 10.0], "y": [0.0, 1.0, 0.5], "name": "a < b"})
    marks = pd.DataFrame({"x": [5.0], "what": ["half"]})
    chart = line_chart(table, x="x", y="y", by="name", titles=("t", "x", "y"), marks=marks)
    ((points,),) = paths(chart)
    assert points[1, 0] == pytest.approx(0.5 * (points[0, 0] + points[2, 0]), abs=0.1)
    assert points[2, 1] == pytest.approx(0.5 * (points[0, 1] + points[1, 1]), abs=0.1)
    assert points[1, 1] < points[0, 1]  # y points down in SVG
    assert b"half" in chart_bytes(chart, ".svg")


def test_a_line_is_broken_where_there_is_no_number():
    y = [1.0, 2.0, np.nan, 4.0, 5.0, np.nan, np.nan, 3.0, 1.0]
    table = pd.DataFrame({"x": np.arange(9.0), "y": y, "name": "ball"})
    (pieces,) = paths(line_chart(table, x="x", y="y", by="name", titles=("", "", "")))
    assert [len(piece) for piece in pieces] == [2, 2, 2]


def test_more_lines_than_colours_can_be_told_apart():
    names = [f"arm {number}" for number in range(2 * len(COLOURS) + 1)]
    table = pd.DataFrame([(name, x, x) for name in names for x in (0.0, 1.0)], columns=["name", "x", "y"])
    lines = lines_of(line_chart(table, x="x", y="y", by="name", titles=("", "", "")))
    looks = [(line.attrib["stroke"], line.get("stroke-dasharray", "")) for line in lines]
    assert len(looks) == len(set(looks)) == len(names)
