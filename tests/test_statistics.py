"""Intervals, against printed tables, closed forms and another library."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from statsmodels.stats.proportion import proportion_confint

from coevo.statistics import LEVEL, mean_interval, share_interval

# Student's t, upper 2.5 %, as in every printed table: by degrees of freedom.
T_TABLE = {1: 12.706, 2: 4.303, 4: 2.776, 9: 2.262, 30: 2.042}


@pytest.mark.parametrize(("freedom", "t"), T_TABLE.items())
def test_the_interval_of_a_mean_is_students_by_the_printed_table(freedom, t):
    values = np.arange(freedom + 1.0)
    mean, low, high = mean_interval(values)
    error = values.std(ddof=1) / math.sqrt(len(values))
    assert mean == values.mean()
    assert high - mean == pytest.approx(t * error, rel=2e-4)
    assert mean - low == pytest.approx(high - mean)


def test_of_two_values_the_interval_has_a_closed_form():
    # With one degree of freedom t is Cauchy's: its quantile is tan(pi * (p - 1/2)).
    assert mean_interval([1.0, 3.0]) == pytest.approx((2.0, *(2.0 + s * math.tan(0.475 * math.pi) for s in (-1, 1))))


@pytest.mark.parametrize("values", [[0.3], [0.0, 0.0, 0.0], np.array([2.5, 2.5])])
def test_one_value_and_equal_values_are_their_own_interval(values):
    assert mean_interval(values) == (values[0],) * 3


def test_the_interval_holds_the_mean_in_95_of_100_cases():
    drawn = np.random.default_rng(1).normal(3.0, 2.0, (2000, 6))
    inside = [low <= 3.0 <= high for _, low, high in map(mean_interval, drawn)]
    assert abs(np.mean(inside) - LEVEL) < 3.0 * math.sqrt(LEVEL * (1.0 - LEVEL) / 2000)


@given(st.integers(1, 3000), st.floats(0.0, 1.0))
def test_the_interval_of_a_share_is_that_of_statsmodels(count, share):
    successes = round(share * count)
    low, high = share_interval(successes, count)
    assert (low, high) == pytest.approx(proportion_confint(successes, count, alpha=0.05, method="wilson"), abs=1e-12)
    assert 0.0 <= low <= successes / count + 1e-12
    assert successes / count - 1e-12 <= high <= 1.0


@pytest.mark.parametrize("trials", [1, 10, 1000])
def test_of_no_successes_wilsons_interval_has_a_closed_form(trials):
    # (2.13) of Wilson (1927) with a share of 0: from 0 to z^2 / (n + z^2).
    z2 = 1.959963984540054**2
    assert share_interval(0, trials) == pytest.approx((0.0, z2 / (trials + z2)), abs=1e-15)
    assert share_interval(trials, trials) == pytest.approx((trials / (trials + z2), 1.0))


def test_scipy_is_loaded_only_when_an_interval_is_asked_for():
    code = "import sys, coevo.statistics; assert 'scipy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)  # noqa: S603 - our own
