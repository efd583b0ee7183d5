"""The state from one image: against classes that are written out, and its limits against what they promise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from behaviors.raw import RAW_COMPONENTS, _terciles, raw_model
from coevo.errors import InputError
from coevo.skill import Skill, make_bank
from coevo.skill.estimate import discrete_state, forget, make_memory, remember
from coevo.skill.model import OBJECT_KINDS
from coevo.soccer.camera import BALL, OPPONENT_GOAL, OWN_GOAL, ROBOTS

WIDTH = 64.0
PLACES = {"ball": BALL, "own_goal": OWN_GOAL, "opponent_goal": OPPONENT_GOAL, "mate": ROBOTS, "robot": ROBOTS}


def images(kind, rows=600, seed=1):
    """Return (rows, features) of made-up images in whole pixels."""
    return np.random.default_rng(seed).integers(1, 60, (rows, OBJECT_KINDS[kind])).astype(np.float64)


def thirds(samples, value):
    """Return the class of a value among sorted samples: at most about a third of them are below, and above."""
    ordered = sorted(samples)
    low, high = ordered[-(-len(ordered) // 3) - 1], ordered[-(-2 * len(ordered) // 3) - 1]
    return 0 if value < low else 2 if value > high else 1


def classes(kind, seen, row):
    """Return the class of each component of an image, as the literature words them."""
    columns = {name: seen[:, j] for j, name in enumerate(FEATURES[kind])}
    image = dict(zip(FEATURES[kind], row, strict=True))
    found = {"x": 0 if image["x"] < WIDTH / 3 else 1 if image["x"] < 2 * WIDTH / 3 else 2}
    for name in RAW_COMPONENTS[kind]:
        if name == "orientation":
            heights = [
                (part["lower left y"] - part["upper left y"]) - (part["lower right y"] - part["upper right y"])
                for part in (columns, image)
            ]
            found[name] = thirds(*heights)
        elif name != "x":
            found[name] = thirds(columns[name], image[name])
    return [found[name] for name in RAW_COMPONENTS[kind]]


GOAL = ["x", "y"] + [
    f"{row} {column} {axis}" for row in ("upper", "lower") for column in ("left", "right") for axis in "xy"
]
FEATURES = {
    "ball": ["x", "y", "radius", "area"],
    "own_goal": [*GOAL, "area"],
    "opponent_goal": [*GOAL, "area"],
    "mate": ["x", "y", "width", "height", "area"],
    "robot": ["x", "y", "width", "height", "area"],
}


@pytest.mark.parametrize("cell", [1.0, 0.45])
@pytest.mark.parametrize("kind", OBJECT_KINDS)
def test_states_are_the_classes_of_the_features(kind, cell):
    seen = images(kind)
    for order in range(1, len(RAW_COMPONENTS[kind]) + 1):
        model = raw_model(kind, [seen[:200], seen[200:]], order=order, image_width=WIDTH, cell=cell)
        skill = Skill("any", "pws", (model,), np.zeros((model.states, 9), np.float32), 1, 1)
        bank = make_bank([skill], drive="pws", actions=9)
        memory = make_memory(bank, [1, 0])
        forget(memory)
        for time, row in enumerate(images(kind, 100, seed=2)):
            thing = PLACES[kind]
            memory.areas[0, thing], memory.features[0, thing, : len(row)] = 5.0, row
            action = np.array([1.0, -1.0]) * (time % 3 - 1)  # must not matter
            remember(memory, bank, 0, time, action, 0.5 * WIDTH)
            number = discrete_state(memory, bank, 0, 0, time)
            digits = [number // 3**j % 3 for j in range(order)]
            assert digits == classes(kind, seen, row)[:order]


@pytest.mark.parametrize(
    ("kind", "lost", "states"),
    [("ball", 2, 11), ("opponent_goal", 2, 29), ("own_goal", 2, 29), ("robot", 2, 11), ("mate", 1, 10)],
)
def test_there_are_as_many_states_as_in_the_literature(kind, lost, states):
    model = raw_model(kind, [images(kind)], image_width=WIDTH, lost_states=lost)
    assert model.states == states
    assert model.history_length == 1


@given(st.lists(st.integers(-3, 12), min_size=3, max_size=60))
def test_limits_lie_between_values_and_part_them_into_three(values):
    samples = np.array(values, np.float64)
    distinct = len(set(values))
    if distinct < 3:
        with pytest.raises(InputError, match=f"took {distinct} different values"):
            _terciles(samples, "area of ball")
        return
    low, high = _terciles(samples, "area of ball")
    assert not np.isin([low, high], samples).any()
    below, above = np.mean(samples < low), np.mean(samples > high)
    assert below > 0.0
    assert above > 0.0
    assert np.any((samples > low) & (samples < high))
    assume(min(values) != sorted(values)[-(-len(values) // 3) - 1])
    assume(max(values) != sorted(values)[-(-2 * len(values) // 3) - 1])
    assert below <= 1 / 3
    assert above <= 1 / 3


def test_what_was_never_seen_to_vary_cannot_be_cut():
    still = np.full((50, 4), 7.0)
    with pytest.raises(InputError, match=r"the area of ball took 1 different values.*smaller order"):
        raw_model("ball", [still], image_width=WIDTH)
    with pytest.raises(InputError, match=r"the area of ball took 0 different values"):
        raw_model("ball", [], image_width=WIDTH)
    assert raw_model("ball", [still], order=1, image_width=WIDTH).states == 5  # thirds of the image need no samples


def test_more_components_than_there_are_are_refused():
    with pytest.raises(InputError, match=r"ball has 1 to 4 components \(x, area, y, radius\), not 5"):
        raw_model("ball", [images("ball")], order=5, image_width=WIDTH)
