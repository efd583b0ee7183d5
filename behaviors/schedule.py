"""The learning schedule of chapter 3 (Uchibe 1999, 3.4 and 3.5.3): who learns, who stores, who renews models, when."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from behaviors.decisions import make_decisions, most_decisions
from behaviors.experience import blind_models
from behaviors.lpm import LocalPredictionModel
from behaviors.pair import (
    FIXED,
    LEARNING,
    PASSER,
    RANDOM,
    SHOOTER,
    STATIONARY,
    Pair,
    Player,
    Rules,
    Store,
    make_stage,
    make_store,
    run_pair,
)
from behaviors.pair_models import renew_models, stored_windows
from behaviors.qlearning import Learner, make_learner
from behaviors.schedule_recipe import LearnerSettings, Schedule
from behaviors.table import Table, all_states, make_table, with_room
from behaviors.task import COLLISION, SUCCESS
from coevo.config import WorldSettings
from coevo.errors import InputError
from coevo.skill import ObjectModel, Skill, make_bank
from coevo.skill.estimate import make_memory
from coevo.skill.model import MOST_STATES
from coevo.soccer.camera import camera_params, make_retina
from coevo.soccer.drive import action_set
from coevo.soccer.events import EventParams, make_events
from coevo.soccer.physics import physics_params
from coevo.soccer.placement import regions
from coevo.soccer.rng import game_seed
from coevo.soccer.world import World

__all__ = ["NAMES", "PERIODS", "Agent", "Duty", "Outcomes", "Period", "Report", "Schooling", "new_agents"]

NAMES = ("passer", "shooter")
# What the random streams of a set's seed are for.
GATHERING, LEARNING_TRIALS, CHECKS, AFTERWARDS, ELSEWHERE = range(5)
_BLOCK = 250  # trials between two reports of progress
_GATHERED_AT_ONCE = 20  # trials

Report = Callable[[str, int, int], None]


class Duty(NamedTuple):
    """What a robot does in a period: its role, whether it stores, and what its models are made of at the beginning."""

    role: int
    stores: bool
    models: Literal["kept", "random", "stored"]


class Period(NamedTuple):
    """A period, for the passer and the shooter."""

    name: str
    duties: tuple[Duty, Duty]


# Table 3.1. A model is first made of random actions, and later of what was stored while the other robot learned.
PERIODS = {
    "scheduled": (
        Period("A", (Duty(LEARNING, True, "random"), Duty(STATIONARY, False, "kept"))),
        Period("B", (Duty(FIXED, True, "kept"), Duty(LEARNING, True, "random"))),
        Period("C", (Duty(LEARNING, False, "stored"), Duty(FIXED, True, "kept"))),
        Period("D", (Duty(FIXED, True, "kept"), Duty(LEARNING, False, "stored"))),
    ),
    "simultaneous": (Period("S", (Duty(LEARNING, True, "random"), Duty(LEARNING, True, "random"))),),
}


@dataclass
class Agent:
    """One of the two robots, and all that it has learned.

    Attributes:
        number: PASSER or SHOOTER. settings: of the recipe.
        models: of its state. predictors: the local prediction models that these, and ``also``, were made from.
        values: (states, actions) float32; None as long as it has learned nothing.
        store: its latest experience.
        old: models and values of before the last renewal.
    """

    number: int
    settings: LearnerSettings
    models: tuple[ObjectModel, ...]
    store: Store
    predictors: dict[str, LocalPredictionModel] = field(default_factory=dict)
    values: NDArray[np.float32] | None = None
    old: tuple[tuple[ObjectModel, ...], NDArray[np.float32]] | None = None

    @property
    def name(self) -> str:
        """``passer`` or ``shooter``."""
        return NAMES[self.number]

    def skill(self, schedule: Schedule, *, old: bool = False) -> Skill:
        """Return what it has learned, or what it had before; zeros as long as there is nothing."""
        models, values = self.old if old and self.old is not None else (self.models, self.values)
        states = math.prod(model.states for model in models)
        if states > MOST_STATES:
            sizes = " x ".join(str(model.states) for model in models)
            raise InputError(
                f"the {self.name} has {sizes} = {states} states, and {MOST_STATES} is the most; give smaller orders"
            )
        drive = schedule.world.robot
        if values is None:
            values = np.zeros((states, len(action_set(drive).codes)), np.float32)
        action = self.settings.action
        return Skill(self.name, drive.drive, models, values, action.min_steps, action.max_steps)


@dataclass(frozen=True)
class Outcomes:
    """How trials went: (trials,) int64 each; see ``run_pair``."""

    ends: NDArray[np.int64]
    passes: NDArray[np.int64]
    steps: NDArray[np.int64]

    def rates(self) -> dict[str, float]:
        """Return the shares of trials with a pass, the shooter's goal and a collision, and the mean length."""
        return {
            "passing": float((self.passes > 0).mean()),
            "shooting": float((self.ends == SUCCESS).mean()),
            "collisions": float((self.ends == COLLISION).mean()),
            "steps": float(self.steps.mean()),
        }


