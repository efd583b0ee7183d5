"""The controller of environmental complexity does what Fig. 4.3 says, and a saved one goes on as if never stopped."""

from __future__ import annotations

import math
from datetime import date
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coevo.complexity import Controller, at_level, check_rates, every_level, value_change, values_at
from coevo.config import ComplexitySettings, LevelsSettings, WorldSettings, check
from coevo.errors import InputError

SPEEDS = [{"robot.max_speed_mps": [0.25, 0.5, 0.75, 1.0]}]


def made(**table: Any):
    table = {"keys": SPEEDS, "raise_when": {"success": {"at_least": 0.7}}} | table
    return check(ComplexitySettings, table, "mine")


def refused(kind=ComplexitySettings, **table: Any):
    table = {"keys": SPEEDS, "raise_when": {"success": {"at_least": 0.7}}} | table
    with pytest.raises(InputError) as caught:
        check(kind, table, "mine")
    message = str(caught.value)
    assert "\n" not in message
    return message


# ---------------------------------------------------------------------------------------------- against the flowchart


def pooled(rows):
    trials = {name: sum(row[name][1] for row in rows) for name in rows[0]}
    return {name: sum(row[name][0] for row in rows) / n if n else None for name, n in trials.items()}


def met(criteria, rates):
    bounds = [(rates[name], c.at_least, c.at_most) for name, c in criteria.items()]
    return all(r is not None and (low is None or r >= low) and (high is None or r <= high) for r, low, high in bounds)


def missing(criteria, rates):
    bounds = [(rates[name], c.at_least, c.at_most) for name, c in criteria.items()]
    low = sum(max(0.0, low - r) for r, low, _ in bounds if r is not None and low is not None)
    high = sum(max(0.0, r - high) for r, _, high in bounds if r is not None and high is not None)
    return low + high + sum(1.0 for r, _, _ in bounds if r is None)


def idle_windows(settings, windows):
    """Return how many windows have come no nearer to the criteria; those that met them neither wait nor give up."""
    best, idle = math.inf, 0
    for rates in windows:
        if not met(settings.raise_when, rates) or (settings.lower_when and met(settings.lower_when, rates)):
            one = missing(settings.raise_when, rates)
            best, idle = (one, 0) if one < best - settings.improvement else (best, idle + 1)
    return idle


def step(settings, windows, change, level, dimension):
    """Return the event that follows from the windows on a level, the last of which is the newest."""
    top, rates = level == settings.levels - 1, windows[-1]
    down = bool(settings.lower_when) and met(settings.lower_when, rates)
    if down and level > 0:
        return "lowered"
    if met(settings.raise_when, rates) and not down:
        return "raised" if not top else "end" if settings.at_the_top == "end" else None
    converged = change is not None and change < settings.converged_below
    if not converged and not (settings.patience and idle_windows(settings, windows) >= settings.patience):
        return None
    grows = dimension < settings.most_dimensions
    possible = {"grow": grows, "lower": level > 0, "raise": not top, "stay": True, "end": True}
    words = {"grow": "axis_added", "lower": "lowered", "raise": "raised", "end": "end", "stay": None}
    return next((words[do] for do in settings.on_stall if possible[do]), None)


def reference(settings, history, changes):
    """Return the events of a whole history, each step worked out anew from all that was observed on the level."""
    level, dimension, since, events, periods = settings.first, settings.dimension, 0, [], []
    for now in range(1, len(history) + 1):
        ends = range(since + settings.window, now + 1)
        windows = [pooled(history[end - settings.window : end]) for end in ends]
        did = step(settings, windows, changes[now - 1], level, dimension) if windows else None
        if did is None:
            continue
        if did == "axis_added":
            periods.append((level, since, now))
            dimension += 1
        level += {"raised": 1, "lowered": -1}.get(did, 0)
        events.append((now, did, level, dimension))
        since = now
        if did == "end":
            break
    return events, periods


# Eighths, so that every sum of rates is exact, whatever the order.
eighths = st.integers(0, 8).map(lambda k: k / 8)
bounds = st.one_of(
    eighths.map(lambda low: {"at_least": low}),
    eighths.map(lambda high: {"at_most": high}),
    st.tuples(eighths, eighths).map(lambda two: {"at_least": min(two), "at_most": max(two)}),
)
criteria = st.dictionaries(st.sampled_from(["success", "collisions"]), bounds, min_size=1)


