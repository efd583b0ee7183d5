"""The trials of a passer and a shooter, made of a schedule: their world, their parts, their rewards."""

from __future__ import annotations

from collections.abc import Sequence

from behaviors.schedule.agents import Agent
from behaviors.schedule.recipe import Schedule
from behaviors.tabular.qlearning import Learner, make_learner
from behaviors.tabular.table import Table, make_table
from behaviors.trials.kernels import Results
from behaviors.trials.minds import Mind
from behaviors.trials.scene import Part, Scene, make_scene
from behaviors.trials.task import COLLIDED, PASS_AND_SHOOT, PASSED, PASSER, SUCCEEDED, TaskParams
from coevo.config import WorldSettings
from coevo.errors import InputError
from coevo.skill import make_bank
from coevo.soccer.drive import action_set
from coevo.soccer.events import event_params
from coevo.soccer.placement import regions
from coevo.stage import LEARNER

__all__ = ["first_table", "no_start_of", "pair_scene", "run_trials_of"]


def first_table(agent: Agent, schedule: Schedule) -> Table:
    """Return the table that a robot begins to learn with: its values, zeros as long as it has none."""
    states, actions = agent.skill(schedule).values.shape
    table = make_table(states, actions, sparse=agent.values is None and agent.settings.learning.storage == "sparse")
    if agent.values is not None:
        table.values[:] = agent.values
    return table


def pair_scene(
    schedule: Schedule,
    world: WorldSettings,
    agents: tuple[Agent, Agent],
    roles: Sequence[int],
    *,
    tables: Sequence[Table | None] = (None, None),
    stores: Sequence[bool] = (False, False),
    learners: Sequence[Learner | None] = (None, None),
    epsilon: Sequence[float] = (0.0, 0.0),
    time_limit: int | None = None,
) -> Scene:
    """Return the world with both robots in it; one that learns reuses what it has as ``old``.

    Skill 2 n of the scene's bank is what robot n has learned, and 2 n + 1 what it had before.

    Args:
        schedule: the method.
        world: its settings.
        agents: passer and shooter.
        roles: of each, see coevo.stage.roles.
        tables: that those who learn learn.
        stores: who stores what it sees; its store then is a part of the scene's.
        learners: numbers of those who learn, instead of the recipe's.
        epsilon: share of random actions of each, if it does not learn.
        time_limit: instead of the schedule's [steps].
    """
    actions = len(action_set(world.robot).codes)
    skills = [agent.skill(schedule, old=old) for agent in agents for old in (False, True)]
    parts = []
    for n, (agent, role, table, learner) in enumerate(zip(agents, roles, tables, learners, strict=True)):
        numbers = learner or make_learner(agent.settings.learning)
        if agent.values is not None:  # missions grow from near to far only for one that begins from nothing
            numbers = numbers._replace(easy_share=0.0)
        if role != LEARNER:
            numbers = numbers._replace(epsilon_start=epsilon[n], epsilon_end=epsilon[n])
        task = {PASSED: schedule.pass_reward} if n == PASSER else {SUCCEEDED: schedule.goal_reward}
        mind = Mind(
            numbers,
            make_table(1, actions) if table is None else table,
            store=agent.store if stores[n] else None,
            old=2 * n + 1 if role == LEARNER and agent.old is not None else -1,
            rewards={**task, COLLIDED: schedule.collision_reward},
        )
        parts.append(Part(role, mind, skill=2 * n, mate=1 - n))
    starts = schedule.starts
    task_params = TaskParams(
        task=PASS_AND_SHOOT,
        in_view=starts.in_view,
        mover=0,
        mover_speed=0.0,
        chaser_share=0.0,
        chaser_speed=0.0,
        passer_nearer=starts.passer_nearer,
        every_pass=schedule.passes_rewarded == "each",
        patience=0,
        gathering=False,
    )
    return make_scene(
        world,
        task_params,
        parts,
        make_bank(skills, drive=world.robot.drive, actions=actions),
        event_params(world),
        time_limit=time_limit or schedule.time_limit_steps,
        hold=(schedule.experience.hold_min_steps, schedule.experience.hold_max_steps),
        regions=regions([starts.passer, starts.shooter], starts.ball),
    )


def run_trials_of(
    scene: Scene, schedule: Schedule, seed: int, stream: tuple[int, ...], count: int, *, first: int = 0, total: int = 1
) -> Results:
    """Run trials number ``first`` and following of ``total``, with seeds of a random stream.

    Raises:
        InputError: no start was found.
    """
    return scene.run_stream((seed, *stream), count, lambda: no_start_of(schedule), first=first, total=total)


def no_start_of(schedule: Schedule) -> InputError:
    """Return what is to be raised where no start of a trial was found."""
    return InputError(f"{schedule.name}: no start was found; widen the rectangles of [starts], or set in_view = false")
