"""Orders and history lengths of local prediction models, against systems whose order and best prediction are known."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import pytest
from numpy.typing import NDArray

from behaviors.lpm import MAX_HISTORY_LENGTH, identify

Array = NDArray[np.float64]
Segment = tuple[Array, Array]

STATES, INPUTS, OUTPUTS = 4, 2, 3  # of random systems
MODES = ["keep", "project"]


def rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error**2)))


# --------------------------------------------------------------------------------------------- true systems


@pytest.mark.parametrize("kind", ["white", "held", "policy"])
@pytest.mark.parametrize("options", [{}, {"history_length": 4}, {"history_rule": "aic"}], ids=["l", "l-4", "l-aic"])
@pytest.mark.slow
def test_projecting_finds_the_true_order(random_systems, kind: str, options: dict[str, object]) -> None:
    rng = np.random.default_rng(1000)
    recorded = random_systems(rng, 60).simulate(rng, 5000, kind)
    orders = [identify([segment], future_inputs="project", **options).order for segment in zip(*recorded, strict=True)]
    assert np.mean(np.array(orders) == STATES) >= 0.95


@pytest.mark.slow
def test_an_order_that_is_missed_says_nothing_of_the_next_observation(random_systems) -> None:
    rng = np.random.default_rng(1000)
    systems = random_systems(rng, 60)
    train, test = (systems.simulate(rng, 5000, "held") for _ in range(2))
    kalman = systems.kalman_predictions(*test)
    missed = 0
    for i in range(60):
        model = identify([(train[0][i], train[1][i])], future_inputs="project", history_rule="aic")
        if model.order != STATES:
            u, y = test[0][i], test[1][i]
            missed += 1
            assert model.order == STATES - 1
            assert rms((model.predict(u, y) - y)[50:]) < 1.005 * rms((kalman[i] - y)[50:])
    assert missed > 0


def test_keeping_held_inputs_spends_states_on_them(random_systems) -> None:
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
def benchmark_systems(random_systems) -> Benchmark:
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


def test_free_parameters_are_counted_without_the_choice_of_axes(record) -> None:
    segments = record(32, [600], "held")
    plain, free = (identify(segments, history_length=3, parameter_count=count) for count in ("entries", "free"))
    n, m, q = np.arange(1, len(plain.aic) + 1), INPUTS, OUTPUTS
    entries, innovations = n * (n + m + q) + m * q, 2 * n * q + n * m + m * q + q * (q + 1) / 2
    np.testing.assert_allclose(free.aic - plain.aic, 2 * (innovations - entries), atol=1e-8)
    assert free.order == np.argmin(free.aic) + 1


# ----------------------------------------------------------------------------------------- history length


def autoregressive(lags: int, steps: int = 4000) -> list[Segment]:
    """y_t = 0.2 u_t + sum of 0.9 / lags y_{t-k} + noise: each lag up to `lags` matters by itself."""
    rng = np.random.default_rng(13)
    u, y = rng.normal(size=(steps, 1)), np.zeros((steps, 1))
    for t in range(steps):
        y[t] = 0.2 * u[t] + 0.1 * rng.normal() + (0.9 / max(lags, 1)) * y[max(t - lags, 0) : t].sum()
    return [(u, y)]


@pytest.mark.parametrize("rule", ["norm", "gain"])
def test_history_is_lengthened_while_it_pays(rule: str) -> None:
    assert identify(autoregressive(0), history_rule=rule).history_length == 1
    assert identify(autoregressive(2), history_rule=rule).history_length == 2


def norms_of_r(segments: list[Segment], mode: str) -> Array:
    """Norm of R of standardised observations for each history length, at the order of the smallest AIC."""
    deviation = segments[0][1].std(axis=0)
    sizes = range(1, MAX_HISTORY_LENGTH + 1)
    found = [identify(segments, history_length=size, future_inputs=mode).residual_covariance for size in sizes]
    return np.array([np.linalg.norm(covariance / np.outer(deviation, deviation), 2) for covariance in found])


@pytest.mark.parametrize("mode", MODES)
def test_rule_gain_stops_where_the_norm_of_r_gains_less_than_5_percent(record, mode: str) -> None:
    segments = record(14, [3000])
    norms = norms_of_r(segments, mode)
    expected = int(np.argmax(norms[1:] > 0.95 * norms[:-1])) + 1
    assert identify(segments, future_inputs=mode, history_rule="gain").history_length == expected
    assert expected > 1


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("seed", [14, 15, 16])
def test_rule_norm_takes_the_shortest_history_within_1_percent_of_the_smallest_norm(record, mode, seed) -> None:
    segments = record(seed, [3000])
    sizes = np.arange(1, MAX_HISTORY_LENGTH + 1)
    windows, slopes = 3000 - 2 * sizes + 1, sizes * (INPUTS + OUTPUTS) + INPUTS
    norms = norms_of_r(segments, mode) * windows / (windows - slopes)  # as if R were not of the sample itself
    expected = int(np.argmax(norms <= 1.01 * norms.min())) + 1
    assert identify(segments, future_inputs=mode).history_length == expected


@pytest.mark.parametrize("rule", ["norm", "gain"])
def test_threshold_ends_the_lengthening(record, rule: str) -> None:
    segments = record(14, [3000])
    free = identify(segments, history_rule=rule)
    assert free.history_length > 1
    ended = identify(segments, history_rule=rule, threshold=float(OUTPUTS))  # the norm is at most the trace
    assert ended.history_length == 1
    assert identify(segments, history_rule=rule, threshold=1e-9).history_length == free.history_length


def test_rule_aic_takes_the_length_that_is_true() -> None:
    for lags in (1, 2, 5):
        assert identify(autoregressive(lags), history_rule="aic").history_length == lags


@pytest.mark.parametrize("kind", ["white", "held"])
def test_rule_aic_takes_the_best_regression_on_common_rows(record, kind: str) -> None:
    segments = record(30, [700, 12, 5, 11, 400], kind)
    rows = [(u, y, t) for u, y in segments for t in range(MAX_HISTORY_LENGTH, len(u))]
    targets = np.array([y[t] for _, y, t in rows])
    aic = []
    for size in range(1, MAX_HISTORY_LENGTH + 1):
        past = [np.concatenate([[1.0], u[t], u[t - size : t].ravel(), y[t - size : t].ravel()]) for u, y, t in rows]
        error = targets - np.array(past) @ np.linalg.lstsq(np.array(past), targets, rcond=None)[0]
        slopes = OUTPUTS * (size * (INPUTS + OUTPUTS) + INPUTS)
        aic.append(len(rows) * np.linalg.slogdet(error.T @ error / len(rows))[1] + 2 * slopes)
    expected = int(np.argmin(aic)) + 1
    assert expected > 1
    assert identify(segments, history_rule="aic").history_length == expected


@pytest.mark.parametrize("mode", MODES)
def test_rule_aic_lengthens_the_history_to_where_the_order_is_possible(mode: str) -> None:
    model = identify(autoregressive(2), history_rule="aic", order=6, future_inputs=mode)
    assert (model.history_length, model.order) == (6, 6)


def test_rule_is_without_effect_where_the_length_is_given(record) -> None:
    segments = record(31, [600])
    plain, other = (identify(segments, history_length=3, history_rule=rule) for rule in ("gain", "aic"))
    for field in fields(plain):
        np.testing.assert_array_equal(getattr(plain, field.name), getattr(other, field.name))


def test_few_data_keep_the_history_short(record) -> None:
    (u, y), *_ = record(14, [3000])
    assert identify([(u[:60], y[:60])]).history_length <= 3  # 5 windows a variable: 55 of 5 * 24 would be needed


def test_history_starts_where_the_order_is_possible(record) -> None:
    model = identify(record(15, [2000]), order=7)
    assert model.order == 7
    assert model.history_length >= 3


def test_a_given_history_may_be_longer_than_those_tried(record) -> None:
    model = identify(record(16, [1500]), history_length=MAX_HISTORY_LENGTH + 2)
    assert model.memory_matrix.shape == (model.order, (MAX_HISTORY_LENGTH + 2) * (INPUTS + OUTPUTS))
