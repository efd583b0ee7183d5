"""The loop of games and trials: sense, decide and drive, step, judge."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import inlined

__all__ = ["GOING", "run_episode"]

GOING = 0  # what a judge says of an episode that goes on

_Scene = TypeVar("_Scene")


@inlined
def run_episode(
    scene: _Scene,
    time_limit: int,
    rng: NDArray[np.uint64],
    sense: Callable[[_Scene, int, NDArray[np.uint64]], None],
    act: Callable[[_Scene, int, NDArray[np.uint64]], None],
    judge: Callable[[_Scene, int], int],
) -> tuple[int, int]:
    """Run one game or trial that has begun; return what its judge said last, and its steps.

    In compiled code the three functions are kernels. Where images come from Python, ``run_episode.py_func`` is the same
    loop with Python's functions.

    Args:
        scene: what the three functions work on.
        time_limit: [steps].
        rng: (1,) uint64, the episode's stream.
        sense: lets the robots see at a time, from 0 on.
        act: lets them decide and drive, and moves the world from one time to the next.
        judge: says how it stands at a time, from 1 on; anything but GOING is the end.
    """
    time, standing = 0, GOING
    while True:  # each part stands here once: it is compiled into this place
        sense(scene, time, rng)
        if time > 0:
            standing = judge(scene, time)
        if standing != GOING or time >= time_limit:
            return standing, time
        act(scene, time, rng)
        time += 1
