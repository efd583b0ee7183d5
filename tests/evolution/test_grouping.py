"""Who plays with whom: each individual in exactly one group a generation, every partner as likely."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from coevo.evolution.grouping import random_groups

populations, numbers = st.integers(2, 60), st.integers(0, 2**63 - 1)


@given(population=populations, robots=st.integers(1, 6), seed=numbers, generation=st.integers(0, 10_000))
def test_each_individual_of_each_robot_is_in_exactly_one_group(population, robots, seed, generation):
    groups = random_groups(population, robots, seed=seed, generation=generation)
    assert groups.shape == (population, robots)
    for robot in range(robots):
        assert sorted(groups[:, robot]) == list(range(population))
    assert np.array_equal(groups, random_groups(population, robots, seed=seed, generation=generation))


def test_groups_are_drawn_anew_for_every_generation_and_seed():
    drawn = {
        random_groups(20, 3, seed=seed, generation=generation).tobytes()
        for seed in range(10)
        for generation in range(10)
    }
    assert len(drawn) == 100


def test_every_partner_is_as_likely_in_every_pair_of_robots():
    population, robots = 5, 3
    times = np.zeros((robots, robots, population, population), np.int64)
    for generation in range(2000):
        groups = random_groups(population, robots, seed=7, generation=generation)
        for one in range(robots):
            for two in range(one):
                times[one, two, groups[:, one], groups[:, two]] += 1
    for one in range(robots):
        for two in range(one):
            for individual in range(population):
                assert stats.chisquare(times[one, two, individual]).pvalue > 1e-4


def test_the_place_of_a_group_says_nothing_about_its_members():
    first = [random_groups(6, 2, seed=1, generation=generation)[0] for generation in range(3000)]
    for robot in range(2):
        assert stats.chisquare(np.bincount([group[robot] for group in first], minlength=6)).pvalue > 1e-4
