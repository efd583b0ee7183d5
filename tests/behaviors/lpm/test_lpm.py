"""Local prediction models against independent references: statsmodels, and the appendix by loops."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, dataclass, fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import inv, sqrtm
from statsmodels.multivariate.cancorr import CanCorr

from behaviors.lpm import LocalPredictionModel, identify

Array = NDArray[np.float64]
Segment = tuple[Array, Array]

INPUTS, OUTPUTS = 2, 3  # of random systems
MODES = ["keep", "project"]


# --------------------------------------------------------------------- the appendix, word by word and slowly


@dataclass(frozen=True)
class SlowWindows:
    past: Array
    next_past: Array
    future: Array
    future_actions: Array
    actions: Array
    observations: Array


def slow_past(segment: Segment, t: int, size: int) -> Array:
    actions, observations = segment
    return np.concatenate(
        [
            *(actions[t - lag] for lag in range(1, size + 1)),
            *(observations[t - lag] for lag in range(1, size + 1)),
        ]
    )


def slow_windows(segments: list[Segment], size: int) -> SlowWindows:
    rows: dict[str, list[Array]] = {field.name: [] for field in fields(SlowWindows)}
    for actions, observations in segments:
        for t in range(size, len(actions) - size + 1):
            rows["past"].append(slow_past((actions, observations), t, size))
            rows["next_past"].append(slow_past((actions, observations), t + 1, size))
            rows["future"].append(np.concatenate([observations[t + k] for k in range(size)]))
            rows["future_actions"].append(np.concatenate([actions[t + k] for k in range(size)]))
            rows["actions"].append(actions[t])
            rows["observations"].append(observations[t])
    return SlowWindows(**{name: np.array(values) for name, values in rows.items()})


def mean_free(rows: Array) -> Array:
    return rows - rows.mean(axis=0)


def without(rows: Array, given: Array) -> Array:
    """Residual of a least-squares regression on `given`."""
    return rows - given @ np.linalg.lstsq(given, rows, rcond=None)[0]


def slow_identify(segments: list[Segment], size: int, order: int, mode: str) -> dict[str, Array]:
    """(A.3) to (A.11) with explicit covariances and symmetric square roots."""
    w = slow_windows(segments, size)
    p, f, u, y = (mean_free(rows) for rows in (w.past, w.future, w.actions, w.observations))
    p_left, f_left = p, f
    if mode == "project":
        given = mean_free(w.future_actions)
        p_left, f_left = without(p, given), without(f, given)
    count = len(p)
    root_p = np.real(inv(sqrtm(p_left.T @ p_left / count)))
    root_f = np.real(inv(sqrtm(f_left.T @ f_left / count)))
    rotation, mu, _ = np.linalg.svd(root_p @ (p_left.T @ f_left / count) @ root_f)
    memory = (rotation.T @ root_p)[:order]
    x, x_next = p @ memory.T, (w.next_past - w.past.mean(axis=0)) @ memory.T
    theta = np.linalg.lstsq(np.hstack([x, u]), np.hstack([x_next, y]), rcond=None)[0].T
    residual = y - np.hstack([x, u]) @ theta[order:].T
    return {
        "past_mean": w.past.mean(axis=0),
        "memory_matrix": memory,
        "contribution": mu,
        "A": theta[:order, :order],
        "B": theta[:order, order:],
        "C": theta[order:, :order],
        "D": theta[order:, order:],
        "residual_covariance": residual.T @ residual / count,
    }


def signs(model: LocalPredictionModel, reference: Array) -> Array:
    """Sign of each state relative to the reference's memory matrix."""
    return np.sign(np.sum(model.memory_matrix * reference, axis=1))


# ---------------------------------------------------------------------------------------------------- algebra


@pytest.mark.parametrize("size", [1, 2, 4])
def test_mu_equals_the_canonical_correlations_of_statsmodels(record, size: int) -> None:
    segments = record(1, [300, 40, 7, 500])
    w = slow_windows(segments, size)
    reference = CanCorr(w.future, w.past).cancorr
    model = identify(segments, history_length=size, order=1)
    np.testing.assert_allclose(model.contribution, reference, atol=1e-10)


