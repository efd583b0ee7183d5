"""What a robot of the schedule knows and has stored, as plain data and arrays for a checkpoint."""

from __future__ import annotations

import dataclasses
import operator
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from behaviors.checkpoint import parts_of, with_prefix
from behaviors.lpm import LocalPredictionModel
from behaviors.schedule.agents import Agent
from behaviors.schedule.recipe import LearnerSettings
from behaviors.trials.minds import Store, pack_store, unpack_store
from coevo.skill.model import INPUTS, OBJECT_KINDS, pack_models, unpack_models

__all__ = ["pack_agent", "unpack_agent"]

Arrays = Mapping[str, NDArray[Any]]
_NUMBERS = ("history_length", "order")
_PARTS = tuple(f.name for f in dataclasses.fields(LocalPredictionModel) if f.name not in _NUMBERS)


def _pack_predictors(known: Mapping[str, LocalPredictionModel]) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    header = {kind: {name: getattr(model, name) for name in _NUMBERS} for kind, model in known.items()}
    arrays: dict[str, NDArray[Any]] = {}
    for kind, model in known.items():
        arrays |= with_prefix(kind, {name: getattr(model, name) for name in _PARTS})
    return header, arrays


def _unpack_predictors(header: Mapping[str, Any], arrays: Arrays) -> dict[str, LocalPredictionModel]:
    parts: dict[str, dict[str, Any]] = {kind: {**numbers, **parts_of(kind, arrays)} for kind, numbers in header.items()}
    return {kind: _checked(kind, LocalPredictionModel(**given)) for kind, given in parts.items()}


def _checked(kind: str, model: LocalPredictionModel) -> LocalPredictionModel:
    """Return a model whose parts fit each other, its object and an action.

    Raises:
        LookupError, TypeError, ValueError: they do not.
    """
    n, m, q = operator.index(model.order), INPUTS, OBJECT_KINDS[kind]
    past = operator.index(model.history_length) * (m + q)
    rank = np.shape(model.contribution)[:1]
    wanted = {
        "memory_matrix": (n, past),
        "past_mean": (past,),
        "action_mean": (m,),
        "observation_mean": (q,),
        "A": (n, n),
        "B": (n, m),
        "C": (q, n),
        "D": (q, m),
        "residual_covariance": (q, q),
        "contribution": rank,
        "aic": rank,
    }
    for name, shape in wanted.items():
        part = getattr(model, name)
        if part.dtype != np.float64 or part.shape != shape or not np.isfinite(part).all():
            raise ValueError(f"the {name} of its model of {kind} does not fit")
    return model


def pack_agent(agent: Agent) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return all that a robot knows and has stored."""
    objects, models = pack_models(agent.models)
    predictors, of_predictors = _pack_predictors(agent.predictors)
    chosen, of_chosen = _pack_predictors(agent.chosen)
    header = {"objects": objects, "old_objects": None, "predictors": predictors, "chosen": chosen}
    arrays = {
        **with_prefix("models", models),
        **with_prefix("predictors", of_predictors),
        **with_prefix("chosen", of_chosen),
        **with_prefix("store", pack_store(agent.store)),
    }
    if agent.values is not None:
        arrays["values"] = agent.values
    if agent.old is not None:
        header["old_objects"], old = pack_models(agent.old[0])
        arrays |= {**with_prefix("old", old), "old_values": agent.old[1]}
    return header, arrays


def unpack_agent(
    number: int, settings: LearnerSettings, room: Store, header: Mapping[str, Any], arrays: Arrays
) -> Agent:
    """Return the robot that was packed.

    Args:
        number, settings: see Agent.
        room: an empty store of the right size, which gets what was stored.
        header, arrays: what ``pack_agent`` returned.
    """
    unpack_store(room, parts_of("store", arrays))
    old = None
    if header["old_objects"] is not None:
        old = unpack_models(header["old_objects"], parts_of("old", arrays)), np.asarray(arrays["old_values"])
    return Agent(
        number,
        settings,
        unpack_models(header["objects"], parts_of("models", arrays)),
        room,
        _unpack_predictors(header["predictors"], parts_of("predictors", arrays)),
        _unpack_predictors(header["chosen"], parts_of("chosen", arrays)),
        arrays.get("values"),
        old,
    )
