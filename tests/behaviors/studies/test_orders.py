import json

import numpy as np
import pytest
from click.testing import CliRunner

from behaviors.lpm import identify
from behaviors.studies.orders import norms, orders, prediction_error, whole_pixels


def test_whole_pixels_round_what_is_seen_only() -> None:
    actions, seen = np.array([[0.4, 0.6]]), np.array([[1.4, 1.6, -0.7]])
    ((same, rounded),) = whole_pixels([(actions, seen)])
    np.testing.assert_array_equal(same, actions)
    np.testing.assert_array_equal(rounded, [[1.0, 2.0, -1.0]])


@pytest.mark.parametrize("future", ["keep", "project"])
def test_history_of_the_rule_is_where_the_norms_stop_falling(record, future) -> None:
    segments = record(40, [1500, 700])
    found = np.array(norms(segments, future, 5))
    assert np.all((found > 0.0) & (found < 3.0))  # at most the trace
    scaled = [(u, 1e3 * y + 7.0) for u, y in segments]
    np.testing.assert_allclose(norms(scaled, future, 5), found)
    model = identify(segments, future_inputs=future, history_rule="gain")
    assert model.history_length == int(np.argmax(found[1:] > 0.95 * found[:-1])) + 1


def test_prediction_error_is_of_the_second_feature(record) -> None:
    segments = record(41, [900])
    model = identify(segments, history_length=2)
    (u, y), *_ = segments
    error = (y - model.predict(u, y))[2:, 1]
    rms, relative = prediction_error(model, segments)
    assert rms == pytest.approx(np.sqrt(np.mean(error**2)))
    assert relative == pytest.approx(rms / y[2:, 1].std())


@pytest.mark.slow
def test_table_of_a_small_study(tmp_path) -> None:
    out = tmp_path / "orders.json"
    options = ["--noise", "0", "--noise", "2", "--seeds", "1", "--windows", "1000", "--out", str(out)]
    result = CliRunner().invoke(orders, options, catch_exceptions=False)
    told = json.loads(out.read_text(encoding="utf-8"))
    assert len(told) == 3 * 3 * 2 * 3  # objects, sights, future inputs, rules
    assert {one["sight"] for one in told} == {"0 px", "whole pixels", "2 px"}
    assert all(1 <= one["order"] <= len(one["contribution"]) for one in told)
    assert all(0.0 < one["relative_error"] < 2.0 for one in told)
    assert len([line for line in result.stdout.splitlines() if line.startswith("ball")]) == 18
