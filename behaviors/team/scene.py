"""The trials of several robots, made of a recipe and of what they have learned so far."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from behaviors.tabular.qlearning import make_learner
from behaviors.tabular.table import Table, make_table
from behaviors.team.recipe import MemberSettings, TeamRecipe, mates_of
from behaviors.trials.criteria import contact_events, make_criteria
from behaviors.trials.kernels import Results
from behaviors.trials.minds import Mind, Store, make_store
from behaviors.trials.scene import Part, Scene, make_scene
from behaviors.trials.solo import blind_models
from behaviors.trials.task import COLLIDED, CONCEDED, GIVEN_AWAY, KICKED, PASSED, SUCCEEDED, TEAM, TOUCHED, TaskParams
from coevo.errors import InputError
from coevo.skill import ObjectModel, Skill, make_bank
from coevo.skill.model import MOST_STATES
from coevo.soccer.camera import ROBOTS
from coevo.soccer.drive import action_set
from coevo.soccer.events import event_params
from coevo.soccer.placement import regions
from coevo.stage import LEARNER, SKILL, STANDING

__all__ = ["COUNTED", "Member", "no_start_of", "run_games", "team_scene", "unlearned"]

# The events of a team by their names; contact is what happens in a step, and what is told of it how long it lasted.
_EVENTS = {"goal": SUCCEEDED, "conceded": CONCEDED, "pass": PASSED, "giveaway": GIVEN_AWAY}
COUNTED = {**_EVENTS, "collision": COLLIDED, "kick": TOUCHED}


@dataclass
class Member:
    """One robot, and all that it has learned.

    Attributes:
        settings: of the recipe.
        models: of its state.
        values: (states, actions) float32 that it plays by; None as long as it has learned nothing.
        table: with which it goes on to learn.
        store: its latest experience, if models are made again from it.
    """

    settings: MemberSettings
    models: tuple[ObjectModel, ...]
    values: NDArray[np.float32] | None = None
    table: Table | None = None
    store: Store | None = None

    def skill(self, recipe: TeamRecipe) -> Skill:
        """Return what it has learned; zeros as long as there is nothing.

        Raises:
            InputError: it has more states than a skill may have.
        """
        states = math.prod(model.states for model in self.models)
        if states > MOST_STATES:
            sizes = " x ".join(str(model.states) for model in self.models)
            raise InputError(
                f"{recipe.name}: {self.settings.name} has {sizes} = {states} states, and {MOST_STATES} is the most;"
                " give some of its objects a smaller order"
            )
        values = self.values
        if values is None:
            values = np.zeros((states, len(action_set(recipe.world.robot).codes)), np.float32)
        action = recipe.action
        return Skill(
            self.settings.name, recipe.world.robot.drive, self.models, values, action.min_steps, action.max_steps
        )

    def first_table(self, recipe: TeamRecipe) -> Table:
        """Return the table that it begins to learn with: what it had, with rates that begin anew, or zeros."""
        if self.table is not None:
            return self.table._replace(visits=(self.table.visits * recipe.keep_visits).astype(np.int64))
        states, actions = self.skill(recipe).values.shape
        channels = len(recipe.reward.channels) if recipe.is_vector else 0
        return make_table(states, actions, sparse=recipe.learning.storage == "sparse", channels=channels)

    def role(self) -> int:
        """Return what it does while it does not learn."""
        return STANDING if self.values is None else SKILL


def unlearned(recipe: TeamRecipe) -> list[Member]:
    """Return the robots before they have models: they look at the right objects, but know nothing."""
    found = [Member(settings, blind_models(settings.objects)) for settings in recipe.robots]
    if recipe.stores:
        for member in found:
            member.store = make_store(recipe.store.steps, ROBOTS + len(found))  # see coevo.skill.estimate.memory_slot
    return found


def team_scene(
    recipe: TeamRecipe,
    members: Sequence[Member],
    learners: Sequence[int] = (),
    *,
    tables: Sequence[Table] = (),
    storing: bool = False,
) -> Scene:
    """Return the world with all robots in it; the skill of the bank that each has is that of its own number.

    Args:
        recipe: the game.
        members: its robots.
        learners: the numbers of those that learn.
        tables: that these learn.
        storing: whether who sees keeps it in its store, which then is a part of the scene's.
    """
    actions, settings = len(action_set(recipe.world.robot).codes), recipe.reward
    channels = len(settings.channels) if recipe.is_vector else 0
    numbers = make_learner(recipe.learning)
    criteria = None
    if recipe.is_vector and learners:
        per_action = recipe.learning.discount_per == "action"
        events = {**_EVENTS, **contact_events(settings)}
        criteria = make_criteria(settings, events, per_action=per_action, most_steps=recipe.time_limit_steps)
    parts = []
    for n, (member, mate) in enumerate(zip(members, mates_of(recipe), strict=True)):
        of = numbers if member.values is None else numbers._replace(easy_share=0.0)  # missions grow only at first
        if n in learners:
            table = tables[list(learners).index(n)]
            mind = Mind(of, table, rewards=_sums(recipe), criteria=criteria)
        else:
            still = of._replace(epsilon_start=recipe.fixed_epsilon, epsilon_end=recipe.fixed_epsilon)
            mind = Mind(still, make_table(1, actions, channels=channels))
        role = LEARNER if n in learners else member.role()
        mind.store = member.store if storing and role != STANDING else None
        parts.append(Part(role, mind, n, mate=mate, sees=role != STANDING, team=member.settings.team))
    task = TaskParams(
        task=TEAM,
        in_view=recipe.in_view,
        mover=0,
        mover_speed=0.0,
        chaser_share=0.0,
        chaser_speed=0.0,
        passer_nearer=0.0,
        every_pass=True,
        patience=0,
        gathering=False,
        goal_ends=True,
        by_last_touch=recipe.credit == "last-touch",
    )
    scene = make_scene(
        recipe.world,
        task,
        parts,
        make_bank([member.skill(recipe) for member in members], drive=recipe.world.robot.drive, actions=actions),
        event_params(recipe.world),
        time_limit=recipe.time_limit_steps,
        regions=regions([member.settings.start for member in members], recipe.ball),
    )
    for member, mind in zip(members, scene.minds, strict=True):
        if mind.store is not None:
            member.store = mind.store
    return scene


def _sums(recipe: TeamRecipe) -> dict[int, float]:
    """Return what an event is worth to a learner of action values: the sum over the channels."""
    events, sums = {**_EVENTS, "collision": COLLIDED, "kick": KICKED}, dict[int, float]()
    for channel in recipe.reward.channels:
        for event, amount in channel.earns.amounts.items():
            sums[events[event]] = sums.get(events[event], 0.0) + amount
    return sums


def run_games(
    scene: Scene, recipe: TeamRecipe, seed: int, stream: tuple[int, ...], count: int, *, first: int = 0, total: int = 1
) -> Results:
    """Run trials number ``first`` and following of ``total``, with seeds of a random stream.

    Raises:
        InputError: no start was found.
    """
    return scene.run_stream((seed, *stream), count, lambda: no_start_of(recipe), first=first, total=total)


def no_start_of(recipe: TeamRecipe) -> InputError:
    """Return what is to be raised where no start of a trial was found."""
    return InputError(
        f"{recipe.name}: no start was found where the bodies fit and the learner sees ball and goal; widen the"
        " rectangles of robots.start and ball, or set in_view = false"
    )
