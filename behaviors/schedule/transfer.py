"""Periods E and F: the two robots in another world, which stands in for the real one (Uchibe 1999, 3.5.3).

What they see is painted and found by its colour (coevo.soccer.vision), is a few steps old when it arrives, and comes
from a camera and a field that are not those of the simulation. The loop is Python's; choosing, moving and learning are
those of ``behaviors.schedule.trial``.
"""

from __future__ import annotations

from collections import deque

import msgspec
import numpy as np
from numpy.typing import NDArray

from behaviors.trials.task import GOING
from behaviors.schedule.agents import Agent, Duty, Outcomes, joined, no_outcomes
from behaviors.schedule.data import LEARNING, Pair
from behaviors.schedule.models import renew_models
from behaviors.schedule.recipe import Schedule, TransferSettings, transfer_world
from behaviors.schedule.schedule import ELSEWHERE, Report, Schooling
from behaviors.schedule.trial import act, begin_trial, end_trial, take_in
from behaviors.tabular.qlearning import Learner
from coevo.config import WorldSettings
from coevo.errors import InputError
from coevo.skill.estimate import perturb
from coevo.soccer.camera import see
from coevo.soccer.rng import game_seed
from coevo.soccer.vision import extract, render

__all__ = ["Eyes", "run_elsewhere", "transfer"]

_BLOCK = 10  # trials between two reports of progress
_Sight = tuple[NDArray[np.float64], NDArray[np.float64]]


class Eyes:
    """What both robots see, ``latency_steps`` later.

    Args:
        pair: where they are.
        world: its settings.
        settings: camera, noise and latency.
        seed: of the noise of pixels.
    """

    def __init__(self, pair: Pair, world: WorldSettings, settings: TransferSettings, seed: np.uint64) -> None:
        self._pair, self._world, self._settings = pair, world, settings
        self._noise = np.random.default_rng(int(seed))
        self._late: tuple[deque[_Sight], ...] = (deque(), deque())

    def look(self, rng: NDArray[np.uint64]) -> None:
        """Put into the robots' memory what arrives now; until the first image can have arrived, it is that one.

        ``rng``: stream of the noise of the analytic camera.
        """
        memory = self._pair.memory
        for robot, late in enumerate(self._late):
            features, areas = self._see(robot, rng)
            late.append((features, areas))
            if len(late) > self._settings.latency_steps + 1:
                late.popleft()
            features, areas = late[0]
            objects = len(areas)
            memory.areas[robot, :objects] = areas
            seen = np.flatnonzero(areas > 0.0)
            memory.features[robot, seen] = features[seen]

    def _see(self, robot: int, rng: NDArray[np.uint64]) -> _Sight:
        pair, settings = self._pair, self._settings
        if settings.camera == "opencv":
            state, noise = pair.stage.state, settings.noise_grey
            fine = settings.supersample
            image = render(self._world, state, robot, supersample=fine, noise=noise, rng=self._noise)
            return extract(image, self._world, 2, robot, 0, min_region_px=max(1.0, settings.min_region_px))
        objects = pair.memory.areas.shape[1] - 1
        features, areas = np.zeros((objects, pair.memory.features.shape[2])), np.zeros(objects)
        see(pair.camera, pair.stage.state, robot, 0, pair.retina, features, areas)
        if pair.camera.noise > 0.0:
            perturb(pair.camera, objects, features, areas, rng)
        return features, areas


def run_elsewhere(
    pair: Pair,
    world: WorldSettings,
    settings: TransferSettings,
    seeds: NDArray[np.uint64],
    *,
    time_limit: int,
    first: int = 0,
    total: int = 1,
) -> Outcomes:
    """Run one trial a seed, number ``first`` and following of ``total``, with images from ``Eyes``."""
    found = no_outcomes(len(seeds))
    for n, seed in enumerate(seeds):
        rng = np.full(1, seed)
        progress = (first + n) / max(total - 1, 1)
        if not begin_trial(pair, progress, rng):
            raise InputError("no start was found in the other world; widen the rectangles of [starts]")
        pair.stage.trial[0] = first + n
        eyes = Eyes(pair, world, settings, seed)
        t, standing = 0, GOING
        eyes.look(rng)
        take_in(pair, t)
        while t < time_limit and standing == GOING:
            standing = act(pair, t, progress, rng)
            t += 1
            eyes.look(rng)
            take_in(pair, t)
        end_trial(pair, standing, t)
        for column, value in zip(found, (standing, pair.stage.passes[0], t, pair.stage.nearer[0]), strict=True):
            column[n] = value
    return found


def _learner(usual: Learner, settings: TransferSettings) -> Learner:
    """Return the numbers of learning elsewhere: constant, and with no easy missions."""
    return usual._replace(
        alpha=settings.alpha,
        alpha_visits=0.0,
        epsilon_start=settings.epsilon,
        epsilon_end=settings.epsilon,
        easy_share=0.0,
        anywhere_share=0.0,
    )


def transfer(schedule: Schedule, seed: int, agents: tuple[Agent, Agent], report: Report | None = None) -> Schooling:
    """Let two robots that have learned go on in the other world; return how periods E and F went.

    In E both act by what they have learned, store, and learn; before F both renew their models from E's experience.
    """
    settings, world = schedule.transfer, transfer_world(schedule)
    there = Schooling(msgspec.structs.replace(schedule, world=world), seed, world=world, agents=agents, report=report)
    duty = Duty(LEARNING, True, "kept")
    for agent in agents:
        agent.old = None
    for name, trials in (("E", settings.trials_e), ("F", settings.trials_f)):
        if trials == 0:
            continue
        if name == "F":
            for agent in agents:
                there.models += renew_models(agent, schedule, name, settings.reuse)
        for agent in agents:
            agent.store.written[0] = 0
        passer, shooter = (there.table(agent, duty) for agent in agents)
        learners = (_learner(there.learners[0], settings), _learner(there.learners[1], settings))
        pair = there.pair((LEARNING, LEARNING), [passer, shooter], stores=(True, True), learners=learners)
        found = []
        for first in range(0, trials, _BLOCK):
            numbers = range(first, min(first + _BLOCK, trials))
            seeds = np.array([game_seed(seed, ELSEWHERE, ord(name), n) for n in numbers], np.uint64)
            limit = schedule.time_limit_steps
            found.append(run_elsewhere(pair, world, settings, seeds, time_limit=limit, first=first, total=trials))
            if report is not None:
                report(name, numbers[-1] + 1, trials)
        there.trials[name] = joined(found)
        for agent, table in zip(agents, (passer, shooter), strict=True):
            agent.values = table.values.astype(np.float32)
    return there