@st.composite
def controllers(draw):
    dimension = draw(st.integers(0, 2))
    table = {
        "keys": draw(st.sampled_from([SPEEDS, [*SPEEDS, {"ball.mass_kg": [0.2, 0.3]}]])),
        "first": draw(st.integers(0, 3)),
        "raise_when": draw(criteria),
        "lower_when": draw(st.one_of(st.just({}), criteria)),
        "window": draw(st.sampled_from([1, 2])),
        "patience": draw(st.integers(0, 4)),
        "improvement": draw(st.sampled_from([0.0, 0.125])),
        "converged_below": draw(st.sampled_from([0.0, 0.5])),
        "on_stall": draw(st.lists(st.sampled_from(["grow", "lower", "raise", "stay", "end"]), min_size=1, max_size=3)),
        "dimension": dimension,
        "most_dimensions": dimension + draw(st.integers(0, 2)),
        "at_the_top": draw(st.sampled_from(["end", "stay"])),
    }
    return check(ComplexitySettings, table, "drawn")


counted = st.integers(0, 8).map(lambda k: (k, 8)) | st.just((0, 0))
observations = st.lists(
    st.tuples(
        st.fixed_dictionaries({"success": counted, "collisions": counted, "of no concern": counted}),
        st.sampled_from([None, 0.25, 0.75]),
    ),
    max_size=30,
)


@given(settings=controllers(), seen=observations)
def test_it_does_what_the_flowchart_says(settings, seen):
    controller, events = Controller(settings), []
    for now, (row, change) in enumerate(seen, 1):
        if controller.ended:
            break
        event = controller.observe(row, change=change)
        if event is not None:
            events.append((now, event.kind, event.level, event.dimension))
            assert (event.level, event.dimension) == (controller.level, controller.dimension)
    expected, periods = reference(settings, [row for row, _ in seen], [change for _, change in seen])
    assert events == expected
    assert controller.weak_critical_periods.tolist() == [list(period) for period in periods]


@given(settings=controllers(), seen=observations, at=st.integers(0, 30))
def test_saved_and_restored_at_any_step_it_goes_on_the_same(settings, seen, at):
    through, before = Controller(settings), Controller(settings)
    events = []
    for row, change in seen:
        if not through.ended:
            events.append(through.observe(row, change=change))
    again = []
    for step, (row, change) in enumerate(seen):
        if step == at:
            fresh = Controller(settings)
            fresh.restore(before.arrays())
            before = fresh
        if not before.ended:
            again.append(before.observe(row, change=change))
    assert again == events or repr(again) == repr(events)  # NaN is not equal to itself
    for name, array in through.arrays().items():
        np.testing.assert_array_equal(before.arrays()[name], array)


def test_both_criteria_of_table_4_1_are_required():
    settings = made(raise_when={"success": {"at_least": 0.5}, "collisions": {"at_most": 0.1}})
    controller = Controller(settings)
    assert controller.observe({"success": (80, 100), "collisions": (11, 100)}) is None
    assert controller.observe({"success": (49, 100), "collisions": (0, 100)}) is None
    event = controller.observe({"success": (50, 100), "collisions": (10, 100)})
    assert (event.kind, event.level) == ("raised", 1)
    assert event.rates == {"success": 0.5, "collisions": 0.1}


def test_what_was_seen_on_another_level_does_not_count():
    controller = Controller(made(window=2))
    kinds = [controller.observe({"success": (100, 100)}) for _ in range(6)]
    assert [event and event.level for event in kinds] == [None, 1, None, 2, None, 3]


def test_an_ended_controller_takes_nothing_more_and_foreign_arrays_are_refused():
    controller = Controller(made(first=3))
    assert controller.observe({"success": (1, 1)}).kind == "end"
    with pytest.raises(ValueError, match="ended"):
        controller.observe({"success": (1, 1)})
    two = Controller(made(raise_when={"success": {"at_least": 0.1}, "collisions": {"at_most": 0.1}}))
    with pytest.raises(ValueError, match="other levels or criteria"):
        two.restore(controller.arrays())


def test_change_of_values_is_4_4():
    before, after = np.array([[1.0, 2.0], [-3.0, -4.0]]), np.array([[2.5, 0.0], [-3.0, -1.0]])
    assert value_change(before, after) == pytest.approx(0.5 + 2.0)
    assert value_change(before, after, relative=True) == pytest.approx(2.5 / 5.0)
    assert value_change(np.zeros((2, 2)), np.zeros((2, 2)), relative=True) == 0.0


# ------------------------------------------------------------------------------------------------------------ levels


@given(sizes=st.lists(st.integers(1, 4), min_size=1, max_size=4).filter(lambda sizes: max(sizes) > 1))
def test_tables_move_one_after_the_other_and_the_keys_of_one_together(sizes):
    tables = [{f"a{t}": [10 * t + v for v in range(n)], f"b{t}": [-v for v in range(n)]} for t, n in enumerate(sizes)]
    settings = made(keys=tables)
    expected = [[0] * len(sizes)]
    for t, n in enumerate(sizes):
        for _ in range(n - 1):
            expected.append([*expected[-1][:t], expected[-1][t] + 1, *expected[-1][t + 1 :]])
    assert settings.levels == len(expected)
    for level, places in enumerate(expected):
        values = {f"a{t}": 10 * t + v for t, v in enumerate(places)} | {f"b{t}": -v for t, v in enumerate(places)}
        assert values_at(settings, level) == values


