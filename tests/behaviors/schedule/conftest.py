"""Two robots of chapter 3 that have been through the periods A to D, and trials that they play."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import pytest

from behaviors.schedule.agents import Agent
from behaviors.schedule.course import Course
from behaviors.schedule.recipe import Schedule, read_schedule
from behaviors.schedule.scene import first_table, pair_scene, run_trials_of
from behaviors.trials.minds import make_store
from behaviors.trials.scene import Scene
from coevo.stage import LEARNER

SEED, STORED, OBJECTS = 1, 3000, 5
SMALL = (
    "trials=60",
    "games=20",
    "time_limit_steps=150",
    "experience.windows=300",
    f"store.steps={STORED}",
    "store.least_windows=100",
    "store.report_orders=false",
    "transfer.trials_e=0",
    "transfer.trials_f=0",
    *(f"{who}.learning.{what}" for who in ("passer", "shooter") for what in ("check_every=50", "check_games=10")),
)


@dataclass
class Pair:
    """A passer and a shooter in a scene, with what they know and have stored."""

    schedule: Schedule
    agents: tuple[Agent, Agent]
    scene: Scene

    def run(self, stream, count, *, first=0, total=1):
        """Run trials whose seeds come from a stream."""
        return run_trials_of(self.scene, self.schedule, SEED, stream, count, first=first, total=total)

    def told(self, robot):
        """Return the (row, action, reward, steps) of each decision of a robot in the last trial."""
        decisions = self.scene.trial.minds.decisions
        made = int(decisions.made[robot])
        columns = (decisions.rows, decisions.actions, decisions.rewards, decisions.lengths)
        return list(zip(*(column[robot, :made].tolist() for column in columns), strict=True))


@pytest.fixture(scope="session")
def small_schedule():
    """Return a function that reads the schedule of chapter 3 with few and short trials."""
    return lambda *changes, name="chapter3/schedule": read_schedule(name, [*SMALL, *changes])


@pytest.fixture(scope="session")
def schooled(small_schedule):
    """Return two robots that have been through all periods; only to be read."""
    course = Course(small_schedule(), SEED)
    while not course.is_finished:
        course.advance()
    return course.agents


@pytest.fixture
def pair(schooled, small_schedule):
    """Return a function that gives a Pair which knows what ``schooled`` do, or what ``change`` makes of them."""

    def make(*changes, roles=(LEARNER, LEARNER), stores=(False, False), change=None):
        schedule = small_schedule(*changes)
        agents = tuple(
            dataclasses.replace(agent, settings=settings, old=None, store=make_store(STORED, OBJECTS))
            for agent, settings in zip(schooled, (schedule.passer, schedule.shooter), strict=True)
        )
        if change is not None:
            change(agents)
        tables = [first_table(agent, schedule) for agent in agents]
        epsilon = [schedule.fixed_epsilon] * 2
        scene = pair_scene(schedule, schedule.world, agents, roles, tables=tables, stores=stores, epsilon=epsilon)
        for agent, mind in zip(agents, scene.minds, strict=True):
            agent.store = mind.store or agent.store
        return Pair(schedule, agents, scene)

    return make


@pytest.fixture(scope="session")
def plain_update():
    """Return a function that updates lists of values by lambda-returns, or one decision after the other by (B.2)."""

    def update(rule, values, visits, told, last):
        following = [*(row for row, *_ in told[1:]), last]
        ahead = 0.0
        for k in range(len(told)) if rule.one_step else reversed(range(len(told))):
            row, action, target, length = told[k]
            after = following[k]
            if after >= 0:
                worth = max(values[after])
                if not rule.one_step and k < len(told) - 1:
                    worth = (1.0 - rule.return_lambda) * worth + rule.return_lambda * ahead
                target += rule.gamma**length * worth
            ahead = target
            rate = rule.alpha
            if rule.alpha_visits > 0.0:
                rate = max(rule.alpha_min, rule.alpha / (1.0 + visits[row][action] / rule.alpha_visits))
            values[row][action] += rate * (target - values[row][action])
            visits[row][action] += 1

    return update
