"""Local prediction models against independent references: statsmodels, the appendix by loops, the Kalman
filter."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import FrozenInstanceError, dataclass, fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import block_diag, inv, solve_discrete_are, sqrtm
from statsmodels.multivariate.cancorr import CanCorr

from behaviors.lpm import MAX_HISTORY_LENGTH, LocalPredictionModel, PersistentExcitationWarning, identify

Array = NDArray[np.float64]
Segment = tuple[Array, Array]
Policy = Callable[[Array], Array]

STATES, INPUTS, OUTPUTS = 4, 2, 3
NOISE = 0.1
MODES = ["keep", "project"]


# ----------------------------------------------------------------------------------------------- true systems


@dataclass(frozen=True)
class Systems:
    """Many x_{t+1} = A x_t + B u_t + w_t, y_t = C x_t + D u_t + v_t; w and v white, deviation NOISE, (A.1).

    Matrices and signals have a leading axis of systems.
    """

    A: Array
    B: Array
    C: Array
    D: Array

    def simulate(self, rng: np.random.Generator, steps: int, kind: str) -> Segment:
        """Actions (systems, steps, m) and the observations (systems, steps, q) that they led to."""
        count = len(self.A)
        act = _INPUTS[kind](rng, count)
        x, y = np.zeros((count, STATES)), np.zeros((count, OUTPUTS))
        w = NOISE * rng.normal(size=(steps, count, STATES))
        v = NOISE * rng.normal(size=(steps, count, OUTPUTS))
        actions, observations = np.empty((count, steps, INPUTS)), np.empty((count, steps, OUTPUTS))
        for t in range(steps):
            u = act(y)
            y = times(self.C, x) + times(self.D, u) + v[t]
            x = times(self.A, x) + times(self.B, u) + w[t]
            actions[:, t], observations[:, t] = u, y
        return actions, observations

    def kalman_predictions(self, actions: Array, observations: Array) -> Array:
        """Best possible one-step predictions: the stationary Kalman filter of each true system."""
        state_noise, noise = NOISE**2 * np.eye(STATES), NOISE**2 * np.eye(OUTPUTS)
        gain = np.empty((len(self.A), STATES, OUTPUTS))
        for i, (A, C) in enumerate(zip(self.A, self.C, strict=True)):
            covariance = solve_discrete_are(A.T, C.T, state_noise, noise)
            gain[i] = A @ covariance @ C.T @ inv(C @ covariance @ C.T + noise)
        x, predictions = np.zeros((len(self.A), STATES)), np.empty_like(observations)
        for t in range(actions.shape[1]):
            u = actions[:, t]
            predictions[:, t] = times(self.C, x) + times(self.D, u)
            x = times(self.A, x) + times(self.B, u) + times(gain, observations[:, t] - predictions[:, t])
        return predictions


def times(matrices: Array, vectors: Array) -> Array:
    """Product of each matrix with its vector."""
    return np.matmul(matrices, vectors[..., None])[..., 0]


def random_systems(rng: np.random.Generator, count: int) -> Systems:
    """Eigenvalues of modulus 0.5 to 0.95, real ones and pairs, in random orthogonal bases."""
    A = np.empty((count, STATES, STATES))
    for i in range(count):
        blocks: list[Array] = []
        while (left := STATES - sum(len(block) for block in blocks)) > 0:
            modulus = rng.uniform(0.5, 0.95)
            if left >= 2 and rng.random() < 0.5:
                angle = rng.uniform(0.2, np.pi - 0.2)
                turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
                blocks.append(modulus * turn)
            else:
                blocks.append(np.array([[modulus * rng.choice([-1.0, 1.0])]]))
        basis = np.linalg.qr(rng.normal(size=(STATES, STATES)))[0]
        A[i] = basis @ block_diag(*blocks) @ basis.T
    return Systems(
        A=A,
        B=rng.normal(size=(count, STATES, INPUTS)),
        C=rng.normal(size=(count, OUTPUTS, STATES)),
        D=rng.normal(size=(count, OUTPUTS, INPUTS)),
    )


def _white(rng: np.random.Generator, count: int) -> Policy:
    return lambda _: rng.normal(size=(count, INPUTS))


def _held(rng: np.random.Generator, count: int) -> Policy:
    """Primitives of {-1, 0, 1}, each held for 1 to 20 steps."""
    action, left = np.zeros((count, INPUTS)), np.zeros((count, 1), dtype=np.int64)

    def act(_: Array) -> Array:
        nonlocal action, left
        action = np.where(left == 0, rng.integers(-1, 2, size=action.shape), action)
        left = np.where(left == 0, rng.integers(1, 21, size=left.shape), left) - 1
        return action

    return act


def _policy(rng: np.random.Generator, count: int) -> Policy:
    """Feedback: the signs of fixed combinations of the last observation, 20 % random primitives."""
    gain = rng.normal(size=(count, INPUTS, OUTPUTS))

    def act(observation: Array) -> Array:
        primitive = rng.integers(-1, 2, size=(count, INPUTS))
        return np.where(rng.random((count, 1)) < 0.2, primitive, np.sign(times(gain, observation)))

    return act


_INPUTS = {"white": _white, "held": _held, "policy": _policy}


def record(seed: int, lengths: list[int], kind: str = "white") -> list[Segment]:
    """Segments of one random system."""
    rng = np.random.default_rng(seed)
    system = random_systems(rng, 1)
    return [(u[0], y[0]) for u, y in (system.simulate(rng, steps, kind) for steps in lengths)]


def rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error**2)))


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
def test_mu_equals_the_canonical_correlations_of_statsmodels(size: int) -> None:
    segments = record(1, [300, 40, 7, 500])
    w = slow_windows(segments, size)
    reference = CanCorr(w.future, w.past).cancorr
    model = identify(segments, history_length=size, order=1)
    np.testing.assert_allclose(model.contribution, reference, atol=1e-10)


@pytest.mark.parametrize("size", [1, 2, 4])
def test_projected_mu_equals_the_partial_canonical_correlations_of_statsmodels(size: int) -> None:
    segments = record(2, [300, 40, 7, 500], "held")
    w = slow_windows(segments, size)
    given = mean_free(w.future_actions)
    reference = CanCorr(without(mean_free(w.future), given), without(mean_free(w.past), given)).cancorr
    model = identify(segments, history_length=size, order=1, future_inputs="project")
    np.testing.assert_allclose(model.contribution, reference, atol=1e-10)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("kind", ["white", "held", "policy"])
@pytest.mark.parametrize("size", [3, None])
def test_model_equals_the_appendix_by_loops_and_never_crosses_segments(mode: str, kind: str, size: int | None) -> None:
    segments = record(3, [60, 5, 200, 3, 6, 31, 100], kind)
    model = identify(segments, history_length=size, order=4, future_inputs=mode)
    reference = slow_identify(segments, model.history_length, 4, mode)
    turn = np.diag(signs(model, reference["memory_matrix"]))
    reference["memory_matrix"] = turn @ reference["memory_matrix"]
    reference["A"], reference["B"] = turn @ reference["A"] @ turn, turn @ reference["B"]
    reference["C"] = reference["C"] @ turn
    for name, expected in reference.items():
        np.testing.assert_allclose(getattr(model, name), expected, atol=1e-8, err_msg=name)


def test_joining_two_segments_would_change_the_model() -> None:
    segments = record(4, [150, 150])
    joined = [(np.vstack([segments[0][0], segments[1][0]]), np.vstack([segments[0][1], segments[1][1]]))]
    apart, together = identify(segments, history_length=3), identify(joined, history_length=3)
    assert not np.allclose(apart.contribution, together.contribution, atol=1e-6)


@pytest.mark.parametrize("mode", MODES)
def test_segments_without_a_window_are_skipped(mode: str) -> None:
    segments = record(5, [400, 5, 0, 1, 300])
    alone = identify([segments[0], segments[4]], history_length=3, future_inputs=mode)
    model = identify(segments, history_length=3, future_inputs=mode)
    for field in fields(model):
        np.testing.assert_array_equal(getattr(model, field.name), getattr(alone, field.name))


@given(lengths=st.lists(st.integers(0, 30), min_size=1, max_size=8), size=st.integers(1, 4))
@settings(deadline=None, max_examples=50)
def test_windows_are_those_of_each_segment_alone(lengths: list[int], size: int) -> None:
    segments = record(6, [80, *lengths])
    w = slow_windows(segments, size)
    model = identify(segments, history_length=size, order=1)
    np.testing.assert_allclose(model.past_mean, w.past.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(model.observation_mean, w.observations.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(model.action_mean, w.actions.mean(axis=0), atol=1e-12)


@pytest.mark.parametrize("kind", ["white", "held", "policy"])
def test_states_have_unit_covariance_on_the_training_windows(kind: str) -> None:
    segments = record(7, [500, 90, 300], kind)
    model = identify(segments, history_length=2, order=6)
    states = np.vstack([model.states(u, y)[2 : len(u) - 1] for u, y in segments])
    np.testing.assert_allclose(states.mean(axis=0), 0.0, atol=1e-10)
    np.testing.assert_allclose(states.T @ states / len(states), np.eye(6), atol=1e-9)


def test_projected_states_have_unit_covariance_beside_the_future_actions() -> None:
    segments = record(8, [500, 90, 300], "held")
    model = identify(segments, history_length=2, order=6, future_inputs="project")
    states = np.vstack([model.states(u, y)[2 : len(u) - 1] for u, y in segments])
    left = without(states, mean_free(slow_windows(segments, 2).future_actions))
    np.testing.assert_allclose(left.T @ left / len(left), np.eye(6), atol=1e-9)
    assert np.all(states.var(axis=0) > 1.0)


@pytest.mark.parametrize("mode", MODES)
def test_aic_is_that_of_the_residual_covariance_at_every_order(mode: str) -> None:
    segments = record(9, [400, 300], "held")
    windows, m, q = 400 + 300 - 2 * (2 * 2 - 1), INPUTS, OUTPUTS
    for n in range(1, 7):
        model = identify(segments, history_length=2, order=n, future_inputs=mode)
        expected = windows * np.linalg.slogdet(model.residual_covariance)[1] + 2 * (n * (n + m + q) + m * q)
        assert model.aic[n - 1] == pytest.approx(expected, rel=1e-9)
    assert len(model.aic) == len(model.contribution) == 6
    assert identify(segments, history_length=2, future_inputs=mode).order == np.argmin(model.aic) + 1


@pytest.mark.parametrize("mode", MODES)
def test_largest_standardised_weight_of_each_state_is_positive(mode: str) -> None:
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
    mode: str, exponents: list[float], offsets: list[float]
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
def test_mu_do_not_change_when_observations_are_mixed(mode: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    left, right = (np.linalg.qr(rng.normal(size=(OUTPUTS, OUTPUTS)))[0] for _ in range(2))
    mixing = left @ np.diag(rng.uniform(0.1, 10.0, size=OUTPUTS)) @ right
    (u, y), *_ = segments = record(12, [300])
    model = identify(segments, history_length=2, order=4, future_inputs=mode)
    other = identify([(u, y @ mixing.T)], history_length=2, order=4, future_inputs=mode)
    np.testing.assert_allclose(other.contribution, model.contribution, atol=1e-9)
    np.testing.assert_allclose(other.predict(u, y @ mixing.T), model.predict(u, y) @ mixing.T, atol=1e-8)


# --------------------------------------------------------------------------------------------- true systems


@pytest.mark.parametrize("kind", ["white", "held", "policy"])
def test_projecting_finds_the_true_order(kind: str) -> None:
    rng = np.random.default_rng(1000)
    recorded = random_systems(rng, 60).simulate(rng, 5000, kind)
    orders = [
        identify([segment], history_length=4, future_inputs="project").order for segment in zip(*recorded, strict=True)
    ]
    assert np.mean(np.array(orders) == STATES) >= 0.95


def test_keeping_held_inputs_spends_states_on_them() -> None:
    rng = np.random.default_rng(1001)
    recorded = random_systems(rng, 15).simulate(rng, 5000, "held")
    orders = [identify([segment], history_length=4).order for segment in zip(*recorded, strict=True)]
    assert np.median(orders) > STATES


@dataclass(frozen=True)
class Benchmark:
    """Recorded systems with the error of the best predictor of each on the test data, steps 50 and later."""

    train: list[Segment]
    test: list[Segment]
    kalman_error: list[float]


@pytest.fixture(scope="module")
def benchmark_systems() -> Benchmark:
    rng = np.random.default_rng(2000)
    systems = random_systems(rng, 12)
    train, test = (systems.simulate(rng, 5000, "white") for _ in range(2))
    error = (systems.kalman_predictions(*test) - test[1])[:, 50:]
    return Benchmark(
        train=list(zip(*train, strict=True)),
        test=list(zip(*test, strict=True)),
        kalman_error=[rms(of_one) for of_one in error],
    )


def regression_error(train: Segment, test: Segment, size: int) -> float:
    """Error of y_t regressed on l steps of history and u_t directly, without a state in between."""
    (old, old_y), (new, new_y) = (
        (
            np.column_stack([*(np.hstack(data)[size - k : -k] for k in range(1, size + 1)), data[0][size:]]),
            data[1],
        )
        for data in (train, test)
    )
    coefficients = np.linalg.lstsq(old, old_y[size:], rcond=None)[0]
    return rms((new @ coefficients - new_y[size:])[50 - size :])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("size", [3, 4, 5])
def test_prediction_is_nearly_that_of_the_kalman_filter(mode: str, size: int, benchmark_systems: Benchmark) -> None:
    to_kalman, to_regression = [], []
    for train, test, kalman_error in zip(*vars(benchmark_systems).values(), strict=True):
        model = identify([train], history_length=size, future_inputs=mode)
        error = rms((model.predict(*test) - test[1])[50:])
        to_kalman.append(error / kalman_error)
        to_regression.append(error / regression_error(train, test, size))
    assert np.median(to_kalman) < 1.10
    assert min(to_kalman) > 0.99
    assert max(to_regression) < 1.03


# ----------------------------------------------------------------------------------------- history length


def autoregressive(lags: int, steps: int = 4000) -> list[Segment]:
    """y_t = 0.2 u_t + sum of 0.9 / lags y_{t-k} + noise: each lag up to `lags` matters by itself."""
    rng = np.random.default_rng(13)
    u, y = rng.normal(size=(steps, 1)), np.zeros((steps, 1))
    for t in range(steps):
        y[t] = 0.2 * u[t] + 0.1 * rng.normal() + (0.9 / max(lags, 1)) * y[max(t - lags, 0) : t].sum()
    return [(u, y)]


def test_history_is_lengthened_while_it_pays() -> None:
    assert identify(autoregressive(0)).history_length == 1
    assert identify(autoregressive(2)).history_length == 2


@pytest.mark.parametrize("mode", MODES)
def test_history_stops_where_the_norm_of_r_gains_less_than_5_percent(mode: str) -> None:
    segments = record(14, [3000])
    deviation = segments[0][1].std(axis=0)
    models = [identify(segments, history_length=size, future_inputs=mode) for size in range(1, 8)]
    norms = [np.linalg.norm(model.residual_covariance / np.outer(deviation, deviation), 2) for model in models]
    gains = 1.0 - np.array(norms[1:]) / np.array(norms[:-1])
    expected = int(np.argmax(gains < 0.05)) + 1
    assert identify(segments, future_inputs=mode).history_length == expected
    assert expected > 1


def test_threshold_ends_the_lengthening() -> None:
    segments = record(14, [3000])
    free = identify(segments)
    assert free.history_length > 1
    assert identify(segments, threshold=float(OUTPUTS)).history_length == 1  # the norm is at most the trace
    assert identify(segments, threshold=1e-9).history_length == free.history_length


def test_few_data_keep_the_history_short() -> None:
    (u, y), *_ = record(14, [3000])
    assert identify([(u[:60], y[:60])]).history_length <= 3  # 5 windows a variable: 55 of 5 * 24 would be needed


def test_history_starts_where_the_order_is_possible() -> None:
    model = identify(record(15, [2000]), order=7)
    assert model.order == 7
    assert model.history_length >= 3


def test_a_given_history_may_be_longer_than_those_tried() -> None:
    model = identify(record(16, [1500]), history_length=MAX_HISTORY_LENGTH + 2)
    assert model.memory_matrix.shape == (model.order, (MAX_HISTORY_LENGTH + 2) * (INPUTS + OUTPUTS))


# ------------------------------------------------------------------------------------- degenerate features


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("size", [1, 3, None])
def test_exactly_dependent_features_change_nothing(mode: str, size: int | None) -> None:
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
def test_a_system_without_noise_gives_finite_results(mode: str) -> None:
    rng = np.random.default_rng(18)
    system = random_systems(rng, 1)
    u, x, y = rng.normal(size=(400, 1, INPUTS)), np.zeros((1, STATES)), np.empty((400, 1, OUTPUTS))
    for t in range(400):
        y[t] = times(system.C, x) + times(system.D, u[t])
        x = times(system.A, x) + times(system.B, u[t])
    segments = [(u[:, 0], y[:, 0])]
    for size in (1, 2, 3, None):
        model = identify(segments, history_length=size, future_inputs=mode)
        for field in fields(model):
            assert np.isfinite(getattr(model, field.name)).all(), field.name
        assert np.all(model.contribution <= 1.0)
    if mode == "project":  # what is kept of future inputs disturbs the directions, and the prediction is not exact
        assert (model.history_length, model.order) == (2, STATES)  # 2 * 3 observations determine 4 states
        np.testing.assert_allclose(model.predict(*segments[0])[2:], segments[0][1][2:], atol=1e-9)


# --------------------------------------------------------------------------------------------------- timing


@pytest.mark.parametrize("mode", MODES)
def test_states_and_predictions_use_earlier_rows_only(mode: str) -> None:
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


def test_states_and_predictions_are_the_equations_row_by_row() -> None:
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


def test_latest_state_is_the_next_row() -> None:
    (u, y), *_ = segments = record(21, [300])
    model = identify(segments, history_length=3, order=4)
    states = model.states(u, y)
    for t in (3, 4, 299):
        np.testing.assert_allclose(model.latest_state(u[:t], y[:t]), states[t], atol=1e-12)
        np.testing.assert_allclose(model.latest_state(u[t - 3 : t], y[t - 3 : t]), states[t], atol=1e-12)
    assert np.isnan(model.latest_state(u[:2], y[:2])).all()


def test_a_gap_leaves_the_history_incomplete() -> None:
    segments = record(22, [300])
    model = identify(segments, history_length=3, order=4)
    u, y = (signal.copy() for signal in segments[0])
    y[50, 1] = np.nan
    incomplete = np.isnan(model.states(u, y)).any(axis=1)
    assert list(np.flatnonzero(incomplete)) == [0, 1, 2, 51, 52, 53]
    assert list(np.flatnonzero(np.isnan(model.predict(u, y)).any(axis=1))) == [0, 1, 2, 51, 52, 53]


@pytest.mark.parametrize("steps", [0, 1, 2])
def test_segments_shorter_than_the_history_have_no_states(steps: int) -> None:
    (u, y), *_ = segments = record(23, [300])
    model = identify(segments, history_length=3, order=4)
    states, predictions = model.states(u[:steps], y[:steps]), model.predict(u[:steps], y[:steps])
    assert states.shape == (steps, 4)
    assert predictions.shape == (steps, OUTPUTS)
    assert np.isnan(states).all()
    assert np.isnan(predictions).all()


def test_model_describes_itself_and_is_frozen() -> None:
    model = identify(record(24, [300]), history_length=3, order=4)
    assert (model.inputs, model.outputs, model.history_length, model.order) == (INPUTS, OUTPUTS, 3, 4)
    assert model.memory_matrix.shape == (4, 15)
    assert model.past_mean.shape == (15,)
    assert (model.A.shape, model.B.shape, model.C.shape, model.D.shape) == ((4, 4), (4, 2), (3, 4), (3, 2))
    assert model.residual_covariance.shape == (3, 3)
    assert np.all(np.diff(model.contribution) <= 0.0)
    with pytest.raises(FrozenInstanceError):
        model.order = 5  # type: ignore[misc]


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
def test_weak_excitation_warns_and_gives_a_finite_model(mode: str, actions: Callable[[Array], Array]) -> None:
    (u, y), *_ = record(25, [500])
    with pytest.warns(PersistentExcitationWarning, match="not persistently exciting of order") as caught:
        model = identify([(actions(u), y)], history_length=3, order=3, future_inputs=mode)
    assert [warning.filename for warning in caught] == [__file__]
    for field in fields(model):
        assert np.isfinite(getattr(model, field.name)).all(), field.name


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("kind", ["white", "held", "policy"])
def test_sufficient_excitation_does_not_warn(mode: str, kind: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        identify(record(26, [1000], kind), history_length=4, future_inputs=mode)


def test_needed_order_of_excitation_is_lower_where_future_inputs_are_kept() -> None:
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
