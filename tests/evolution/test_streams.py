"""Random streams of creation and variation: a seed gives the same, whatever else draws meanwhile."""

from __future__ import annotations

import random
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coevo.config import GPSettings
from coevo.evolution.population import codes_of, first_population
from coevo.evolution.variation import breed
from coevo.game import function_set
from coevo.seeds import thread_random

functions = function_set(0, 3)


def both(seed, generation=0, robot=0, population=8):
    """Return codes of a first population and of its children."""
    settings = GPSettings(population=population, creation_depth_max=4)
    first = first_population(settings, functions, seed=seed, robot=robot)
    for rank, tree in enumerate(first):
        tree.fitness.values = (float(rank), 0.0)
    second = breed(first, settings, functions, seed=seed, generation=generation, robot=robot)
    return [[codes_of(tree, functions).tolist() for tree in trees] for trees in (first, second)]


@given(seed=st.integers(0, 2**63 - 1), noise=st.integers())
def test_a_seed_gives_the_same_whatever_the_global_generators_do(seed, noise):
    before = random.getstate(), np.random.get_state()  # noqa: NPY002 - it is this state that must not change
    try:
        random.seed(noise)
        disturbed, legacy = random.getstate(), np.random.get_state()  # noqa: NPY002
        one = both(seed)
        assert random.getstate() == disturbed
        assert all(np.array_equal(a, b) for a, b in zip(np.random.get_state(), legacy, strict=True))  # noqa: NPY002
        random.seed(noise + 1)
        assert both(seed) == one
    finally:
        random.setstate(before[0])


def test_a_seed_gives_the_same_whatever_other_threads_draw_meanwhile():
    # The thread of a cluster's worker that keeps in touch with its scheduler draws now and then.
    one, done = both(3, population=60), threading.Event()

    def draw():
        while not done.is_set():
            random.random()

    thread = threading.Thread(target=draw)
    thread.start()
    try:
        assert [both(3, population=60) for _ in range(20)] == [one] * 20
    finally:
        done.set()
        thread.join()


def test_the_stream_is_given_back_after_a_failure():
    random.seed(4)
    with pytest.raises(IndexError):
        breed([], GPSettings(population=4, elite=0), functions, seed=1, generation=0, robot=0)
    assert thread_random.random() == random.Random(4).random()


def test_every_seed_robot_and_generation_has_its_own_stream():
    keys = [(seed, generation, robot) for seed in range(3) for generation in range(3) for robot in range(2)]
    firsts = {str(both(seed, 0, robot)[0]) for seed, _, robot in keys}
    assert len(firsts) == 6
    parents = first_population(GPSettings(population=8, creation_depth_max=4), functions, seed=1, robot=0)
    for rank, parent in enumerate(parents):
        parent.fitness.values = (float(rank), 0.0)
    settings = GPSettings(population=8, elite=0)
    seconds = {
        str(
            [
                codes_of(child, functions).tolist()
                for child in breed(parents, settings, functions, seed=seed, generation=generation, robot=robot)
            ]
        )
        for seed, generation, robot in keys
    }
    assert len(seconds) == len(keys)
