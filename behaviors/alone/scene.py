"""What trials happen in: a recipe's world, and skills that have not learned anything yet."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from behaviors.alone.task import task_params
from behaviors.alone.trials import Scene
from behaviors.recipe import ModelSettings, Recipe
from coevo.errors import InputError
from coevo.skill import ObjectModel, Skill, make_bank
from coevo.skill.estimate import make_memory
from coevo.skill.model import INPUTS, MOST_STATES, OBJECT_KINDS
from coevo.soccer.camera import camera_params, make_retina
from coevo.soccer.drive import action_set
from coevo.soccer.physics import physics_params
from coevo.soccer.world import World

__all__ = ["blank_skill", "blind_models", "make_scene", "no_start", "provisional_skill"]

_worlds: dict[tuple[bytes, int], World] = {}


def make_scene(recipe: Recipe, skill: Skill) -> Scene:
    """Return what the trials of a recipe happen in, with the eyes and the policy of a skill.

    Raises:
        InputError: the skill was learned for another drive than the recipe's.
    """
    task = task_params(recipe)
    actions = action_set(recipe.world.robot)
    bank = make_bank([skill], drive=recipe.world.robot.drive, actions=len(actions.codes))
    mates = [1, 0] if task.robots == 2 and recipe.task == "pass" else [-1] * task.robots
    return Scene(
        handles=_world(recipe, task.robots).handles,
        physics=physics_params(recipe.world),
        camera=camera_params(recipe.world),
        task=task,
        bank=bank,
        memory=make_memory(bank, mates),
        retina=make_retina(recipe.world),
        codes=actions.codes,
        commands=actions.commands,
    )


def _world(recipe: Recipe, robots: int) -> World:
    """Return a world of the recipe; kept, since a scene holds only addresses of it."""
    key = (msgspec.json.encode(recipe.world), robots)
    if key not in _worlds:
        _worlds[key] = World(recipe.world, robots)
    return _worlds[key]


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
    return Skill(recipe.name, drive, models, values, action.min_steps, action.max_steps)


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
