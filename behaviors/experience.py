"""What a robot saw and did, cut into stretches in which an object stayed in view, and the models made of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import takewhile

import numpy as np
from numpy.typing import NDArray

from behaviors._cva import lagged
from behaviors.axes import simple_axes
from behaviors.lpm import LocalPredictionModel, identify
from behaviors.raw import raw_model
from behaviors.recipe import ExperienceSettings, ModelSettings
from coevo.skill import ObjectModel
from coevo.skill.model import INPUTS, OBJECT_KINDS

__all__ = ["Stretch", "align", "blind_models", "in_view", "make_model", "window_count"]

Array = NDArray[np.float64]
Stretch = tuple[Array, Array]  # actions (T, 2) and observations (T, features), each action with the image it led to


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


def blind_models(objects: Sequence[ModelSettings]) -> tuple[ObjectModel, ...]:
    """Return models that look at the right objects but know nothing, with which experience is gathered."""
    width = {m.kind: INPUTS + OBJECT_KINDS[m.kind] for m in objects}
    return tuple(ObjectModel(m.kind, 1, np.zeros((1, width[m.kind])), np.zeros(width[m.kind]), m.cell) for m in objects)


def window_count(stretches: Sequence[Stretch]) -> int:
    """Return for how many steps the object was in view."""
    return sum(len(actions) for actions, _ in stretches)


def _enough(stretches: Sequence[Stretch], windows: int) -> list[Stretch]:
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
    used = _enough(stretches, experience.windows)
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


def _states(model: ObjectModel, actions: Array, observations: Array, longest: int) -> Array:
    """Return (T - longest + 1, order): the states after row ``longest`` - 1 and each later one of a stretch."""
    length = model.history_length
    past = np.hstack([lagged(actions, length), lagged(observations, length)])[longest - length :]
    return np.asarray((past - model.past_mean) @ model.memory_matrix.T)


def align(model: ObjectModel, like: ObjectModel, stretches: Sequence[Stretch]) -> ObjectModel:
    """Return the model with its state turned to agree best with that of another, of the same order.

    The rotation is that of the orthogonal Procrustes problem (Schönemann 1966); covariances stay as they are.

    Args:
        model, like: of the same object.
        stretches: where their states are compared.
    """
    longest = max(model.history_length, like.history_length)
    long_enough = [(u, y) for u, y in stretches if len(u) >= longest]
    mine, theirs = (np.vstack([_states(m, u, y, longest) for u, y in long_enough]) for m in (model, like))
    left, _, right = np.linalg.svd(theirs.T @ mine)
    return dataclasses.replace(model, memory_matrix=left @ right @ model.memory_matrix)
