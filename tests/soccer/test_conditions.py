"""Conditions: the table for compiled code against a plain reading of it, Table 6.1, and Python's own arithmetic."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coevo.config import CategorySettings, ConditionSettings
from coevo.errors import InputError
from coevo.soccer.conditions import (
    AREA,
    OBJECTS,
    condition_table,
    function_names,
    read_expression,
    soccer_conditions,
    things_of,
)
from coevo.vocabulary import CATEGORIES

THIRD = 64.0 / 3.0
# Where each kind of object keeps its area among its features (coevo.soccer.camera).
AREA_AT = {"ball": 3, "own_goal": 10, "opponent_goal": 10, "robot": 4}


def holds(table, robot, condition, features, areas):
    """Tell whether a condition holds for what a robot sees, as ConditionTable says."""
    thing = table.thing[robot, condition]
    if not table.wants[robot, condition]:
        return not areas[thing] > 0.0
    if not areas[thing] > 0.0:
        return False
    first = table.first[robot, condition]
    for term in range(first, first + table.terms[robot, condition]):
        which = table.feature[term]
        if which == AREA:
            value = areas[thing]
        elif which >= 0:
            value = features[thing, which]
        else:
            value = sum(weight * feature for weight, feature in zip(table.weights[term], features[thing], strict=True))
        if not table.low[term] <= value < table.high[term]:
            return False
    return True


def kind_of(thing):
    return thing if thing in ("ball", "own_goal", "opponent_goal") else "robot"


def by_table_6_1(limits, thing, category, x, area):
    """Tell whether "a is b", written without looking at how conditions are declared."""
    if category == "lost" or area <= 0.0:
        return category == "lost" and area <= 0.0
    if category in ("left", "middle", "right"):
        return category == ("left" if x < limits.left_below_px else "right" if x >= limits.right_from_px else "middle")
    kind = kind_of(thing).rpartition("_")[2]
    small, large = getattr(limits, f"{kind}_small_below_px"), getattr(limits, f"{kind}_large_from_px")
    return category == ("small" if area < small else "large" if area >= large else "medium")


def seen(robots, rng, limits):
    """Return features and areas of what may be seen, often exactly at a limit or just below it."""
    things = 2 + robots
    edges = [
        float(value)
        for name in limits.__struct_fields__
        for value in (getattr(limits, name), np.nextafter(getattr(limits, name), 0.0))
    ]
    features = rng.uniform(0.0, 100.0, (things, 11))
    features[:, 0] = rng.choice([*edges, *rng.uniform(0.0, 64.0, len(edges))], things)
    areas = rng.choice([0.0, -1.0, *edges, *rng.uniform(0.0, 200.0, len(edges))], things)
    return features, areas


@pytest.mark.parametrize("robots", [2, 3, 6])
@pytest.mark.parametrize(
    "limits",
    [
        CategorySettings(),
        CategorySettings(left_below_px=40.0, right_from_px=20.0, ball_small_below_px=60.0, ball_large_from_px=20.0),
    ],
    ids=["presets", "limits that cross"],
)
def test_the_standard_conditions_are_table_6_1(robots, limits):
    table, rng = condition_table(robots, limits, {}), np.random.default_rng(robots)
    for _ in range(60):
        features, areas = seen(robots, rng, limits)
        for robot in range(robots):
            things = things_of(robot, robots)
            for c, name in enumerate(function_names(robot, robots)):
                thing, category = name[3:].rsplit("_is_", 1)
                n = things.index(thing)
                expected = by_table_6_1(limits, thing, category, features[n, 0], areas[n])
                assert holds(table, robot, c, features, areas) == expected, name


@pytest.mark.parametrize(("robots", "functions"), [(2, 28), (3, 35), (6, 56)])
def test_functions_are_those_of_the_source_object_by_object(robots, functions):
    for robot in range(robots):
        names = function_names(robot, robots)
        others = tuple(f"r{i}" for i in range(robots) if i != robot)
        assert things_of(robot, robots) == ("ball", "own_goal", "opponent_goal", *others)
        assert list(names) == [f"IF_{thing}_is_{c}" for thing in things_of(robot, robots) for c in CATEGORIES]
        assert len(names) == functions


def test_added_conditions_come_after_all_standard_ones_object_by_object():
    added = {
        "near": ConditionSettings(objects=("ball", "robot"), expression="area >= 70"),
        "there": ConditionSettings(objects=("robot",), expression="visible"),
    }
    _, conditions = soccer_conditions(CategorySettings(), added)
    names = function_names(1, 3, conditions)
    assert names[:35] == function_names(1, 3)
    assert names[35:] == ("IF_ball_is_near", "IF_r0_is_near", "IF_r0_is_there", "IF_r2_is_near", "IF_r2_is_there")
    table = condition_table(3, CategorySettings(), added)
    assert table.thing.shape == (3, 40)
    assert table.thing[1, 35:].tolist() == [0, 3, 3, 4, 4]


numbers = st.floats(-1e4, 1e4, allow_nan=False).map(lambda x: round(x, 3))


@st.composite
def comparisons(draw, kind):
    features = st.sampled_from(OBJECTS[kind])
    scaled = st.builds("{} * {}".format, numbers.map(lambda x: f"({x})"), features)
    divided = st.builds("{} / {}".format, features, st.sampled_from(["2", "0.5", "-3"]))
    part = st.one_of(features, scaled, divided, numbers.map(lambda x: f"({x})"), features.map("-{}".format))
    side = st.lists(part, min_size=1, max_size=3).map(" + ".join) | st.tuples(part, part).map(" - ".join)
    feature = draw(features)
    return f"{draw(side)} {draw(st.sampled_from(['<', '>=']))} {draw(side)} + {feature} * 0.5"


@given(data=st.data(), kind=st.sampled_from(sorted(OBJECTS)))
def test_an_expression_is_what_python_makes_of_it(data, kind):
    parts = data.draw(st.lists(comparisons(kind), min_size=1, max_size=3))
    text = " and ".join(parts)
    thing = {"ball": 0, "own_goal": 1, "opponent_goal": 2, "robot": 3}[kind]
    try:
        table = condition_table(2, CategorySettings(), {"odd": ConditionSettings(objects=(kind,), expression=text)})
    except InputError as error:
        assert "there is no feature in" in str(error)  # noqa: PT017 - the other way is no error; all cancelled out
        return
    features = np.random.default_rng(len(text)).uniform(-60.0, 60.0, (4, 11))
    areas = np.abs(features[:, 5]) + 1.0
    features[thing, AREA_AT[kind]] = areas[thing]
    known = dict(zip(OBJECTS[kind], features[thing], strict=False))
    sides = [side for part in parts for side in part.replace(">=", "<").split("<")]
    values = [eval(side, {"__builtins__": {}}, known) for side in sides]  # noqa: S307 - written above
    if any(math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-6) for a, b in zip(values[::2], values[1::2], strict=True)):
        return  # rounding may decide
    expected = eval(text, {"__builtins__": {}}, known)  # noqa: S307
    assert holds(table, 0, 28, features, areas) == expected
    areas[thing] = 0.0
    assert not holds(table, 0, 28, features, areas)


def test_the_area_is_read_where_noise_changes_it():
    term = read_expression("area >= 400", "ball", "conditions.near").terms[0]
    assert (term.feature, term.low, term.high) == (AREA, 400.0, math.inf)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param("area > 3", "only '>=' and '<' are read; got 'area > 3', write '>='", id="greater"),
        pytest.param("area <= 3", "got 'area <= 3', write '<'", id="at most"),
        pytest.param("area == 3", "got 'area == 3'", id="equal"),
        pytest.param("20 <= x < 44", "as two comparisons joined by 'and'", id="chained"),
        pytest.param("x < 3 or y < 3", "expected comparisons joined by 'and'", id="or"),
        pytest.param("not x < 3", "expected comparisons joined by 'and'", id="not"),
        pytest.param("lost and x < 3", "'lost' or 'visible' alone", id="lost and more"),
        pytest.param("x", "expected comparisons joined by 'and'", id="no comparison"),
        pytest.param("x * y < 3", "expected features added up", id="a product of features"),
        pytest.param("x ** 2 < 3", "expected features added up", id="a power"),
        pytest.param("3 / x < 3", "expected features added up", id="a quotient"),
        pytest.param("x / 0 < 3", "expected features added up", id="by nothing"),
        pytest.param("abs(x) < 3", "expected features added up", id="a call"),
        pytest.param("__import__('os').system('true') < 3", "expected features added up", id="mischief"),
        pytest.param("x < True", "expected features added up", id="true"),
        pytest.param("x < 1e999", "expected finite numbers", id="infinite"),
        pytest.param("3 < 4", "there is no feature in '3 < 4'", id="numbers alone"),
        pytest.param("raduis < 3", "the ball has no 'raduis'. Did you mean 'radius'?", id="misspelt"),
        pytest.param("width < 3", "the ball has no 'width'. It has x, y, radius, area", id="of another object"),
        pytest.param("x <", "write comparisons such as", id="half"),
        pytest.param("", "write comparisons such as", id="empty"),
        pytest.param("(" * 400 + "x" + ")" * 400 + " < 3", "cannot read", id="deep"),
        pytest.param("-" * 3000 + "x < 3", "cannot read", id="deeper"),
    ],
)
def test_what_cannot_be_read_is_told_with_the_remedy(text, message):
    with pytest.raises(InputError) as caught:
        read_expression(text, "ball", "conditions.near")
    assert str(caught.value).startswith("conditions.near: ")
    assert message in str(caught.value)
