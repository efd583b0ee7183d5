"""Local prediction models of what is degenerate, hardly excited, or refused."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import fields

import numpy as np
import pytest
from numpy.typing import NDArray

from behaviors.lpm import PersistentExcitationWarning, identify

Array = NDArray[np.float64]
Segment = tuple[Array, Array]

STATES, INPUTS, OUTPUTS = 4, 2, 3  # of random systems
MODES = ["keep", "project"]


# ------------------------------------------------------------------------------------- degenerate features


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("size", [1, 3, None])
def test_exactly_dependent_features_change_nothing(record, mode: str, size: int | None) -> None:
    (u, y), *_ = segments = record(17, [600])
    dependent = np.column_stack([y, y.mean(axis=1), 1e3 * y[:, 0] + 7.0, np.full(len(y), 0.1)])
    model = identify(segments, history_length=size, future_inputs=mode)
    other = identify([(u, dependent)], history_length=size, order=model.order, future_inputs=mode)
    for field in fields(other):
        assert np.isfinite(getattr(other, field.name)).all(), field.name
    if size is not None:
        np.testing.assert_allclose(other.contribution, model.contribution, atol=1e-8)
        np.testing.assert_allclose(other.predict(u, dependent)[:, :3], model.predict(u, y), atol=1e-6)
        # (3.7) counts the dependent features too; the likelihood differs by their (constant) scale.
        n = np.arange(1, len(model.aic) + 1)
        difference = other.aic - model.aic - 2 * 3 * n
        np.testing.assert_allclose(difference, difference[0], atol=1e-4)
    np.testing.assert_allclose(other.predict(u, dependent)[10:, -1], 0.1)


@pytest.mark.parametrize("mode", MODES)
def test_a_system_without_noise_gives_finite_results(random_systems, mode: str) -> None:
    rng = np.random.default_rng(18)
    segments = list(zip(*random_systems(rng, 1).simulate(rng, 400, "white", noise=0.0), strict=True))
    for size in (1, 2, 3, None):
        model = identify(segments, history_length=size, future_inputs=mode)
        for field in fields(model):
            assert np.isfinite(getattr(model, field.name)).all(), field.name
        assert np.all(model.contribution <= 1.0)
    if mode == "project":  # what is kept of future inputs disturbs the directions, and the prediction is not exact
        assert (model.history_length, model.order) == (2, STATES)  # 2 * 3 observations determine 4 states
        np.testing.assert_allclose(model.predict(*segments[0])[2:], segments[0][1][2:], atol=1e-9)


# ------------------------------------------------------------------------------------------------- excitation


def _one_action(u: Array) -> Array:
    return np.ones_like(u)


def _one_input_constant(u: Array) -> Array:
    return np.column_stack([u[:, 0], np.full(len(u), 0.3)])


def _inputs_together(u: Array) -> Array:
    return np.column_stack([u[:, 0], 2.0 * u[:, 0] - 1.0])


def _fixed_rhythm(u: Array) -> Array:
    t = np.arange(len(u))
    return np.column_stack([np.sin(t), np.cos(0.5 * t)])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("actions", [_one_action, _one_input_constant, _inputs_together, _fixed_rhythm])
def test_weak_excitation_warns_and_gives_a_finite_model(record, mode: str, actions: Callable[[Array], Array]) -> None:
    (u, y), *_ = record(25, [500])
    with pytest.warns(PersistentExcitationWarning, match="not persistently exciting of order") as caught:
        model = identify([(actions(u), y)], history_length=3, order=3, future_inputs=mode)
    assert [warning.filename for warning in caught] == [__file__]
    for field in fields(model):
        assert np.isfinite(getattr(model, field.name)).all(), field.name


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("kind", ["white", "held", "policy"])
def test_sufficient_excitation_does_not_warn(record, mode: str, kind: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        identify(record(26, [1000], kind), history_length=4, future_inputs=mode)


def test_needed_order_of_excitation_is_lower_where_future_inputs_are_kept(record) -> None:
    (_, y), *_ = record(27, [1000])
    t = np.arange(1000)
    actions = (np.sin(0.7 * t) + np.sin(1.9 * t))[:, None]  # persistently exciting of order 4, not of 5
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        identify([(actions, y)], history_length=3, order=2)
    with pytest.warns(PersistentExcitationWarning, match="of order 6"):
        identify([(actions, y)], history_length=3, order=2, future_inputs="project")


# ----------------------------------------------------------------------------------------------------- errors


def _segment(steps: int, m: int = INPUTS, q: int = OUTPUTS) -> Segment:
    rng = np.random.default_rng(28)
    return rng.normal(size=(steps, m)), rng.normal(size=(steps, q))


def _with(value: float) -> Segment:
    u, y = _segment(100)
    y[17, 1] = value
    return u, y


@pytest.mark.parametrize(
    ("segments", "options", "message"),
    [
        pytest.param([], {}, "no segments came", id="none"),
        pytest.param(_segment(100), {}, r"segment 0 has 100 parts; expected a list of pairs", id="bare-pair"),
        pytest.param([(np.zeros(9), np.zeros((9, 1)))], {}, r"shapes \(9,\) and \(9, 1\); give", id="flat"),
        pytest.param([(np.zeros((9, 1)), np.zeros((8, 1)))], {}, "with the same T", id="unequal-length"),
        pytest.param([(np.zeros((9, 0)), np.zeros((9, 1)))], {}, "m, q >= 1", id="no-inputs"),
        pytest.param(
            [_segment(100), _segment(100, m=3)],
            {},
            "segment 1 has m = 3 and q = 3, segment 0 has m = 2 and q = 3",
            id="other-m",
        ),
        pytest.param([_segment(100), _segment(100, q=1)], {}, "segment 1 has m = 2 and q = 1", id="other-q"),
        pytest.param([_with(np.nan)], {}, "segment 0 holds NaN or infinite values, first in row 17", id="nan"),
        pytest.param([_segment(100), _with(np.inf)], {}, "segment 1 holds NaN or infinite", id="inf"),
        pytest.param([(_segment(100)[0], np.full((100, 3), 0.1))], {}, "all 3 observations are const", id="const"),
        pytest.param([_segment(100)], {"future_inputs": "drop"}, "'keep' or 'project', not 'drop'", id="mode"),
        pytest.param([_segment(100)], {"history_rule": "bic"}, "'norm', 'gain' or 'aic', not 'bic'", id="rule"),
        pytest.param([_segment(100)], {"parameter_count": "all"}, "'entries' or 'free', not 'all'", id="count"),
        pytest.param([_segment(100)], {"history_length": 0}, "history_length must be at least 1", id="l-0"),
        pytest.param([_segment(100)], {"history_length": 1.5}, "whole number .* not 1.5", id="l-float"),
        pytest.param([_segment(100)], {"order": 0}, "order must be at least 1", id="n-0"),
        pytest.param([_segment(100)], {"threshold": 0.0}, "threshold must be a positive norm", id="threshold-0"),
        pytest.param([_segment(100)], {"threshold": np.nan}, "not nan", id="threshold-nan"),
        pytest.param(
            [_segment(5), _segment(3)],
            {"history_length": 3},
            "needs a segment of at least 6 rows, the longest of 2 has 5; record longer",
            id="all-short",
        ),
        pytest.param([_segment(1), _segment(0)], {}, "history_length 1 needs a segment of at least 2", id="all-tiny"),
        pytest.param(
            [_segment(15), _segment(14)],
            {"history_length": 3},
            "needs more than 24 windows .* these segments hold 19; record more",
            id="few-windows",
        ),
        pytest.param([_segment(9)], {}, "history_length 1 .* more than 8 windows .* hold 8;", id="few-windows-auto"),
        pytest.param(
            [_segment(15)],
            {"future_inputs": "project", "history_length": 2},
            "more than 20 windows",
            id="few-windows-project",
        ),
        pytest.param(
            [_segment(100)],
            {"history_length": 2, "order": 7},
            "order 7 is too large: the data with history_length 2 allow at most 6",
            id="order",
        ),
        pytest.param([_segment(60)], {"order": 20}, "order 20 is too large: .* allow at most", id="order-auto"),
        pytest.param([_segment(60)], {"order": 20, "history_rule": "aic"}, "order 20 is too large", id="order-aic"),
        pytest.param([_segment(9)], {"history_rule": "aic"}, "more than 8 windows", id="few-windows-aic"),
        pytest.param(
            [(_segment(100)[0], np.repeat(_segment(100)[1][:, :1], 3, axis=1))],
            {"history_length": 2, "order": 3},
            "allow at most 2",
            id="order-rank",
        ),
        pytest.param(
            [(_segment(100)[0], _segment(100)[0] @ np.ones((2, 1)))],
            {"history_length": 2, "future_inputs": "project"},
            "no direction of the past and the future observations varies",
            id="nothing-left",
        ),
    ],
)
def test_errors_say_what_came_and_what_to_do(segments: list[Segment], options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        identify(segments, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("method", ["states", "predict", "latest_state"])
@pytest.mark.parametrize(
    ("segment", "message"),
    [
        (_segment(20, q=2), "this model has m = 2 and q = 3, the segment m = 2 and q = 2"),
        (_segment(20, m=1), "the segment m = 1 and q = 3"),
        ((np.zeros((20, 2)), np.zeros((19, 3))), "with the same T"),
        ((np.zeros((20, 2)), np.zeros(20)), "give a single feature as a column"),
        ((np.zeros((20, 2)), np.full((20, 3), np.inf)), "infinite values; expected finite ones, or NaN"),
    ],
    ids=["q", "m", "length", "flat", "inf"],
)
def test_a_model_refuses_other_signals(method: str, segment: Segment, message: str) -> None:
    model = identify([_segment(100)], history_length=2, order=2)
    with pytest.raises(ValueError, match=message):
        getattr(model, method)(*segment)
