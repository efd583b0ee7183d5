"""Periods E and F: the two robots in another world, which stands in for the real one (Uchibe 1999, 3.5.3).

What they see is painted and found by its colour (coevo.soccer.vision), is a few steps old when it arrives, and comes
from a camera and a field that are not those of the simulation. The loop is the stage's, in Python; choosing, moving and
learning are those of all trials.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from behaviors.schedule.recipe import TransferSettings
from behaviors.tabular.qlearning import Learner
from behaviors.trials.kernels import Results, act, begin_trial, end_trial, judge_trial, take_in
from behaviors.trials.scene import Scene, no_results
from coevo.config import WorldSettings
from coevo.errors import InputError
from coevo.soccer.camera import see
from coevo.soccer.noise import blur_sight
from coevo.soccer.vision import extract, render
from coevo.stage import run_episode

__all__ = ["Eyes", "learner_elsewhere", "run_elsewhere"]

_Sight = tuple[NDArray[np.float64], NDArray[np.float64]]


class Eyes:
    """What both robots see, ``latency_steps`` later.

    Args:
        scene: where they are.
        world: its settings.
        settings: camera, noise and latency.
        seed: of the noise of pixels.
    """

    def __init__(self, scene: Scene, world: WorldSettings, settings: TransferSettings, seed: np.uint64) -> None:
        self._stage, self._world, self._settings = scene.venue.stage, world, settings
        self._noise = np.random.default_rng(int(seed))
        self._late: tuple[deque[_Sight], ...] = (deque(), deque())

    def look(self, rng: NDArray[np.uint64]) -> None:
        """Put into the robots' memory what arrives now; until the first image can have arrived, it is that one.

        ``rng``: stream of the noise of the analytic camera.
        """
        memory = self._stage.memory
        for robot, late in enumerate(self._late):
            late.append(self._see(robot, rng))
            if len(late) > self._settings.latency_steps + 1:
                late.popleft()
            features, areas = late[0]
            memory.areas[robot, : len(areas)] = areas
            seen = np.flatnonzero(areas > 0.0)
            memory.features[robot, seen] = features[seen]

    def _see(self, robot: int, rng: NDArray[np.uint64]) -> _Sight:
        stage, settings = self._stage, self._settings
        state = stage.body.state
        if settings.camera == "opencv":
            fine, noise = settings.supersample, settings.noise_grey
            image = render(self._world, state, robot, supersample=fine, noise=noise, rng=self._noise)
            return extract(image, self._world, 2, robot, 0, min_region_px=max(1.0, settings.min_region_px))
        objects = stage.memory.areas.shape[1] - 1
        features, areas = np.zeros((objects, stage.memory.features.shape[2])), np.zeros(objects)
        see(stage.camera, state, robot, 0, stage.retina, features, areas)
        if stage.camera.noise > 0.0:
            blur_sight(stage.camera, objects, features, areas, rng)
        return features, areas


def run_elsewhere(
    scene: Scene,
    world: WorldSettings,
    settings: TransferSettings,
    seeds: NDArray[np.uint64],
    *,
    first: int = 0,
    total: int = 1,
) -> Results:
    """Run one trial a seed, number ``first`` and following of ``total``, with images from ``Eyes``.

    Raises:
        InputError: no start was found.
    """
    found = no_results(len(seeds))
    for n, seed in enumerate(seeds):
        rng, trial = np.full(1, seed), scene.trial
        if not begin_trial(trial, first + n, total, rng):
            raise InputError("no start was found in the other world; widen the rectangles of [starts]")
        eyes = Eyes(scene, world, settings, seed)

        def sense(scene: Scene, time: int, rng: NDArray[np.uint64], eyes: Eyes = eyes) -> None:
            eyes.look(rng)
            take_in(scene.trial, time)

        ends, steps = run_episode.py_func(scene, scene.time_limit, rng, sense, _act, _judge)  # type: ignore[attr-defined]  # numba's
        end_trial(trial, ends, steps)
        found.ends[n], found.passes[n], found.steps[n] = ends, trial.tally.passes[0], steps
        found.nearer[n] = trial.tally.nearer[0]
        found.kicks[n], found.collisions[n] = trial.stage.events.kicks[0], trial.stage.events.collisions[0]
    return found


def _act(scene: Scene, time: int, rng: NDArray[np.uint64]) -> None:
    act(scene.trial, time, rng)


def _judge(scene: Scene, time: int) -> int:
    return judge_trial(scene.trial, time)


def learner_elsewhere(usual: Learner, settings: TransferSettings) -> Learner:
    """Return the numbers of learning elsewhere: constant, and with no easy missions."""
    return usual._replace(
        alpha=settings.alpha,
        alpha_visits=0.0,
        epsilon_start=settings.epsilon,
        epsilon_end=settings.epsilon,
        easy_share=0.0,
        anywhere_share=0.0,
    )