@pytest.mark.parametrize("size", [1, 2, 4])
def test_projected_mu_equals_the_partial_canonical_correlations_of_statsmodels(record, size: int) -> None:
    segments = record(2, [300, 40, 7, 500], "held")
    w = slow_windows(segments, size)
    given = mean_free(w.future_actions)
    reference = CanCorr(without(mean_free(w.future), given), without(mean_free(w.past), given)).cancorr
    model = identify(segments, history_length=size, order=1, future_inputs="project")
    np.testing.assert_allclose(model.contribution, reference, atol=1e-10)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("kind", ["white", "held", "policy"])
@pytest.mark.parametrize("size", [3, None])
def test_model_equals_the_appendix_by_loops_and_never_crosses_segments(
    record, mode: str, kind: str, size: int | None
) -> None:
    segments = record(3, [60, 5, 200, 3, 6, 31, 100], kind)
    model = identify(segments, history_length=size, order=4, future_inputs=mode)
    reference = slow_identify(segments, model.history_length, 4, mode)
    turn = np.diag(signs(model, reference["memory_matrix"]))
    reference["memory_matrix"] = turn @ reference["memory_matrix"]
    reference["A"], reference["B"] = turn @ reference["A"] @ turn, turn @ reference["B"]
    reference["C"] = reference["C"] @ turn
    for name, expected in reference.items():
        np.testing.assert_allclose(getattr(model, name), expected, atol=1e-8, err_msg=name)


def test_joining_two_segments_would_change_the_model(record) -> None:
    segments = record(4, [150, 150])
    joined = [(np.vstack([segments[0][0], segments[1][0]]), np.vstack([segments[0][1], segments[1][1]]))]
    apart, together = identify(segments, history_length=3), identify(joined, history_length=3)
    assert not np.allclose(apart.contribution, together.contribution, atol=1e-6)


@pytest.mark.parametrize("mode", MODES)
def test_segments_without_a_window_are_skipped(record, mode: str) -> None:
    segments = record(5, [400, 5, 0, 1, 300])
    alone = identify([segments[0], segments[4]], history_length=3, future_inputs=mode)
    model = identify(segments, history_length=3, future_inputs=mode)
    for field in fields(model):
        np.testing.assert_array_equal(getattr(model, field.name), getattr(alone, field.name))


