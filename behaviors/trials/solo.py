"""Trials of one learner, made from a recipe, and skills that have not learned anything yet."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import UNSET

from behaviors.recipe import Recipe
from behaviors.settings import ModelSettings
from behaviors.tabular.qlearning import Learner
from behaviors.tabular.table import Table, make_table
from behaviors.trials.criteria import contact_events, make_criteria
from behaviors.trials.minds import Criteria, Mind, Store
from behaviors.trials.scene import Part, Scene, make_scene
from behaviors.trials.task import COLLIDED, CONCEDED, MOVERS, SUCCEEDED, TASKS, TaskParams
from coevo.errors import InputError
from coevo.skill import ObjectModel, Skill, load_skill, make_bank
from coevo.skill.model import INPUTS, MOST_STATES, OBJECT_KINDS
from coevo.soccer.drive import action_set
from coevo.soccer.events import event_params
from coevo.stage import LEARNER, RANDOM, STANDING

__all__ = ["blank_skill", "blind_models", "criteria_of", "no_start", "provisional_skill", "solo_scene", "task_params"]

_BALL_BODY = 2  # after two robots
_AT_THE_BALL = "ball-chaser"  # a chaser whose target is another
_NOT_LEARNING = Learner(*([0.0] * len(Learner._fields)))  # type: ignore[arg-type]  # numbers of nothing


def task_params(recipe: Recipe, *, gathering: bool = False) -> TaskParams:
    """Return what the kernels need of a recipe."""
    return TaskParams(
        task=TASKS.index(recipe.task),
        in_view=recipe.starts == "in-view",
        mover=MOVERS.index("chaser" if recipe.mover.kind == _AT_THE_BALL else recipe.mover.kind),
        mover_speed=recipe.mover.speed,
        chaser_share=recipe.mover.share_of_chasers,
        chaser_speed=recipe.mover.chaser_speed,
        passer_nearer=0.0,
        every_pass=False,
        patience=recipe.learning.patience_steps,
        gathering=gathering,
        goal_ends=recipe.ends == "goal",
        by_last_touch=recipe.credit == "last-touch",
    )


def criteria_of(recipe: Recipe) -> Criteria | None:
    """Return what the kernels need of a recipe's vector-valued reward, None if it has none."""
    settings, per_action = recipe.reward, recipe.learning.discount_per == "action"
    if settings is UNSET or not recipe.is_vector:
        return None
    numbers = {"goal": SUCCEEDED, "conceded": CONCEDED, "pass": SUCCEEDED, **contact_events(settings)}
    if recipe.ends == "event":  # the first collision is the end
        numbers["collision"] = COLLIDED
    return make_criteria(settings, numbers, per_action=per_action, most_steps=recipe.time_limit_steps)


def solo_scene(
    recipe: Recipe,
    skill: Skill,
    role: int,
    *,
    learner: Learner = _NOT_LEARNING,
    table: Table | None = None,
    at_random: bool = False,
    store: Store | None = None,
) -> Scene:
    """Return what the trials of a recipe happen in.

    Args:
        recipe: task and world.
        skill: whose eyes and policy the learner has.
        role: of the learner; RANDOM gathers experience into ``store``.
        learner: numbers of learning; their epsilon is that of a robot that does not learn too.
        table: that it learns.
        at_random: act at random, each action for as long as one of the skill.
        store: where it keeps what it sees.

    Raises:
        InputError: the skill was learned for another drive than the recipe's.
    """
    actions = len(action_set(recipe.world.robot).codes)
    played = [] if recipe.mover.skill is UNSET else [load_skill(recipe.mover.skill)]
    bank = make_bank([skill, *played], drive=recipe.world.robot.drive, actions=actions)
    rewards = {
        SUCCEEDED: recipe.goal_reward,
        COLLIDED: recipe.collision_reward,
        CONCEDED: recipe.conceded_reward,
    }
    table = make_table(1, actions) if table is None else table
    criteria = criteria_of(recipe) if role == LEARNER else None
    mind = Mind(learner, table, store=store, at_random=at_random, rewards=rewards, criteria=criteria)
    mate = 1 if recipe.task == "pass" else -1
    parts = [Part(role, mind, mate=mate, guesses=role != RANDOM)]
    if recipe.mover.kind != "none":
        like = table.actor.shape  # tables of a scene are of one width
        other = Mind(_NOT_LEARNING, make_table(1, like[1], channels=like[2]))
        team, sees = int(recipe.task == "defend"), bool(played)
        target = _BALL_BODY if recipe.mover.kind == _AT_THE_BALL else 0
        mates = 0 if mate > 0 else -1
        parts.append(Part(STANDING, other, len(played), mate=mates, sees=sees, guesses=sees, team=team, target=target))
    hold = recipe.experience.hold_min_steps, recipe.experience.hold_max_steps
    task = task_params(recipe, gathering=role == RANDOM)
    limits = event_params(recipe.world)
    limit = max(recipe.time_limit_steps, recipe.experience.trial_steps if role == RANDOM else 0)
    return make_scene(recipe.world, task, parts, bank, limits, time_limit=limit, hold=hold)


def blank_skill(recipe: Recipe, models: tuple[ObjectModel, ...]) -> Skill:
    """Return a skill of these models with a table of zeros.

    Raises:
        InputError: the models have more states together than a skill may have.
    """
    states = math.prod(model.states for model in models)
    if states > MOST_STATES:
        sizes = " x ".join(str(model.states) for model in models)
        raise InputError(
            f"the recipe {recipe.name!r}: its objects have {sizes} = {states} states together, and {MOST_STATES} is the"
            " most a skill may have; give some of them a smaller order"
        )
    values = np.zeros((states, len(action_set(recipe.world.robot).codes)), np.float32)
    drive, action = recipe.world.robot.drive, recipe.action
    domain = tuple(dict.fromkeys(one.kind for one in recipe.objects if one.needed))
    return Skill(recipe.name, drive, models, values, action.min_steps, action.max_steps, domain=domain)


def blind_models(objects: Sequence[ModelSettings]) -> tuple[ObjectModel, ...]:
    """Return models that look at the right objects but know nothing, with which experience is gathered."""
    pasts = [(model, INPUTS + OBJECT_KINDS[model.kind]) for model in objects]
    return tuple(ObjectModel(m.kind, 1, np.zeros((1, past)), np.zeros(past), m.cell) for m, past in pasts)


def provisional_skill(recipe: Recipe) -> Skill:
    """Return a skill that looks at the right objects but knows nothing, with which experience is gathered."""
    return blank_skill(recipe, blind_models(recipe.objects))


def no_start(recipe: Recipe) -> InputError:
    """Return what is to be raised where no start of a trial was found."""
    return InputError(
        f"the recipe {recipe.name!r}: no start was found where the bodies fit on the field and the learner sees what"
        f" the task {recipe.task!r} is about; change world.field or world.camera, or take starts = 'anywhere'"
    )
