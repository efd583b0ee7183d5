"""Random streams: no two of one root share a key, and each keeps the numbers that results were made with."""

from __future__ import annotations

import random
from concurrent.futures import ThreadPoolExecutor
from itertools import product

import numpy as np
import pytest
from scipy import stats

from coevo.seeds import (
    RunStream,
    SetStream,
    SkillStream,
    StartsSeed,
    game_seed,
    game_seeds,
    generator,
    global_random,
    thread_random,
)

ROOTS = (0, 1, 7, 2**40 + 3)
# What of each stream is told apart: how many numbers follow the stream's own.
PARTS = {
    RunStream.CREATION: 1,
    RunStream.VARIATION: 2,
    RunStream.GROUPING: 1,
    RunStream.GAMES: 3,
    RunStream.PLAY: 1,
    RunStream.UNSEEN: 1,
    RunStream.CHOICE: 1,
    RunStream.TOURNAMENT: 2,
    RunStream.MEMBERS: 2,
    RunStream.BENCH: 2,
    RunStream.AGAIN: 4,
    RunStream.PARTNERS: 3,
    RunStream.CROSS: 2,
    RunStream.SINGLES: 1,
    RunStream.GUESTS: 1,
    RunStream.CHAMPIONS: 2,
    RunStream.ANSWERS: 4,
    RunStream.ANSWERED: 2,
    RunStream.SMALL_TREES: 2,
    SkillStream.EXPERIENCE: 1,
    SkillStream.LEARNING: 1,
    SkillStream.EVALUATION: 1,
    SkillStream.CHECK: 1,
    SkillStream.STEPS: 1,
    SkillStream.AXES: 1,
    SetStream.GATHERING: 2,
    SetStream.LEARNING: 2,
    SetStream.CHECKS: 2,
    SetStream.AFTERWARDS: 1,
    SetStream.ELSEWHERE: 2,
    SetStream.TIES: 1,
    SetStream.TIMING: 1,
}


def test_each_part_of_a_games_key_changes_its_seed():
    seeds = {game_seed(*key) for key in np.ndindex(4, 4, 4, 4)}
    assert len(seeds) == 256
    assert game_seed(1, 2, 3) == game_seed(1, 2, 3)
    assert game_seed(1, 2, 3).dtype == np.uint64
    assert len({game_seed(1, 2), game_seed(2, 1), game_seed(1, 2, 1), game_seed(2**63 - 1, 2)}) == 4


def test_seeds_of_games_are_uniform():
    seeds = np.array([game_seed(5, 3, group, game) for group in range(40) for game in range(40)])
    assert stats.kstest(seeds.astype(np.float64) / 2.0**64, "uniform").pvalue > 0.001


@pytest.mark.parametrize("streams", [RunStream, SkillStream, SetStream])
@pytest.mark.parametrize("root", ROOTS)
def test_no_two_streams_of_a_root_share_a_seed(root, streams):
    # numpy fills short keys with zeros: a key of three numbers is one of four that ends with 0.
    keys = [(stream, *part) for stream in streams for part in product(range(12), repeat=PARTS[type(stream)(stream)])]
    assert len({int(game_seed(root, *key)) for key in keys}) == len(keys)


def test_streams_have_the_numbers_that_results_were_made_with():
    assert {stream.name: stream.value for stream in RunStream} == {
        "CREATION": 0, "VARIATION": 1, "GROUPING": 2, "GAMES": 3, "PLAY": 4, "UNSEEN": 5, "BENCH": 9,
        "CHOICE": 6, "TOURNAMENT": 7, "MEMBERS": 8, "AGAIN": 10, "PARTNERS": 11, "CROSS": 12, "SINGLES": 13,
        "GUESTS": 14, "CHAMPIONS": 15,
        "ANSWERS": 20, "ANSWERED": 21, "SMALL_TREES": 22,
    }  # fmt: skip
    assert [*SkillStream] == [0, 1, 2, 3, 4, 5, 6]
    assert [*SetStream] == [0, 1, 2, 3, 4, 5, 9]
    assert len(set(StartsSeed)) == len(StartsSeed) == 4


def test_a_stream_goes_on_where_it_is_told_to():
    assert game_seeds(3, RunStream.PLAY, count=4).tolist() == [int(game_seed(3, 4, game)) for game in range(4)]
    assert game_seeds(3, 4, count=2, first=2).tolist() == game_seeds(3, 4, count=4)[2:].tolist()
    assert game_seeds(3, 4, count=0).shape == (0,)
    assert game_seeds(3, 4, count=2).dtype == np.uint64


def test_generators_of_a_key_repeat_and_those_of_another_differ():
    one, same, other = (generator(*key).random(50).tolist() for key in ((1, 2, 3), (1, 2, 3), (1, 2, 4)))
    assert one == same
    assert not set(one) & set(other)


def test_a_thread_has_a_stream_of_its_own_and_the_rest_of_the_program_notices_nothing():
    def draw():
        return thread_random.random()

    random.seed(5)
    before = random.getstate()
    with global_random(1, RunStream.CREATION, 0):
        one = [thread_random.random() for _ in range(5)]
        with ThreadPoolExecutor(1) as pool:  # another thread draws from Python's own generator
            assert pool.submit(draw).result() == random.Random(5).random()
    assert before != random.getstate()
    state = random.getstate()
    with global_random(1, RunStream.CREATION, 0):
        assert [thread_random.random() for _ in range(5)] == one
        with global_random(1, RunStream.CREATION, 1):
            assert thread_random.random() not in one
        assert thread_random.random() not in one
    assert random.getstate() == state
    assert one == [random.Random(int(game_seed(1, RunStream.CREATION, 0))).random(), *one[1:]]
