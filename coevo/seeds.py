"""Every random stream: what it is for, and how it follows from a seed that a person gave.

A seed that is given is a root: of a run, of a learning, of a set of chapter 3. What is drawn from it comes in streams,
each with a number of its own, and a stream has a seed for each thing that can be done again alone, such as a game. A
run's seed and that of games outside the run may be equal: they are one root, so that their games differ all the same.
"""

from __future__ import annotations

import random
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum, unique
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "RunStream",
    "SetStream",
    "SkillStream",
    "StartsSeed",
    "game_seed",
    "game_seeds",
    "generator",
    "global_random",
    "thread_random",
]


@unique
class RunStream(IntEnum):
    """Streams of a run's seed, and of the seeds of games outside a run."""

    CREATION = 0  # of the first trees, a robot
    VARIATION = 1  # of children, a generation and robot
    GROUPING = 2  # a generation
    GAMES = 3  # of evolution: a generation, group and game
    PLAY = 4  # to look at: a game
    UNSEEN = 5  # that say how good trees are: a game
    CHOICE = 6  # by which those are chosen that others are compared with: a game
    TOURNAMENT = 7  # between champions of all generations: a block of starts and game
    MEMBERS = 8  # who plays for a whole generation in a tournament: a role and generation
    AGAIN = 10  # that champions play again: a generation, role, repetition and game
    PARTNERS = 11  # with whom champions play again: a generation, role and repetition
    CROSS = 12  # between champions of different runs: a block of starts and game
    SINGLES = 13  # which teams of single skills are tried, where there are too many: a team
    GUESTS = 14  # from which earlier generations guests come: a generation
    CHAMPIONS = 15  # that choose the last champions once more: a team and game
    BENCH = 9  # whose speed is measured: a group and game
    ANSWERS = 20  # by which best answers are chosen: a search, team, race and game
    ANSWERED = 21  # that say how good best answers and baselines are: a part and game
    SMALL_TREES = 22  # which small trees are tried, where there are too many: a depth


@unique
class SkillStream(IntEnum):
    """Streams of the seed that a skill is learned or measured with."""

    EXPERIENCE = 0  # random actions that models are identified from: a part
    LEARNING = 1  # a trial
    EVALUATION = 2  # a trial
    CHECK = 3  # of the table while it is learned: a trial, the same in all checks
    STEPS = 4  # that a skill takes to its goal, for the coordination of several: a trial
    AXES = 5  # in which order they are added, where that is random: an object
    TIES = 6  # between actions that are equally good by several rewards


@unique
class SetStream(IntEnum):
    """Streams of the seed of a set of chapter 3, or of several robots of chapter 5."""

    GATHERING = 0  # random actions: a period and trial; of several robots: a robot
    LEARNING = 1  # a period, or turn, and trial
    CHECKS = 2  # a period, or turn, and trial, the same in all checks of it
    AFTERWARDS = 3  # a trial
    ELSEWHERE = 4  # in the other world: a period and trial
    TIES = 5  # between actions that are equally good by several rewards: a robot
    TIMING = 9  # a trial


@unique
class StartsSeed(IntEnum):
    """Seeds of the starts that skills are measured on: those of a card are not those of a study."""

    CARDS = 1_000_000
    SKILLS = 2_000_000  # of several seeds, and of several ways to coordinate skills
    ABLATION = 4_000_000
    GREEDY = 5_000_000


def game_seed(*key: int) -> np.uint64:
    """Return the seed of one game from what identifies it, such as (run seed, stream, generation, group, game)."""
    return np.uint64(np.random.SeedSequence(list(key)).generate_state(1, np.uint64)[0])


def game_seeds(*key: int, count: int, first: int = 0) -> NDArray[np.uint64]:
    """Return (count,) seeds of the games or trials number ``first`` and following of a stream.

    Example:
        >>> from coevo.seeds import RunStream, game_seed, game_seeds
        >>> seeds = game_seeds(1, RunStream.PLAY, count=3)
        >>> bool(seeds[2] == game_seed(1, RunStream.PLAY, 2))  # each game again, alone
        True
    """
    return np.array([game_seed(*key, first + n) for n in range(count)], np.uint64)


def generator(*key: int) -> np.random.Generator:
    """Return numpy's generator for what identifies a stream."""
    return np.random.default_rng(np.random.SeedSequence(list(key)))


class _ThisThread(threading.local):
    """What ``global_random`` has lent a thread."""

    stream: random.Random | None = None


class _ThreadRandom:
    """What stands for Python's module ``random``: a thread draws from what it was lent, else from the module itself.

    Python's global generator would not do: any thread may draw from it, such as those that keep a worker of a cluster
    in touch with its scheduler.
    """

    def __getattr__(self, name: str) -> Any:
        return getattr(_this_thread.stream or random, name)


_this_thread = _ThisThread()
thread_random = _ThreadRandom()


@contextmanager
def global_random(*key: int) -> Iterator[None]:
    """Lend this thread a stream of its own in place of Python's global generator, wherever ``thread_random`` is used.

    Example:
        >>> from coevo.seeds import RunStream, global_random, thread_random
        >>> with global_random(1, RunStream.CREATION):
        ...     one = thread_random.random()
        >>> with global_random(1, RunStream.CREATION):
        ...     print(thread_random.random() == one)
        True
    """
    before = _this_thread.stream
    _this_thread.stream = random.Random(int(game_seed(*key)))
    try:
        yield
    finally:
        _this_thread.stream = before