def new_agents(schedule: Schedule) -> tuple[Agent, Agent]:
    """Return two robots that know nothing."""
    passer, shooter = (
        Agent(n, settings, blind_models(settings.objects), make_store(schedule.store.steps))
        for n, settings in enumerate((schedule.passer, schedule.shooter))
    )
    return passer, shooter


class Schooling:
    """One set of periods: two robots in a world, from nothing.

    Args:
        schedule: the method.
        seed: of this set; all that happens follows from it.
        world: where; by default that of the schedule.
        agents: who; by default two robots that know nothing.
        report: called with (period, trials done, trials in all).
    """

    def __init__(
        self,
        schedule: Schedule,
        seed: int,
        *,
        world: WorldSettings | None = None,
        agents: tuple[Agent, Agent] | None = None,
        report: Report | None = None,
    ) -> None:
        self.schedule, self.seed = schedule, seed
        self.agents = agents if agents is not None else new_agents(schedule)
        self.settings = world if world is not None else schedule.world
        self.trials: dict[str, Outcomes] = {}
        self.checks: list[dict[str, Any]] = []
        self.models: list[dict[str, Any]] = []
        self.gathered: dict[str, int] = {}
        self._world = World(self.settings, 2)
        self._report = report
        self._decisions = tuple(make_decisions(schedule.time_limit_steps) for _ in NAMES)
        self._learners = (make_learner(schedule.passer.learning), make_learner(schedule.shooter.learning))

    def learn(self, periods: tuple[Period, ...]) -> None:
        """Go through the periods."""
        for period in periods:
            duties = period.duties
            total = self.schedule.trials * (4 if self.schedule.kind == "simultaneous" else 1)
            for agent, duty in zip(self.agents, duties, strict=True):
                if duty.stores:
                    agent.store.written[0] = 0
            if any(duty.models == "random" for duty in duties):
                self._gather(period)
            for agent, duty in zip(self.agents, duties, strict=True):
                if duty.models != "kept":
                    self.models += renew_models(agent, self.schedule, period.name, self.schedule.reuse)
            tables = [self.table(agent, duty) for agent, duty in zip(self.agents, duties, strict=True)]
            self._run_period(period, tables, total)

    def table(self, agent: Agent, duty: Duty) -> Table:
        """Return the table that a robot begins a period with: zeros, or its old values with reuse "copy"."""
        skill = agent.skill(self.schedule)
        sparse = agent.settings.learning.storage == "sparse"
        table = make_table(*skill.values.shape, sparse=sparse and duty.role == LEARNING and agent.values is None)
        if agent.values is not None:
            table.values[:] = agent.values
        return table

    def pair(
        self,
        roles: tuple[int, int],
        tables: list[Table],
        *,
        stores: tuple[bool, bool] = (False, False),
        learners: tuple[Learner, Learner] | None = None,
    ) -> Pair:
        """Return the world with both robots in these roles; a robot that learns reuses what it has as ``old``."""
        schedule, world = self.schedule, self.settings
        numbers = self._learners if learners is None else learners
        actions = action_set(world.robot)
        skills = [agent.skill(schedule, old=old) for agent in self.agents for old in (False, True)]
        bank = make_bank(skills, drive=world.robot.drive, actions=len(actions.codes))
        window = round(schedule.pass_window_s / world.physics.step_s)
        players = tuple(
            Player(
                role=roles[n],
                stores=stores[n],
                old=2 * n + 1 if roles[n] == LEARNING and agent.old is not None else -1,
                fixed_epsilon=schedule.fixed_epsilon,
                learner=numbers[n],
                table=tables[n],
                decisions=self._decisions[n],
                store=agent.store,
            )
            for n, agent in enumerate(self.agents)
        )
        starts = schedule.starts
        return Pair(
            handles=self._world.handles,
            physics=physics_params(world),
            camera=camera_params(world),
            retina=make_retina(world),
            limits=EventParams(world.physics.contact_gap_m, world.physics.contact_gap_m, window),
            events=make_events(2),
            rules=Rules(
                in_view=starts.in_view,
                goal_reward=schedule.goal_reward,
                pass_reward=schedule.pass_reward,
                every_pass=schedule.passes_rewarded == "each",
                collision_reward=schedule.collision_reward,
                hold_min=schedule.experience.hold_min_steps,
                hold_max=schedule.experience.hold_max_steps,
            ),
            bank=bank,
            memory=make_memory(bank, [1, 0]),
            codes=actions.codes,
            commands=actions.commands,
            regions=regions([starts.passer, starts.shooter], starts.ball),
            stage=make_stage(),
            players=(players[0], players[1]),
        )

    def run(
        self, pair: Pair, stream: tuple[int, ...], trials: int, *, first: int = 0, total: int = 1, limit: int | None = None
    ) -> Outcomes:
        """Run trials number ``first`` and following of ``total``; their seeds come from ``stream`` and their numbers."""
        seeds = np.array([game_seed(self.seed, *stream, first + n) for n in range(trials)], np.uint64)
        ends, passes, steps = (np.zeros(trials, np.int64) for _ in range(3))
        if not run_pair(pair, limit or self.schedule.time_limit_steps, first, total, seeds, ends, passes, steps):
            raise InputError(
                f"{self.schedule.name}: no start was found; widen the rectangles of [starts], or set in_view = false"
            )
        return Outcomes(ends, passes, steps)

    def _gather(self, period: Period) -> None:
        """Let robots that will make models act at random until they have seen enough of each object.

        A robot whose policy is fixed acts by it meanwhile, and stores if it does in this period.
        """
        duties = period.duties
        roles = tuple(RANDOM if duty.models == "random" else duty.role for duty in duties)
        empty = [make_table(1, len(action_set(self.settings.robot).codes)) for _ in NAMES]
        pair = self.pair((roles[0], roles[1]), empty, stores=(duties[0].stores, duties[1].stores))
        learning = [agent for agent, duty in zip(self.agents, duties, strict=True) if duty.models == "random"]
        needed, limit, done = self.schedule.experience.windows, self.schedule.experience.trial_steps, 0
        while not all(_seen_enough(agent, needed) for agent in learning):
            stream = (GATHERING, ord(period.name))
            self.run(pair, stream, _GATHERED_AT_ONCE, first=done, limit=limit)
            done += _GATHERED_AT_ONCE
        least = self.schedule.store.least_windows
        for agent in learning:
            for kind, windows in stored_windows(agent).items():
                if windows < least:
                    raise InputError(
                        f"{self.schedule.name}: random actions brought {kind} into the {agent.name}'s view for {windows}"
                        f" steps, and {least} are needed; raise store.steps, or lower store.least_windows"
                    )
        self.gathered[period.name] = done

    def _run_period(self, period: Period, tables: list[Table], total: int) -> None:
        """Learn for ``total`` trials; of each table the one that did best in the checks is kept."""
        duties = period.duties
        roles, stores = (duties[0].role, duties[1].role), (duties[0].stores, duties[1].stores)
        learning = [n for n in (PASSER, SHOOTER) if roles[n] == LEARNING]
        rule = self.agents[learning[0]].settings.learning
        best, best_score = {n: tables[n] for n in learning}, -math.inf
        found: list[Outcomes] = []
        pair = self.pair(roles, tables, stores=stores)
        for first in range(0, total, _BLOCK):
            block = min(_BLOCK, total - first)
            done = first + block
            for n in learning:
                more = block * most_decisions(self.schedule.time_limit_steps, self.agents[n].settings.action.min_steps)
                tables[n] = with_room(tables[n], more)
            players = [player._replace(table=tables[n]) for n, player in enumerate(pair.players)]
            pair = pair._replace(players=(players[0], players[1]))
            found.append(self.run(pair, (LEARNING_TRIALS, ord(period.name)), block, first=first, total=total))
            due = rule.check_every and (done == total or done // rule.check_every > first // rule.check_every)
            if due or done == total:
                now = self._check(period, pair, rule.check_games)
                score = sum(self._worth(n, now) for n in learning)
                late = done >= rule.check_from * total
                kept = done == total if not rule.check_every else late and score >= best_score
                if kept:
                    best_score = score
                    best = {n: _copied(tables[n]) for n in learning}
                self.checks.append({"period": period.name, "trials": done, **now.rates(), "kept": int(kept)})
            if self._report is not None:
                self._report(period.name, done, total)
        self.trials[period.name] = _joined(found)
        for n in learning:
            self.agents[n].values = all_states(best[n].values, best[n].rows)

    def _check(self, period: Period, pair: Pair, games: int) -> Outcomes:
        """Measure the greedy policies of the tables as they are, on starts that are the same in all of a period's checks."""
        bank = pair.bank
        for n, player in enumerate(pair.players):
            if player.role == LEARNING:
                policy = all_states(player.table.values, player.table.rows).argmax(axis=1)
                bank.policy[bank.first[2 * n] : bank.first[2 * n] + len(policy)] = policy
        players = [
            player._replace(
                role=FIXED if player.role == LEARNING else player.role,
                stores=False,
                fixed_epsilon=0.0 if player.role == LEARNING else player.fixed_epsilon,
            )
            for player in pair.players
        ]
        return self.run(pair._replace(players=(players[0], players[1])), (CHECKS, ord(period.name)), games)

    def _worth(self, robot: int, found: Outcomes) -> float:
        """Return the mean reward of a robot; of the passes of a trial the first counts."""
        rates, schedule = found.rates(), self.schedule
        task = rates["passing"] * schedule.pass_reward if robot == PASSER else rates["shooting"] * schedule.goal_reward
        return task + rates["collisions"] * schedule.collision_reward


def _seen_enough(agent: Agent, windows: int) -> bool:
    """Tell whether each object was seen for so many steps, or no more than what is stored can be stored."""
    return int(agent.store.written[0]) >= len(agent.store.trial) or min(stored_windows(agent).values()) >= windows


def _copied(table: Table) -> Table:
    return table._replace(values=table.values[: table.used[0]].copy(), rows=table.rows.copy())


def _joined(found: list[Outcomes]) -> Outcomes:
    return Outcomes(*(np.concatenate([getattr(one, name) for one in found]) for name in ("ends", "passes", "steps")))
