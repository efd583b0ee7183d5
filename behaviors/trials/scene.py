"""Trials as Python sees them: a stage, a task and the minds of its robots, made of settings and run by blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from behaviors.tabular.table import with_room
from behaviors.trials.kernels import Results, Trial, run_trials
from behaviors.trials.minds import Mind, make_minds, with_tables_of
from behaviors.trials.task import CHANNELS, TEAM, Tally, TaskParams
from coevo.config import WorldSettings
from coevo.errors import InputError
from coevo.seeds import game_seeds
from coevo.skill import SkillBank
from coevo.soccer.drive import action_set
from coevo.soccer.events import EventParams
from coevo.soccer.world import World
from coevo.stage import LEARNER, Trace, Venue, make_venue
from coevo.stage.tape import blank_tape, no_tape, trace_of

__all__ = ["Part", "Scene", "Watched", "make_scene", "no_results"]

_worlds: dict[tuple[bytes, int], World] = {}


@dataclass(frozen=True)
class Part:
    """What one robot of a scene is.

    role: see coevo.stage.roles. mind: what it decides with. skill: which of the bank. team: 0 attacks the goal at
    x = length, 1 the other. mate: number of its team mate, -1 for none. sees: whether it looks. guesses: whether it
    begins with a belief about where it saw each object last. target: the body that it drives at, if it chases.
    """

    role: int
    mind: Mind
    skill: int = 0
    mate: int = -1
    sees: bool = True
    guesses: bool = True
    team: int = 0
    target: int = 0


@dataclass(frozen=True)
class Watched:
    """One trial with every step of it.

    trace: its steps. ends, passes: as in Results. roles: what each robot was in it, see coevo.stage.roles. counts:
    (robots, CHANNELS) how often what happened to each of a team; without rows for other tasks.
    """

    trace: Trace
    ends: int
    passes: int
    roles: tuple[int, ...]
    counts: NDArray[np.int64]


@dataclass
class Scene:
    """A stage with a task for its robots.

    Attributes:
        venue: the stage and its world.
        minds: of the robots.
        trial: what compiled trials work on.
        time_limit: of a trial [steps].
    """

    venue: Venue
    minds: list[Mind]
    trial: Trial
    time_limit: int

    def grow(self, robot: int, states: int) -> None:
        """Give a robot's table room for so many states more."""
        mind = self.minds[robot]
        grown = with_room(mind.table, states)
        if grown is not mind.table:
            mind.table = grown
            self.trial = self.trial._replace(minds=with_tables_of(self.trial.minds, self.minds))

    def run(
        self,
        seeds: NDArray[np.uint64],
        *,
        first: int = 0,
        total: int = 1,
        limit: int | None = None,
    ) -> Results | None:
        """Run one trial a seed, number ``first`` and following of ``total``; None if no start was found.

        Args:
            seeds: (trials,) uint64; a gathering takes the first for all, and may end before the last.
            first, total: set the schedule of learning.
            limit: instead of the time limit, and not above it.
        """
        found = no_results(len(seeds), len(self.trial.tally.counted))
        ran = run_trials(self.trial, limit or self.time_limit, first, total, seeds, found)
        gathered = self.trial.task.gathering and self.trial.minds.store.written[0, 0] >= len(
            self.trial.minds.store.trial[0]
        )
        return found if ran == len(seeds) or gathered else None

    def run_stream(
        self, key: tuple[int, ...], count: int, no_start: Callable[[], InputError], *, first: int = 0, total: int = 1
    ) -> Results:
        """Run trials as ``run`` does, with the seeds of a random stream.

        Raises:
            InputError: ``no_start``, where no start was found.
        """
        found = self.run(game_seeds(*key, count=count, first=first), first=first, total=total)
        if found is None:
            raise no_start()
        return found

    def watch(self, seeds: NDArray[np.uint64]) -> list[Watched] | None:
        """Run the trials that ``run`` runs, and keep every step of them; None if no start was found."""
        watched = []
        for number in range(len(seeds)):
            tape = blank_tape(len(self.minds), self.time_limit)
            found = no_results(1, len(self.trial.tally.counted))
            taped, seed = self.trial._replace(tape=tape), seeds[number : number + 1]
            if run_trials(taped, self.time_limit, number, len(seeds), seed, found) < 1:
                return None
            roles = tuple(self.venue.stage.roles.role.tolist())
            trace = trace_of(tape, int(found.steps[0]))
            watched.append(Watched(trace, int(found.ends[0]), int(found.passes[0]), roles, found.counts[0]))
        return watched


def no_results(trials: int, robots: int = 0) -> Results:
    """Return room for the results of so many trials, in which of so many robots is told what each did."""
    columns = {name: np.zeros(trials, np.int64) for name in Results._fields}
    return Results(**{**columns, "counts": np.zeros((trials, robots, CHANNELS), np.int64)})


def _check_table(part: Part, bank: SkillBank, actions: int) -> None:
    states = int(bank.states[part.skill, : bank.models[part.skill]].prod())
    table, criteria = part.mind.table, part.mind.criteria
    channels = 0 if criteria is None else len(criteria.credits)
    if (len(table.rows), *table.actor.shape[1:]) != (states, actions, channels):
        raise ValueError("its table is of another skill")


def make_scene(
    world: WorldSettings,
    task: TaskParams,
    parts: Sequence[Part],
    bank: SkillBank,
    limits: EventParams,
    *,
    time_limit: int,
    hold: tuple[int, int] = (1, 1),
    regions: NDArray[np.float64] | None = None,
) -> Scene:
    """Put robots with their minds on a stage.

    Args:
        world: its settings.
        task: what the trials are about.
        parts: one for each robot.
        bank: skills that the robots see and act by.
        limits: of events.
        time_limit: of a trial [steps].
        hold: for how many steps, at least and at most, a robot holds a random action.
        regions: where the bodies of a task of two or of a team start.

    Raises:
        ValueError: a robot learns a table of another skill: compiled code would write beyond its end.
    """
    robots = len(parts)
    for part in parts:
        if part.role == LEARNER and not part.mind.learner.follows:
            _check_table(part, bank, len(action_set(world.robot).codes))
    key = (msgspec.json.encode(world), robots)
    if key not in _worlds:
        _worlds[key] = World(world, robots)
    venue = make_venue(
        world,
        bank,
        limits,
        roles=[part.role for part in parts],
        teams=[part.team for part in parts],
        mates=[part.mate for part in parts],
        world=_worlds[key],
    )
    stage = venue.stage
    stage.roles.sees[:] = [part.sees for part in parts]
    stage.roles.guesses[:] = [part.guesses for part in parts]
    stage.roles.skill[:] = [part.skill for part in parts]
    stage.roles.target[:] = [part.target for part in parts]
    stage.roles.hold[:] = hold
    minds = [part.mind for part in parts]
    of_one: dict[str, NDArray[np.int64]] = {
        name: np.zeros(1, np.int64) for name in ("passes", "nearer", "trial", "lost_for", "holder", "held_at")
    }
    tally = Tally(
        rewards=np.zeros((robots, CHANNELS)),
        touched=np.zeros(robots, np.int64),
        collisions=np.zeros(robots, np.int64),
        counted=np.zeros((robots if task.task == TEAM else 0, CHANNELS), np.int64),
        **of_one,
    )
    trial = Trial(
        stage,
        task,
        make_minds(minds, time_limit, stage.memory.areas.shape[1]),
        tally,
        np.zeros((0, 6)) if regions is None else regions,
        np.zeros(1),
        no_tape(),
    )
    return Scene(venue, minds, trial, time_limit)