@given(lengths=st.lists(st.integers(0, 30), min_size=1, max_size=8), size=st.integers(1, 4))
@settings(deadline=None, max_examples=50)
def test_windows_are_those_of_each_segment_alone(record, lengths: list[int], size: int) -> None:
    segments = record(6, [80, *lengths])
    w = slow_windows(segments, size)
    model = identify(segments, history_length=size, order=1)
    np.testing.assert_allclose(model.past_mean, w.past.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(model.observation_mean, w.observations.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(model.action_mean, w.actions.mean(axis=0), atol=1e-12)


@pytest.mark.parametrize("kind", ["white", "held", "policy"])
def test_states_have_unit_covariance_on_the_training_windows(record, kind: str) -> None:
    segments = record(7, [500, 90, 300], kind)
    model = identify(segments, history_length=2, order=6)
    states = np.vstack([model.states(u, y)[2 : len(u) - 1] for u, y in segments])
    np.testing.assert_allclose(states.mean(axis=0), 0.0, atol=1e-10)
    np.testing.assert_allclose(states.T @ states / len(states), np.eye(6), atol=1e-9)


def test_projected_states_have_unit_covariance_beside_the_future_actions(record) -> None:
    segments = record(8, [500, 90, 300], "held")
    model = identify(segments, history_length=2, order=6, future_inputs="project")
    states = np.vstack([model.states(u, y)[2 : len(u) - 1] for u, y in segments])
    left = without(states, mean_free(slow_windows(segments, 2).future_actions))
    np.testing.assert_allclose(left.T @ left / len(left), np.eye(6), atol=1e-9)
    assert np.all(states.var(axis=0) > 1.0)


@pytest.mark.parametrize("mode", MODES)
def test_aic_is_that_of_the_residual_covariance_at_every_order(record, mode: str) -> None:
    segments = record(9, [400, 300], "held")
    windows, m, q = 400 + 300 - 2 * (2 * 2 - 1), INPUTS, OUTPUTS
    for n in range(1, 7):
        model = identify(segments, history_length=2, order=n, future_inputs=mode)
        expected = windows * np.linalg.slogdet(model.residual_covariance)[1] + 2 * (n * (n + m + q) + m * q)
        assert model.aic[n - 1] == pytest.approx(expected, rel=1e-9)
    assert len(model.aic) == len(model.contribution) == 6
    assert identify(segments, history_length=2, future_inputs=mode).order == np.argmin(model.aic) + 1


@pytest.mark.parametrize("mode", MODES)
def test_largest_standardised_weight_of_each_state_is_positive(record, mode: str) -> None:
    segments = record(10, [800])
    model = identify(segments, history_length=3, order=9, future_inputs=mode)
    u, y = segments[0]
    weights = model.memory_matrix * np.concatenate([np.tile(u.std(axis=0), 3), np.tile(y.std(axis=0), 3)])
    assert np.all(weights[np.arange(9), np.argmax(np.abs(weights), axis=1)] > 0.0)


# ------------------------------------------------------------------------------------------------- invariance


@pytest.mark.parametrize("mode", MODES)
@given(
    exponents=st.lists(st.floats(-6.0, 6.0), min_size=INPUTS + OUTPUTS, max_size=INPUTS + OUTPUTS),
    offsets=st.lists(st.floats(-100.0, 100.0), min_size=INPUTS + OUTPUTS, max_size=INPUTS + OUTPUTS),
)
@settings(deadline=None, max_examples=25)
def test_units_and_offsets_of_the_signals_do_not_matter(
    record, mode: str, exponents: list[float], offsets: list[float]
) -> None:
    scale = 10.0 ** np.array(exponents)
    shift = scale * np.array(offsets)
    (u, y), *_ = segments = record(11, [300], "held")
    other_u, other_y = u * scale[:INPUTS] + shift[:INPUTS], y * scale[INPUTS:] + shift[INPUTS:]
    model = identify(segments, future_inputs=mode)
    other = identify([(other_u, other_y)], future_inputs=mode)
    assert (other.history_length, other.order) == (model.history_length, model.order)
    np.testing.assert_allclose(other.contribution, model.contribution, atol=1e-7)
    np.testing.assert_allclose(other.states(other_u, other_y), model.states(u, y), atol=1e-5)
    predicted = (other.predict(other_u, other_y) - shift[INPUTS:]) / scale[INPUTS:]
    np.testing.assert_allclose(predicted, model.predict(u, y), atol=1e-5)


@pytest.mark.parametrize("mode", MODES)
@given(seed=st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=25)
def test_mu_do_not_change_when_observations_are_mixed(record, mode: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    left, right = (np.linalg.qr(rng.normal(size=(OUTPUTS, OUTPUTS)))[0] for _ in range(2))
    mixing = left @ np.diag(rng.uniform(0.1, 10.0, size=OUTPUTS)) @ right
    (u, y), *_ = segments = record(12, [300])
    model = identify(segments, history_length=2, order=4, future_inputs=mode)
    other = identify([(u, y @ mixing.T)], history_length=2, order=4, future_inputs=mode)
    np.testing.assert_allclose(other.contribution, model.contribution, atol=1e-9)
    np.testing.assert_allclose(other.predict(u, y @ mixing.T), model.predict(u, y) @ mixing.T, atol=1e-8)


# --------------------------------------------------------------------------------------------------- timing


@pytest.mark.parametrize("mode", MODES)
def test_states_and_predictions_use_earlier_rows_only(record, mode: str) -> None:
    segments = record(19, [300])
    model = identify(segments, history_length=3, order=4, future_inputs=mode)
    u, y = (signal.copy() for signal in segments[0])
    states, predictions = model.states(u, y), model.predict(u, y)
    y[100:], u[101:] = 1e3, 1e3
    np.testing.assert_array_equal(model.states(u, y)[:101], states[:101])
    np.testing.assert_array_equal(model.predict(u, y)[:101], predictions[:101])
    assert not np.allclose(model.states(u, y)[101], states[101])
    u[100] += 1.0
    np.testing.assert_array_equal(model.states(u, y)[:101], states[:101])
    np.testing.assert_allclose(model.predict(u, y)[100] - predictions[100], model.D.sum(axis=1))


def test_states_and_predictions_are_the_equations_row_by_row(record) -> None:
    (u, y), *_ = segments = record(20, [300])
    model = identify(segments, history_length=3, order=4)
    states, predictions = model.states(u, y), model.predict(u, y)
    assert states.shape == (300, 4)
    assert predictions.shape == (300, OUTPUTS)
    assert np.isnan(states[:3]).all()
    assert np.isnan(predictions[:3]).all()
    for t in range(3, 300):
        x = model.memory_matrix @ (slow_past((u, y), t, 3) - model.past_mean)
        np.testing.assert_allclose(states[t], x, atol=1e-10)
        expected = model.C @ x + model.D @ (u[t] - model.action_mean) + model.observation_mean
        np.testing.assert_allclose(predictions[t], expected, atol=1e-10)


def test_latest_state_is_the_next_row(record) -> None:
    (u, y), *_ = segments = record(21, [300])
    model = identify(segments, history_length=3, order=4)
    states = model.states(u, y)
    for t in (3, 4, 299):
        np.testing.assert_allclose(model.latest_state(u[:t], y[:t]), states[t], atol=1e-12)
        np.testing.assert_allclose(model.latest_state(u[t - 3 : t], y[t - 3 : t]), states[t], atol=1e-12)
    assert np.isnan(model.latest_state(u[:2], y[:2])).all()


def test_a_gap_leaves_the_history_incomplete(record) -> None:
    segments = record(22, [300])
    model = identify(segments, history_length=3, order=4)
    u, y = (signal.copy() for signal in segments[0])
    y[50, 1] = np.nan
    incomplete = np.isnan(model.states(u, y)).any(axis=1)
    assert list(np.flatnonzero(incomplete)) == [0, 1, 2, 51, 52, 53]
    assert list(np.flatnonzero(np.isnan(model.predict(u, y)).any(axis=1))) == [0, 1, 2, 51, 52, 53]


@pytest.mark.parametrize("steps", [0, 1, 2])
def test_segments_shorter_than_the_history_have_no_states(record, steps: int) -> None:
    (u, y), *_ = segments = record(23, [300])
    model = identify(segments, history_length=3, order=4)
    states, predictions = model.states(u[:steps], y[:steps]), model.predict(u[:steps], y[:steps])
    assert states.shape == (steps, 4)
    assert predictions.shape == (steps, OUTPUTS)
    assert np.isnan(states).all()
    assert np.isnan(predictions).all()


def test_model_describes_itself_and_is_frozen(record) -> None:
    model = identify(record(24, [300]), history_length=3, order=4)
    assert (model.inputs, model.outputs, model.history_length, model.order) == (INPUTS, OUTPUTS, 3, 4)
    assert model.memory_matrix.shape == (4, 15)
    assert model.past_mean.shape == (15,)
    assert (model.A.shape, model.B.shape, model.C.shape, model.D.shape) == ((4, 4), (4, 2), (3, 4), (3, 2))
    assert model.residual_covariance.shape == (3, 3)
    assert np.all(np.diff(model.contribution) <= 0.0)
    with pytest.raises(FrozenInstanceError):
        model.order = 5  # type: ignore[misc]
