"""What random actions let a robot see, in stretches with an object in view, and the models estimated from it."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Sequence
from itertools import takewhile
from typing import NamedTuple

import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from behaviors.lpm import LocalPredictionModel, PersistentExcitationWarning, identify
from behaviors.lpm.axes import simple_axes
from behaviors.lpm.cva import lagged
from behaviors.raw import raw_model
from behaviors.recipe import Recipe, of_seed
from behaviors.settings import ExperienceSettings, ModelSettings
from behaviors.trials.minds import Store, make_store, rows_in_order
from behaviors.trials.solo import no_start, provisional_skill, solo_scene
from coevo.errors import InputError
from coevo.seeds import SkillStream, game_seed
from coevo.skill import ObjectModel, load_skill
from coevo.skill.model import OBJECT_KINDS
from coevo.soccer.camera import BALL, OPPONENT_GOAL, OWN_GOAL, ROBOTS
from coevo.stage import RANDOM

__all__ = [
    "Experience",
    "Stretch",
    "align",
    "enough",
    "experience",
    "identified_again",
    "in_view",
    "make_model",
    "make_models",
    "model_of",
    "stored_stretches",
    "window_count",
]

Array = NDArray[np.float64]
Stretch = tuple[Array, Array]
"""(actions (T, 2), observations (T, q)) of one trial with an object in view, each action with the image it led to."""


class Experience(NamedTuple):
    """What random actions let a robot see.

    stretches: for each kind of object those in which it was in view.
    steps: how many it took until each object had been in view as long as is wanted.
    """

    stretches: dict[str, list[Stretch]]
    steps: int


_ROWS, _MOST_PARTS = 20_000, 100
_SLOTS = {"ball": BALL, "own_goal": OWN_GOAL, "opponent_goal": OPPONENT_GOAL, "mate": ROBOTS}


def in_view(trial: NDArray[np.int64], inputs: Array, features: Array, areas: Array) -> list[Stretch]:
    """Return the stretches of one trial each in which an object was in view.

    Args:
        trial: (rows,) number of the trial. inputs: (rows, 2) code of the action that led to the row's image.
        features: (rows, q) of the object. areas: (rows,) of the object [px], 0 where it is not in view.
    """
    visible = areas > 0.0
    breaks = np.flatnonzero((np.diff(visible.astype(np.int8)) != 0) | (np.diff(trial) != 0)) + 1
    pieces = [piece for piece in np.split(np.arange(len(trial)), breaks) if len(piece) and visible[piece[0]]]
    return [(inputs[piece], features[piece]) for piece in pieces]


def window_count(stretches: Sequence[Stretch]) -> int:
    """Return for how many steps the object was in view."""
    return sum(len(actions) for actions, _ in stretches)


def enough(stretches: Sequence[Stretch], windows: int) -> list[Stretch]:
    """Return the first stretches that together have ``windows`` steps, or all."""
    before = np.cumsum([0, *(len(actions) for actions, _ in stretches)])
    return [stretch for stretch, _ in takewhile(lambda pair: pair[1] < windows, zip(stretches, before, strict=False))]


def make_model(
    settings: ModelSettings, stretches: Sequence[Stretch], experience: ExperienceSettings, *, image_width: float
) -> tuple[ObjectModel, LocalPredictionModel | None]:
    """Return how an object's state is estimated, and the model it comes from (None for the estimator "raw").

    Args:
        settings: of the object.
        stretches: in which it was in view; the first that give ``experience.windows`` steps are used.
        experience: how many steps, and how future inputs are treated.
        image_width: [px].
    """
    used = enough(stretches, experience.windows)
    if settings.estimator == "raw":
        seen = [observations for _, observations in used]
        order, cell, lost = settings.order, settings.cell, settings.lost_states
        raw = raw_model(settings.kind, seen, order=order, image_width=image_width, cell=cell, lost_states=lost)
        return raw, None
    found = identify(
        used,
        history_length=settings.history_length,
        order=settings.order,
        future_inputs=experience.future_inputs,
    )
    memory_matrix = found.memory_matrix
    if settings.axes == "varimax":
        memory_matrix = simple_axes(found, used).T @ memory_matrix
    mean, length = found.past_mean, found.history_length
    return ObjectModel(settings.kind, length, memory_matrix, mean, settings.cell, settings.lost_states), found


def experience(recipe: Recipe, seed: int) -> Experience:
    """Act at random until each object was in view for ``experience.windows`` steps.

    Raises:
        InputError: no start was found, or an object is hardly ever seen.
    """
    objects = ROBOTS + (1 if recipe.mover.kind == "none" else 2)
    scene = solo_scene(recipe, provisional_skill(recipe), RANDOM, store=make_store(_ROWS, objects))
    store = scene.minds[0].store
    assert store is not None
    settings = recipe.experience
    stretches: dict[str, list[Stretch]] = {model.kind: [] for model in recipe.objects}
    seen = dict.fromkeys(stretches, 0)  # steps in view
    part = steps = 0
    while min(seen.values()) < settings.windows:
        store.written[0] = 0
        seeds = np.full(_ROWS, game_seed(seed, SkillStream.EXPERIENCE, part), np.uint64)
        if scene.run(seeds, limit=settings.trial_steps) is None:
            raise no_start(recipe)
        for kind, found in stretches.items():
            slot = _SLOTS.get(kind, objects - 1)  # the nearest robot has the last one
            features = store.features[:, slot, : OBJECT_KINDS[kind]]
            areas = store.areas[:, slot].copy()
            new = in_view(store.trial, store.inputs.copy(), features.copy(), areas)
            if seen[kind] < settings.windows:
                enough_after = np.searchsorted(np.cumsum(areas > 0.0), settings.windows - seen[kind])
                steps = max(steps, part * _ROWS + min(int(enough_after) + 1, _ROWS))
            seen[kind] += window_count(new)
            found.extend(new)
        part += 1
        kind, least = min(seen.items(), key=lambda item: item[1])
        if least * _MOST_PARTS < settings.windows * part:
            raise InputError(
                f"the recipe {recipe.name!r}: its {kind} came into view in {least} of {part * _ROWS} steps of random"
                f" actions, so no model can be identified from {settings.windows} (experience.windows); look at another"
                " object, or let the camera see it"
            )
    return Experience(stretches, steps)


def make_models(recipe: Recipe, seed: int) -> tuple[tuple[ObjectModel, ...], int]:
    """Return the model of each of the recipe's objects: that of another skill, or estimated from experience.

    Returns:
        The models, and how many steps that experience took; 0 without any.

    Raises:
        InputError: the experience is not enough for the settings of a model, or the other skill has none.
    """
    given = {one.kind: model_of(one.model_of, one.kind, seed) for one in recipe.objects if one.model_of is not UNSET}
    found = experience(recipe, seed) if len(given) < len(recipe.objects) else Experience({}, 0)
    models = tuple(given.get(one.kind) or _model(recipe, one, found.stretches[one.kind]) for one in recipe.objects)
    return models, found.steps


def model_of(source: str, kind: str, seed: int) -> ObjectModel:
    """Return the model that a skill has of an object.

    Args:
        source: the skill, see ``of_seed``.
        kind: of the object.
        seed: of the learning.

    Raises:
        InputError: there is no such skill, or it does not look at the object.
    """
    skill = load_skill(of_seed(source, seed))
    for model in skill.objects:
        if model.kind == kind:
            return model
    looks = ", ".join(model.kind for model in skill.objects)
    raise InputError(f"model_of: the skill {source!r} looks at {looks}, so it has no model of {kind}")


def _model(recipe: Recipe, settings: ModelSettings, stretches: list[Stretch]) -> ObjectModel:
    try:
        return make_model(settings, stretches, recipe.experience, image_width=recipe.world.camera.width_px)[0]
    except ValueError as error:
        raise InputError(f"the recipe {recipe.name!r}, the model of {settings.kind}: {error}") from None


def stored_stretches(store: Store, slot: int, kind: str) -> list[Stretch]:
    """Return the stretches of a store in which an object was in view, oldest first.

    Args:
        store: of a robot.
        slot: of the object in its memory.
        kind: of the object.
    """
    rows = rows_in_order(store)
    features = store.features[rows, slot, : OBJECT_KINDS[kind]]
    return in_view(store.trial[rows], store.inputs[rows], features, store.areas[rows, slot])


def identified_again(
    settings: ModelSettings, stretches: list[Stretch], experience: ExperienceSettings, *, image_width: float
) -> tuple[ObjectModel | None, LocalPredictionModel | None]:
    """Return a new model of an object as ``make_model`` does, none if the actions do not excite it.

    Those of a greedy policy may be too much the same to tell their effects apart.

    Raises:
        InputError: what was seen is not enough for the settings of the model.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error", PersistentExcitationWarning)
        try:
            return make_model(settings, stretches, experience, image_width=image_width)
        except PersistentExcitationWarning:
            return None, None
        except ValueError as error:
            raise InputError(f"the model of {settings.kind} cannot be made again: {error}") from None