def test_a_level_is_the_settings_with_its_values_and_nothing_else():
    levels = every_level(WorldSettings(), made())
    assert [world.robot.max_speed_mps for world in levels] == [0.25, 0.5, 0.75, 1.0]
    base = msgspec.to_builtins(WorldSettings())
    for world in levels:
        data = msgspec.to_builtins(world)
        data["robot"]["max_speed_mps"] = base["robot"]["max_speed_mps"]
        assert data == base


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"robot.max_sped_mps": [0.1, 0.2]}, "unknown setting 'robot.max_sped_mps'. Did you mean 'max_speed_mps'?"),
        ({"robot.max_speed_mps": [0.1, -0.2]}, "robot.max_speed_mps: expected float > 0.0, got -0.2"),
        ({"robot.max_speed_mps.x": [1, 2]}, "is a single value and has no parts"),
        ({"robot": [1, 2]}, "expected a table"),
    ],
)
def test_levels_that_the_settings_refuse_are_named(keys, says):
    with pytest.raises(InputError) as caught:
        every_level(WorldSettings(), made(keys=[keys]))
    assert "of levels.keys" in str(caught.value)
    assert says in str(caught.value)


def test_a_place_in_a_list_that_is_not_there_is_named(small_settings):
    with pytest.raises(InputError, match=r"players.7.strength: expected an index from 0 to 2, got '7'"):
        at_level(small_settings(), made(keys=[{"players.7.strength": [0.1, 0.2]}]), 1)


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"window": 0}, "window: expected int >= 1, got 0"),
        ({"raise_when": {}}, "raise_when"),
        ({"raise_when": {"success": {"at_least": 1.2}}}, "raise_when.success.at_least: expected float <= 1.0, got 1.2"),
        ({"raise_when": {"success": {"at_most": -0.1}}}, "raise_when.success.at_most: expected float >= 0.0, got -0.1"),
        ({"raise_when": {"success": {}}}, "expected at_least or at_most"),
        ({"raise_when": {"success": {"at_least": 0.8, "at_most": 0.7}}}, "can never be met together"),
        ({"raise_when": {"success": {"atleast": 0.8}}}, "unknown setting 'raise_when.success.atleast'"),
        ({"keys": []}, "keys"),
        ({"keys": [{"robot.max_speed_mps": [1.0]}]}, "two or more values"),
        ({"keys": [{"a": [1, 2], "b": [1, 2, 3]}]}, "'a' and 'b' move together, but have 2 and 3 values"),
        ({"keys": [{"a": [1, 2]}, {"a": [1, 2]}]}, "'a' stands in them twice"),
        ({"keys": [{"a": [1, 2]}, {"a.b": [1, 2]}]}, "'a.b' stands in them twice"),
        ({"keys": [{"a": [[1], [None]]}]}, "'a': expected numbers, texts"),
        ({"keys": [{"a": [1, float("nan")]}]}, "'a': expected numbers, texts"),
        ({"keys": [{"a": [1, 2], "b": [{"x": [{"y": date(2000, 1, 1)}]}, {}]}]}, "'b': expected numbers, texts"),
        ({"first": 4}, "expected a level from 0 to 3, got 4"),
        ({"dimension": 3, "most_dimensions": 2}, "most_dimensions must be at least dimension 3, got 2"),
        ({"on_stall": ["panic"]}, "expected one of 'grow', 'lower', 'raise', 'stay', 'end', got 'panic'"),
    ],
)
def test_a_controller_that_cannot_be_is_refused(table, says):
    assert says in refused(**table)


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"raise_when": {}}, "keep"),
        ({"keys": {"a": [1, 2]}}, "keys: expected array"),
        ({"on_stall": ["grow"]}, "evolution has no axes"),
        ({"most": 0.4, "keep": "both sides winning"}, "most: expected float > 0.5, got 0.4"),
        ({"most_dimensions": 2}, "evolution has no axes"),
    ],
)
def test_levels_of_evolution_that_cannot_be_are_refused(table, says):
    assert says in refused(LevelsSettings, **table)


def test_levels_that_are_no_table_are_refused(small_settings):
    with pytest.raises(InputError, match=r"levels: expected a table, got int"):
        small_settings("levels=3")


def test_a_rate_that_nobody_measures_is_refused():
    with pytest.raises(InputError, match=r"raise_when: nobody measures a rate 'succes'. Did you mean 'success'?"):
        check_rates(made(raise_when={"succes": {"at_least": 0.5}}), ["success", "collisions"], "mine")
