"""Intervals, against printed tables, closed forms and another library."""

from __future__ import annotations

import itertools
import json
import math
import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats
from statsmodels.stats.nonparametric import rank_compare_2indep
from statsmodels.stats.proportion import proportion_confint

from analysis.calibration.coverage import DISTRIBUTIONS, coverage, covered, improvement_covered
from coevo.statistics import (
    LEVEL,
    bootstrap_interval,
    estimate,
    mean_interval,
    median_interval,
    probability_of_improvement,
    share_interval,
)

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


@pytest.mark.parametrize("count", range(1, 31))
def test_the_interval_of_a_median_is_the_narrowest_that_holds_it_in_95_of_100_cases(count):
    # Between the places r and n + 1 - r it lies unless fewer than r values are on one side of it, as of coins thrown.
    covered_by = {
        r: 1.0 - 2.0 * sum(math.comb(count, i) for i in range(r)) / 2**count for r in range(1, count // 2 + 1)
    }
    places = [r for r, share in covered_by.items() if share >= LEVEL]
    values = np.random.default_rng(count).permutation(np.arange(1.0, count + 1.0))
    expected = (max(places), count + 1 - max(places)) if places else (-math.inf, math.inf)
    assert median_interval(values) == ((count + 1) / 2, *expected)


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


# Of few enough digits that sums of them, and differences, are not lost in rounding.
NUMBERS = st.integers(-1000, 1000).map(lambda number: number / 8)
RUNS = st.integers(8, 14).flatmap(lambda runs: arrays(float, runs, elements=NUMBERS))


@pytest.mark.parametrize(("runs", "kept"), [(1, 1), (2, 2), (3, 3), (4, 2), (5, 3), (8, 4), (10, 6)])
def test_an_iqm_is_the_mean_of_the_middle_runs(runs, kept):
    values = np.arange(runs) ** 3.0
    out = (runs - kept) // 2
    assert estimate(values[::-1], "iqm") == values[out : runs - out].mean()
    assert estimate(values, "mean") == values.mean()


def exact_interval(values, estimator, tail):
    """Return the ends of the percentile bootstrap from all resamples, not some."""
    runs, cut = len(values), int(0.25 * len(values)) if estimator == "iqm" else 0
    found = []
    for resample in itertools.combinations_with_replacement(sorted(values), runs):
        repeats = [len(list(same)) for _, same in itertools.groupby(resample)]
        ways = math.factorial(runs) // math.prod(math.factorial(n) for n in repeats)
        found.append((np.mean(resample[cut : runs - cut]), ways))
    found.sort()
    below = np.cumsum([ways for _, ways in found]) / runs**runs
    return found[int(np.searchsorted(below, tail))][0], found[int(np.searchsorted(below, 1.0 - tail))][0]


@pytest.mark.parametrize("estimator", ["mean", "iqm"])
def test_the_bootstrap_is_that_of_all_resamples(estimator):
    values = np.random.default_rng(3).lognormal(size=8)
    quantile = stats.t.ppf(0.975, 7) if estimator == "mean" else stats.norm.ppf(0.975)
    low, high = exact_interval(values, estimator, stats.norm.cdf(-quantile * math.sqrt(8 / 7)))
    _, found_low, found_high = bootstrap_interval(values, estimator)
    assert found_low == pytest.approx(low, abs=0.04 * (high - low))
    assert found_high == pytest.approx(high, abs=0.08 * (high - low))  # the long tail: resamples are sparser there


@given(RUNS, st.sampled_from(["mean", "iqm"]), st.randoms(use_true_random=False))
def test_an_interval_follows_sign_unit_and_origin_and_knows_no_order(values, estimator, random):
    value, low, high = bootstrap_interval(values, estimator)
    assert values.min() <= low <= value <= high <= values.max()
    shuffled = values[random.sample(range(len(values)), len(values))]
    assert np.array_equal(bootstrap_interval(shuffled, estimator), [value, low, high])
    assert bootstrap_interval(-values, estimator) == pytest.approx((-value, -high, -low))
    moved = bootstrap_interval(4.0 * values + 3.0, estimator)
    assert moved == pytest.approx([4.0 * one + 3.0 for one in (value, low, high)])


@pytest.mark.parametrize("estimator", ["mean", "iqm"])
@pytest.mark.parametrize("runs", [1, 2, 3, 7, 8, 10, 30])
def test_equal_values_and_one_run_are_their_own_interval(runs, estimator):
    found = bootstrap_interval(np.full((runs, 2), 0.1), estimator)
    assert np.array_equal(found, np.full((3, 2), 0.1))


@pytest.mark.parametrize("runs", [2, 3, 7])
def test_of_few_runs_the_interval_is_students(runs):
    values = np.random.default_rng(runs).normal(size=runs)
    assert bootstrap_interval(values, "mean") == pytest.approx(mean_interval(values))


def test_many_columns_are_as_one_at_a_time():
    values = np.random.default_rng(5).random((9, 700, 2))
    together = np.array(bootstrap_interval(values, "iqm"))
    assert together.shape == (3, 700, 2)
    for column in (0, 511, 699):
        assert together[:, column, 1] == pytest.approx(bootstrap_interval(values[:, column, 1], "iqm"), rel=1e-12)


@pytest.mark.parametrize(("values", "estimator"), [([], "mean"), (3.0, "mean"), ([1.0], "median")])
def test_what_cannot_be_estimated_is_refused(values, estimator):
    with pytest.raises(ValueError, match="expected"):
        bootstrap_interval(values, estimator)


def may_differ(share, sets):
    return 3.5 * math.sqrt(share * (1.0 - share) / sets)


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_intervals_of_the_iqm_of_ten_runs_hold_the_true_value_in_92_to_97_of_100_cases(name):
    sets = 2000
    share = covered(name, runs=10, sets=sets, estimator="iqm", seed=7)["used"]
    assert 0.92 - may_differ(0.92, sets) < share < 0.97 + may_differ(0.97, sets)
    assert abs(share - LEVEL) < 0.015 + may_differ(LEVEL, sets)  # what the documentation says


def test_other_methods_do_worse_where_the_documentation_says_so():
    shares = covered("goals, 97 % of 20", runs=10, sets=1000, estimator="iqm", compare=True)
    assert shares["used"] > 0.92
    assert all(shares[name] < 0.92 for name in ("basic", "BCa", "bootstrap-t", "Tukey-McLaughlin"))


@pytest.mark.parametrize("name", ["normal", "uniform"])
@pytest.mark.parametrize(("runs", "estimator"), [(4, "iqm"), (10, "mean"), (20, "iqm")])
def test_intervals_of_other_sizes_hold_the_true_value(name, runs, estimator):
    sets = 1000
    share = covered(name, runs=runs, sets=sets, estimator=estimator)["used"]
    assert abs(share - LEVEL) < 0.02 + may_differ(LEVEL, sets)


@given(arrays(float, st.integers(2, 12), elements=NUMBERS), arrays(float, st.integers(2, 12), elements=NUMBERS))
def test_the_probability_of_improvement_is_that_of_statsmodels_and_has_two_sides(first, second):
    share, low, high = probability_of_improvement(first, second)
    with np.errstate(all="ignore"):  # of groups that are all apart
        assert share == pytest.approx(rank_compare_2indep(first, second).prob1)
    assert 0.0 <= low <= share <= high <= 1.0
    assert probability_of_improvement(second, first) == pytest.approx((1.0 - share, 1.0 - high, 1.0 - low), abs=1e-9)


def test_of_one_run_each_the_interval_is_wilsons_of_one_trial():
    # With one pair Newcombe's variance is that of a share of one trial.
    assert probability_of_improvement([2.0], [1.0]) == pytest.approx((1.0, *share_interval(1, 1)))
    assert probability_of_improvement([1.0], [2.0]) == pytest.approx((0.0, *share_interval(0, 1)))


@pytest.mark.parametrize("shift", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("runs", [5, 10])
def test_intervals_of_the_probability_of_improvement_hold_it(shift, runs):
    assert 0.92 < improvement_covered(shift, runs=runs, sets=1000) < 0.985


def test_the_table_of_coverage_is_made_by_a_command():
    said = CliRunner().invoke(coverage, ["--sets", "50", "--runs", "10", "--json", "-q"], catch_exceptions=False)
    found = json.loads(said.stdout)
    assert [one["distribution"] for one in found["intervals"]] == list(DISTRIBUTIONS)
    for one in found["intervals"]:
        assert (
            one["methods"]["used"]
            == one["iqm"]["10"]
            == covered(one["distribution"], runs=10, sets=50, estimator="iqm")["used"]
        )
    assert set(found["improvement"]) == {"0", "1", "2"}


def test_scipy_is_loaded_only_when_an_interval_is_asked_for():
    code = "import sys, coevo.statistics; assert 'scipy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)  # noqa: S603 - our own