def _states(model: ObjectModel, actions: Array, observations: Array, longest: int) -> Array:
    """Return (T - longest + 1, order): the states after row ``longest`` - 1 and each later one of a stretch."""
    length = model.history_length
    past = np.hstack([lagged(actions, length), lagged(observations, length)])[longest - length :]
    return np.asarray((past - model.past_mean) @ model.memory_matrix.T)


def align(model: ObjectModel, like: ObjectModel, stretches: Sequence[Stretch]) -> ObjectModel:
    """Return the model with its state mapped linearly to agree best with that of another.

    The cells of (3.9) then mean what they meant for the other, and the values of its table still hold. Turning the axes
    is not enough: states have unit variance in the experience that their model was made from, and experience of a
    policy is spread otherwise than that of random actions.

    Args:
        model, like: of the same object.
        stretches: where their states are compared, by least squares.
    """
    longest = max(model.history_length, like.history_length)
    long_enough = [(u, y) for u, y in stretches if len(u) >= longest]
    mine, theirs = (np.vstack([_states(m, u, y, longest) for u, y in long_enough]) for m in (model, like))
    centre, centre_like = mine.mean(axis=0), theirs.mean(axis=0)
    mapping = np.linalg.lstsq(mine - centre, theirs - centre_like, rcond=None)[0].T
    memory_matrix = mapping @ model.memory_matrix
    # mapping (M (p - mean) - centre) + centre_like, written as one matrix and one mean
    mean = model.past_mean - np.linalg.pinv(memory_matrix) @ (centre_like - mapping @ centre)
    return dataclasses.replace(model, memory_matrix=memory_matrix, past_mean=mean)
