"""What random actions let a robot see, and the models of its objects that are estimated from it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from behaviors.axes import simple_axes
from behaviors.lpm import identify
from behaviors.raw import raw_model
from behaviors.recipe import ModelSettings, Recipe
from behaviors.scene import make_scene, no_start, provisional_skill
from behaviors.trials import gather
from coevo.errors import InputError
from coevo.skill import ObjectModel
from coevo.skill.model import INPUTS, OBJECT_KINDS
from coevo.soccer.camera import BALL, FEATURES, OPPONENT_GOAL, OWN_GOAL, ROBOTS
from coevo.soccer.rng import game_seed

__all__ = ["Stretch", "experience", "make_models"]

Stretch = tuple[NDArray[np.float64], NDArray[np.float64]]
"""(actions (T, 2), observations (T, q)) of one trial with an object in view, each action with the image it led to."""

_STREAM = 0  # of the recipe's seed; see behaviors.learning
_ROWS, _MOST_PARTS = 20_000, 100
_SLOTS = {"ball": BALL, "own_goal": OWN_GOAL, "opponent_goal": OPPONENT_GOAL, "mate": ROBOTS}


def experience(recipe: Recipe, seed: int) -> dict[str, list[Stretch]]:
    """Act at random and return, for each object, the stretches in which it was in view.

    Raises:
        InputError: no start was found, or an object is hardly ever seen.
    """
    scene = make_scene(recipe, provisional_skill(recipe))
    objects = scene.memory.areas.shape[1]
    settings = recipe.experience
    stretches: dict[str, list[Stretch]] = {model.kind: [] for model in recipe.objects}
    seen = dict.fromkeys(stretches, 0)  # steps in view
    part = 0
    while min(seen.values()) < settings.windows:
        trial, inputs = np.zeros(_ROWS, np.int64), np.zeros((_ROWS, INPUTS))
        features, areas = np.zeros((_ROWS, objects, FEATURES)), np.zeros((_ROWS, objects))
        random = game_seed(seed, _STREAM, part)
        filled = gather(
            scene,
            random,
            settings.hold_min_steps,
            settings.hold_max_steps,
            settings.trial_steps,
            trial,
            inputs,
            features,
            areas,
        )
        if filled < _ROWS:
            raise no_start(recipe)
        for kind, found in stretches.items():
            slot = _SLOTS.get(kind, objects - 1)  # the nearest robot has the last one
            visible = areas[:, slot] > 0.0
            breaks = np.flatnonzero((np.diff(visible.astype(np.int8)) != 0) | (np.diff(trial) != 0)) + 1
            for piece in np.split(np.arange(_ROWS), breaks):
                if visible[piece[0]]:
                    seen[kind] += len(piece)
                    found.append((inputs[piece], features[piece, slot, : OBJECT_KINDS[kind]]))
        part += 1
        kind, steps = min(seen.items(), key=lambda item: item[1])
        if steps * _MOST_PARTS < settings.windows * part:
            raise InputError(
                f"the recipe {recipe.name!r}: its {kind} came into view in {steps} of {part * _ROWS} steps of random"
                f" actions, so no model can be identified from {settings.windows} (experience.windows); look at another"
                " object, or let the camera see it"
            )
    return stretches


def make_models(recipe: Recipe, seed: int) -> tuple[ObjectModel, ...]:
    """Gather experience and return the model of each of the recipe's objects.

    Raises:
        InputError: the experience is not enough for the settings of a model.
    """
    stretches = experience(recipe, seed)
    return tuple(_model(settings, stretches[settings.kind], recipe) for settings in recipe.objects)


def _model(settings: ModelSettings, stretches: list[Stretch], recipe: Recipe) -> ObjectModel:
    enough: list[Stretch] = []
    total = 0
    for stretch in stretches:
        enough.append(stretch)
        total += len(stretch[0])
        if total >= recipe.experience.windows:
            break
    if settings.estimator == "raw":
        return raw_model(
            settings.kind,
            [seen for _, seen in enough],
            order=settings.order,
            image_width=recipe.world.camera.width_px,
            cell=settings.cell,
            lost_states=settings.lost_states,
        )
    try:
        found = identify(
            enough,
            history_length=settings.history_length,
            order=settings.order,
            future_inputs=recipe.experience.future_inputs,
        )
    except ValueError as error:
        raise InputError(f"the recipe {recipe.name!r}, the model of {settings.kind}: {error}") from None
    memory_matrix = found.memory_matrix
    if settings.axes == "varimax":
        memory_matrix = simple_axes(found, enough).T @ memory_matrix
    return ObjectModel(
        settings.kind, found.history_length, memory_matrix, found.past_mean, settings.cell, settings.lost_states
    )
