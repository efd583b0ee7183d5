"""One set of chapter 3: two robots go through the periods of a schedule, a block of trials at a time.

Where a set stands can be kept in a file and gone on with; it ends as if it had never stopped.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from behaviors.checkpoint import parts_of, read_checkpoint, with_prefix, write_checkpoint
from behaviors.practice import Practice, Standing, read_results
from behaviors.schedule.agents import NAMES, PERIODS, Agent, Duty, Period, new_agents, rates, where_nearer
from behaviors.schedule.keeping import pack_agent, unpack_agent
from behaviors.schedule.models import error_trace, exchange, prediction_errors, renew_models, stored_windows
from behaviors.schedule.recipe import Schedule, transfer_world
from behaviors.schedule.scene import first_table, no_start_of, pair_scene, run_trials_of
from behaviors.schedule.transfer import learner_elsewhere, run_elsewhere
from behaviors.tabular.qlearning import make_learner
from behaviors.trials.kernels import Results
from behaviors.trials.scene import Scene, Watched
from behaviors.trials.task import PASSER
from coevo.errors import InputError
from coevo.seeds import SetStream, game_seeds
from coevo.skill import Skill
from coevo.stage import LEARNER, RANDOM, SKILL

__all__ = ["Course", "measured"]

_GATHERED_AT_ONCE = 20  # trials
_ELSEWHERE_AT_ONCE = 10  # trials, as they take long
_BEGIN_ANEW = "remove it, and the set begins anew"


class Course:
    """One set of periods, from nothing.

    Args:
        schedule: the method.
        seed: of this set; all that happens follows from it.

    Attributes:
        agents: passer and shooter, and what they have learned so far.
        results: of the trials of each period that is over.
        told: what else is to be reported, as plain data: ``gathered`` trials, ``models``, ``checks``, how the robots
            did ``after`` the schedule and how many ``states`` they told apart, prediction ``errors``, ``exchange`` of
            models, and error ``traces``.
        skills: files of what both had learned before they went to the other world.
    """

    def __init__(self, schedule: Schedule, seed: int) -> None:
        self.schedule, self.seed = schedule, seed
        self.agents = new_agents(schedule)
        self.results: dict[str, Results] = {}
        self.told: dict[str, Any] = {
            "gathered": {},
            "after": {},
            "states": {},
            "models": [],
            "checks": [],
            "errors": [],
            "exchange": [],
            "traces": [],
        }
        self.skills: dict[str, bytes] = {}
        there = schedule.transfer
        both = Duty(LEARNER, True, "kept"), Duty(LEARNER, True, "kept")
        self._here = PERIODS[schedule.periods]
        elsewhere = [Period(name, both) for name, n in (("E", there.trials_e), ("F", there.trials_f)) if n > 0]
        self._periods = (*self._here, *elsewhere)
        self._practice: Practice | None = None

    @classmethod
    def load(cls, path: Path, schedule: Schedule, seed: int) -> Self:
        """Go on with the set in a checkpoint.

        Raises:
            InputError: the checkpoint is damaged, or of another schedule, seed, or version.
        """
        at, arrays = read_checkpoint(path, _identity(schedule, seed), remedy=_BEGIN_ANEW)
        course = cls(schedule, seed)
        try:
            course._unpack(at, arrays)
        except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
            raise InputError(f"{path} is damaged ({error}); {_BEGIN_ANEW}") from None
        return course

    def _unpack(self, at: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Stand where a checkpoint says; what is wrong in it is raised as it is found."""
        if {name: type(part) for name, part in at["told"].items()} != {n: type(part) for n, part in self.told.items()}:
            raise ValueError("what is to be told is lost")
        over = [period.name for period in self._periods[: len(at["over"])]]
        if at["over"] != over:
            raise ValueError(f"the periods {at['over']} are over")
        self.told = at["told"]
        self.results = {name: read_results(parts_of(f"results.{name}", arrays)) for name in over}
        self.skills = {name: bytes(data) for name, data in parts_of("skills", arrays).items()}
        passer, shooter = (
            unpack_agent(n, empty.settings, empty.store, header, parts_of(NAMES[n], arrays))
            for n, (empty, header) in enumerate(zip(self.agents, at["agents"], strict=True))
        )
        self.agents = passer, shooter
        for agent in self.agents:
            agent.skill(self.schedule)  # whether models and values fit
            agent.skill(self.schedule, old=True)
        if at["practice"] is not None:
            self._prepare(Standing.unpack(at["practice"], parts_of("practice", arrays)))

    def save(self, path: Path) -> None:
        """Write a checkpoint, whole or not at all.

        Raises:
            OSError: it cannot be written.
        """
        arrays: dict[str, NDArray[Any]] = {}
        agents = []
        for agent in self.agents:
            header, parts = pack_agent(agent)
            agents.append(header)
            arrays |= with_prefix(agent.name, parts)
        for name, found in self.results.items():
            arrays |= with_prefix(f"results.{name}", found._asdict())
        arrays |= with_prefix("skills", {name: np.frombuffer(data, np.uint8) for name, data in self.skills.items()})
        practice = None
        if self._practice is not None:
            practice, parts = self._practice.at.pack()
            arrays |= with_prefix("practice", parts)
        at = {"told": self.told, "over": list(self.results), "agents": agents, "practice": practice}
        write_checkpoint(path, _identity(self.schedule, self.seed), at, arrays)

    @property
    def _period(self) -> Period:
        return self._periods[len(self.results)]

    @property
    def is_finished(self) -> bool:
        """Whether all periods are over."""
        return len(self.results) == len(self._periods)

    def advance(self) -> tuple[str, int, int]:
        """Run the next block of trials; return the period that they are of, and how many of its trials are done.

        Raises:
            InputError: no start was found, or random actions do not show what the models need.
        """
        period = self._period
        if self._practice is None:
            self._begin(period)
            self._prepare(None)
        practice = self._practice
        assert practice is not None
        practice.advance()
        if practice.is_finished:
            self._end(period, practice)
        return period.name, practice.at.done, practice.total

    def _is_elsewhere(self, period: Period) -> bool:
        return period not in self._here

    def _begin(self, period: Period) -> None:
        """Let the robots have the models and the empty stores that the period begins with."""
        schedule, duties = self.schedule, period.duties
        elsewhere = self._is_elsewhere(period)
        if elsewhere and not self._is_elsewhere(self._periods[len(self.results) - 1]):
            for agent in self.agents:
                agent.old = None
        if period.name == "F":
            for agent in self.agents:
                self.told["models"] += renew_models(agent, schedule, period.name, schedule.transfer.reuse)
        for agent, duty in zip(self.agents, duties, strict=True):
            if duty.stores:
                agent.store.written[0] = 0
        if any(duty.models == "random" for duty in duties):
            self._gather(period)
        for agent, duty in zip(self.agents, duties, strict=True):
            if duty.models != "kept":
                self.told["models"] += renew_models(agent, schedule, period.name, schedule.reuse)

    def _prepare(self, standing: Standing | None) -> None:
        """Get the trials of the period under way ready, from the beginning or from where they stand."""
        period, schedule = self._period, self.schedule
        roles, stores = [duty.role for duty in period.duties], [duty.stores for duty in period.duties]
        learning = [n for n, role in enumerate(roles) if role == LEARNER]
        tables = [None if n not in learning else first_table(self.agents[n], schedule) for n in range(2)]
        if standing is not None:
            for n, table in zip(learning, standing.tables, strict=True):
                tables[n] = table
        if self._is_elsewhere(period):
            self._practice = self._elsewhere(period, tables, standing)
            return
        total = schedule.trials * (4 if schedule.periods == "simultaneous" else 1)
        scene = self._scene(roles, tables=tables, stores=stores, epsilon=[schedule.fixed_epsilon] * 2)
        checked = self._scene(
            [SKILL if role == LEARNER else role for role in roles],
            epsilon=[0.0 if role == LEARNER else schedule.fixed_epsilon for role in roles],
        )

        def run(first: int, count: int) -> Results:
            stream = (SetStream.LEARNING, ord(period.name))
            return run_trials_of(scene, schedule, self.seed, stream, count, first=first, total=total)

        self._practice = Practice(
            scene,
            learning,
            total,
            run,
            check=lambda: self._check(period, checked, learning),
            rule=self.agents[learning[0]].settings.learning,
            early=True,
            standing=standing,
        )

    def _elsewhere(self, period: Period, tables: list[Any], standing: Standing | None) -> Practice:
        """Return the trials of period E or F, in the other world."""
        schedule, there, world = self.schedule, self.schedule.transfer, transfer_world(self.schedule)
        learners = [learner_elsewhere(make_learner(agent.settings.learning), there) for agent in self.agents]
        scene = pair_scene(
            schedule, world, self.agents, (LEARNER, LEARNER), tables=tables, stores=(True, True), learners=learners
        )
        self._keep_stores(scene)
        total = there.trials_e if period.name == "E" else there.trials_f

        def run(first: int, count: int) -> Results:
            seeds = game_seeds(self.seed, SetStream.ELSEWHERE, ord(period.name), count=count, first=first)
            return run_elsewhere(scene, world, there, seeds, first=first, total=total)

        return Practice(scene, [0, 1], total, run, block=_ELSEWHERE_AT_ONCE, standing=standing)

    def _scene(self, roles: Iterable[int], **given: Any) -> Scene:
        scene = pair_scene(self.schedule, self.schedule.world, self.agents, list(roles), **given)
        self._keep_stores(scene)
        return scene

    def _keep_stores(self, scene: Scene) -> None:
        """Let the robots that store do so in what compiled trials write into."""
        for agent, mind in zip(self.agents, scene.minds, strict=True):
            if mind.store is not None:
                agent.store = mind.store

    def _end(self, period: Period, practice: Practice) -> None:
        """Keep what was learned in a period, and measure it after the last one of the schedule."""
        learning = [n for n, duty in enumerate(period.duties) if duty.role == LEARNER]
        for n, values in zip(learning, practice.values_kept(), strict=True):
            self.agents[n].values = values
        self.told["checks"] += [{"period": period.name, **row} for row in practice.at.checks]
        self.results[period.name] = practice.at.results
        self._practice = None
        if period == self._here[-1]:
            self.told["after"] = measured(self.afterwards(self.schedule.games))
            self._tell_errors("simulation")
            self.told["states"] = {agent.name: agent.states for agent in self.agents}
            self.skills = {agent.name: agent.skill(self.schedule).to_bytes() for agent in self.agents}
        elif self.is_finished:
            self._tell_errors("transfer")

    def _tell_errors(self, where: str) -> None:
        self.told["errors"] += [row for agent in self.agents for row in prediction_errors(agent, where)]
        self.told["exchange"] += exchange(self.agents, where)
        self.told["traces"] += [
            {"where": where, "robot": agent.name, **row} for agent in self.agents for row in error_trace(agent)
        ]

    def afterwards(self, games: int) -> Results:
        """Measure what both robots do greedily, on starts that no learning and no check has seen; both store."""
        for agent in self.agents:
            agent.store.written[0] = 0
        scene = self._scene((SKILL, SKILL), stores=(True, True))
        return run_trials_of(scene, self.schedule, self.seed, (SetStream.AFTERWARDS,), games)

    def watch_afterwards(self, skills: Sequence[Skill], games: int) -> list[Watched]:
        """Return every step of the first trials of ``afterwards``, with what both robots had learned by then.

        Args:
            skills: of passer and shooter, from the files of a finished set.
            games: how many.

        Raises:
            InputError: no start was found.
        """
        agents = [
            dataclasses.replace(agent, models=skill.objects, values=skill.values, old=None)
            for agent, skill in zip(self.agents, skills, strict=True)
        ]
        scene = pair_scene(self.schedule, self.schedule.world, (agents[0], agents[1]), (SKILL, SKILL))
        watched = scene.watch(game_seeds(self.seed, SetStream.AFTERWARDS, count=games))
        if watched is None:
            raise no_start_of(self.schedule)
        return watched

    def _gather(self, period: Period) -> None:
        """Let robots that will make models act at random until they have seen enough of each object.

        A robot whose policy is fixed acts by it meanwhile, and stores if it does in this period.
        """
        schedule, duties = self.schedule, period.duties
        roles = [RANDOM if duty.models == "random" else duty.role for duty in duties]
        scene = self._scene(
            roles,
            stores=[duty.stores for duty in duties],
            epsilon=[schedule.fixed_epsilon] * 2,
            time_limit=schedule.experience.trial_steps,
        )
        learning = [agent for agent, duty in zip(self.agents, duties, strict=True) if duty.models == "random"]
        needed, done = schedule.experience.windows, 0
        while not all(_seen_enough(agent, needed) for agent in learning):
            stream = (SetStream.GATHERING, ord(period.name))
            run_trials_of(scene, schedule, self.seed, stream, _GATHERED_AT_ONCE, first=done)
            done += _GATHERED_AT_ONCE
        least = schedule.store.least_windows
        for agent in learning:
            for kind, windows in stored_windows(agent).items():
                if windows < least:
                    raise InputError(
                        f"{schedule.name}: random actions brought {kind} into the {agent.name}'s view for"
                        f" {windows} steps, and {least} are needed; raise store.steps, or lower store.least_windows"
                    )
        self.told["gathered"][period.name] = done

    def _check(self, period: Period, scene: Scene, learning: list[int]) -> tuple[float, Mapping[str, float]]:
        """Measure the greedy policies of the tables, on starts that are the same in all checks of a period."""
        assert self._practice is not None
        bank = scene.trial.stage.bank
        for n, values in zip(learning, self._practice.values_now(), strict=True):
            bank.policy[bank.first[2 * n] : bank.first[2 * n] + len(values)] = values.argmax(axis=1)
        games = self.agents[learning[0]].settings.learning.check_games
        found = rates(run_trials_of(scene, self.schedule, self.seed, (SetStream.CHECKS, ord(period.name)), games))
        return sum(self._worth(n, found) for n in learning), found

    def _worth(self, robot: int, found: Mapping[str, float]) -> float:
        """Return the mean reward of a robot; of the passes of a trial the first counts."""
        schedule = self.schedule
        task = found["passing"] * schedule.pass_reward if robot == PASSER else found["shooting"] * schedule.goal_reward
        return task + found["collisions"] * schedule.collision_reward


def measured(found: Results) -> dict[str, Any]:
    """Return the rates of trials: of all, and of those in which one or the other robot started nearer to the ball."""
    parts = {name: where_nearer(found, robot) for robot, name in enumerate(NAMES)}
    nearer = {name: {"games": len(part.ends), **rates(part)} for name, part in parts.items() if len(part.ends)}
    return {"games": len(found.ends), **rates(found), "nearer": nearer}


def _identity(schedule: Schedule, seed: int) -> dict[str, Any]:
    """Return what decides the result of a set."""
    return {**msgspec.to_builtins(schedule), "set_seed": str(seed)}  # JSON has no integers of 64 bits


def _seen_enough(agent: Agent, windows: int) -> bool:
    """Tell whether each object was seen for so many steps, or no more than what is stored can be stored."""
    return int(agent.store.written[0]) >= len(agent.store.trial) or min(stored_windows(agent).values()) >= windows
