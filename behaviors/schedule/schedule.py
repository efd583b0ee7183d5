"""The learning schedule of chapter 3 (Uchibe 1999, 3.4 and 3.5.3): two robots go through its periods."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from behaviors.schedule.agents import NAMES, Agent, Duty, Outcomes, Period, joined, new_agents, no_outcomes
from behaviors.schedule.data import FIXED, LEARNING, PASSER, RANDOM, SHOOTER, Pair, Player, Rules, make_stage
from behaviors.schedule.models import renew_models, stored_windows
from behaviors.schedule.recipe import Schedule
from behaviors.schedule.trial import run_pair
from behaviors.tabular.decisions import make_decisions, most_decisions
from behaviors.tabular.qlearning import Learner, make_learner
from behaviors.tabular.table import Table, all_states, make_table, with_room
from coevo.config import WorldSettings
from coevo.errors import InputError
from coevo.skill import make_bank
from coevo.skill.estimate import make_memory
from coevo.soccer.camera import camera_params, make_retina
from coevo.soccer.drive import action_set
from coevo.soccer.events import EventParams, make_events
from coevo.soccer.physics import physics_params
from coevo.soccer.placement import regions
from coevo.soccer.rng import game_seed
from coevo.soccer.world import World

__all__ = ["ELSEWHERE", "Report", "Schooling"]

# What the random streams of a set's seed are for.
GATHERING, LEARNING_TRIALS, CHECKS, AFTERWARDS, ELSEWHERE = range(5)
_BLOCK = 250  # trials between two reports of progress
_GATHERED_AT_ONCE = 20  # trials

Report = Callable[[str, int, int], None]


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
        self.learners = (make_learner(schedule.passer.learning), make_learner(schedule.shooter.learning))

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
        """Return the table that a robot begins a period with: its values, zeros as long as it has none."""
        skill = agent.skill(self.schedule)
        learns = duty.role == LEARNING and agent.values is None
        table = make_table(*skill.values.shape, sparse=learns and agent.settings.learning.storage == "sparse")
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
        numbers = self.learners if learners is None else learners
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
                passer_nearer=starts.passer_nearer,
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
        self,
        pair: Pair,
        stream: tuple[int, ...],
        trials: int,
        *,
        first: int = 0,
        total: int = 1,
        limit: int | None = None,
    ) -> Outcomes:
        """Run trials number ``first`` and following of ``total``, with seeds of a random stream."""
        seeds = np.array([game_seed(self.seed, *stream, first + n) for n in range(trials)], np.uint64)
        found = no_outcomes(trials)
        if not run_pair(pair, limit or self.schedule.time_limit_steps, first, total, seeds, *found):
            raise InputError(
                f"{self.schedule.name}: no start was found; widen the rectangles of [starts], or set in_view = false"
            )
        return found

    def afterwards(self, games: int) -> Outcomes:
        """Measure what both robots do greedily, on starts that no learning and no check has seen; both store."""
        for agent in self.agents:
            agent.store.written[0] = 0
        tables = [make_table(1, len(action_set(self.settings.robot).codes)) for _ in NAMES]
        players = self.pair((FIXED, FIXED), tables, stores=(True, True))
        greedy = [player._replace(fixed_epsilon=0.0) for player in players.players]
        return self.run(players._replace(players=(greedy[0], greedy[1])), (AFTERWARDS,), games)

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
                        f"{self.schedule.name}: random actions brought {kind} into the {agent.name}'s view for"
                        f" {windows} steps, and {least} are needed; raise store.steps, or lower store.least_windows"
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
        self.trials[period.name] = joined(found)
        for n in learning:
            self.agents[n].values = all_states(best[n].values, best[n].rows)

    def _check(self, period: Period, pair: Pair, games: int) -> Outcomes:
        """Measure the greedy policies of the tables, on starts that are the same in all checks of a period."""
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
