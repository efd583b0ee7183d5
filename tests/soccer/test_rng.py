"""Random numbers of compiled games: splitmix64 by its published numbers, and the distributions made of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from coevo.soccer.rng import below, normal, uniform

# First outputs of splitmix64 for the seed 1234567, as published with the algorithm.
PUBLISHED = (
    6457827717110365317,
    3203168211198807973,
    9817491932198370423,
    4593380528125082431,
    16408922859458223821,
)
LAST = 2**64 - 1


def splitmix64(seed, count):
    """Return the first outputs of the algorithm, in Python's whole numbers."""
    outputs, state = [], seed
    for _ in range(count):
        state = (state + 0x9E3779B97F4A7C15) & LAST
        z = state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & LAST
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & LAST
        outputs.append(z ^ (z >> 31))
    return outputs


def stream(seed):
    return np.array([seed], np.uint64)


def draws(function, seed, count, *arguments):
    rng = stream(seed)
    return np.array([function(rng, *arguments) for _ in range(count)])


def test_uniform_is_the_upper_53_bits_of_the_published_numbers():
    assert splitmix64(1234567, 5) == list(PUBLISHED)
    # 53 bits fit a double, so this is exact.
    assert draws(uniform, 1234567, 5).tolist() == [(z >> 11) / 2**53 for z in PUBLISHED]


@pytest.mark.parametrize("seed", [0, 1, 2**63, LAST, 0x9E3779B97F4A7C15])
def test_uniform_follows_the_algorithm_from_any_seed(seed):
    assert draws(uniform, seed, 200).tolist() == [(z >> 11) / 2**53 for z in splitmix64(seed, 200)]


def test_uniform_lies_in_0_to_1_and_is_uniform_and_independent_of_the_draw_before():
    drawn = draws(uniform, 7, 50_000)
    assert drawn.min() >= 0.0
    assert drawn.max() < 1.0
    assert stats.kstest(drawn, "uniform").pvalue > 0.001
    assert abs(np.corrcoef(drawn[:-1], drawn[1:])[0, 1]) < 4.0 / math.sqrt(len(drawn))


def test_the_first_numbers_of_neighbouring_seeds_are_uniform_too():
    # Games begin with the first few numbers of a stream.
    drawn = np.array([draws(uniform, seed, 3) for seed in range(5000)])
    for place in drawn.T:
        assert stats.kstest(place, "uniform").pvalue > 0.001


@pytest.mark.parametrize("n", [1, 2, 3, 9])
def test_below_is_uniform_on_0_to_n_minus_1(n):
    drawn = draws(below, 11, 9000, n)
    counts = np.bincount(drawn, minlength=n)
    assert len(counts) == n
    assert np.issubdtype(drawn.dtype, np.integer)
    assert n == 1 or stats.chisquare(counts).pvalue > 0.001


def test_normal_is_normal():
    drawn = draws(normal, 13, 50_000)
    error = 1.0 / math.sqrt(len(drawn))
    assert abs(drawn.mean()) < 4.0 * error
    assert abs(drawn.var() - 1.0) < 4.0 * math.sqrt(2.0) * error
    assert abs(stats.skew(drawn)) < 4.0 * math.sqrt(6.0) * error
    assert abs(stats.kurtosis(drawn)) < 4.0 * math.sqrt(24.0) * error
    assert stats.kstest(drawn, "norm").pvalue > 0.001
    assert abs(np.corrcoef(drawn[:-1], drawn[1:])[0, 1]) < 4.0 * error


def test_normal_is_box_and_muller_of_two_uniform_numbers():
    one, two = draws(uniform, 17, 2)
    assert normal(stream(17)) == pytest.approx(math.sqrt(-2.0 * math.log(1.0 - one)) * math.cos(2.0 * math.pi * two))
