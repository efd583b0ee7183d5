"""Models of the two robots of chapter 3: made, renewed, and compared by what they predict."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from behaviors.experience import Stretch, align, identified_again, stored_stretches, window_count
from behaviors.lpm import LocalPredictionModel, PersistentExcitationWarning, identify
from behaviors.schedule.agents import Agent
from behaviors.schedule.recipe import Schedule
from behaviors.settings import ModelSettings
from behaviors.trials.minds import rows_in_order
from coevo.skill.model import OBJECT_KINDS
from coevo.soccer.camera import BALL, OPPONENT_GOAL, OWN_GOAL, ROBOTS

__all__ = [
    "error_trace",
    "exchange",
    "prediction_errors",
    "renew_models",
    "residuals",
    "stored_by",
    "stored_windows",
]

_OBJECTS = {"ball": BALL, "own_goal": OWN_GOAL, "opponent_goal": OPPONENT_GOAL, "mate": ROBOTS, "robot": ROBOTS}
_CENTRE_Y = 1  # the feature whose prediction Fig. 3.8 shows

Array = NDArray[np.float64]


def stored_by(agent: Agent, kind: str) -> list[Stretch]:
    """Return the stretches of a robot's store in which an object was in view, oldest first."""
    return stored_stretches(agent.store, _OBJECTS[kind], kind)


def _all_settings(agent: Agent) -> tuple[ModelSettings, ...]:
    return (*agent.settings.objects, *agent.settings.also)


def stored_windows(agent: Agent) -> dict[str, int]:
    """Return for how many stored steps each object was in view."""
    rows = rows_in_order(agent.store)
    return {m.kind: int((agent.store.areas[rows, _OBJECTS[m.kind]] > 0.0).sum()) for m in _all_settings(agent)}


def renew_models(agent: Agent, schedule: Schedule, period: str, reuse: str) -> list[dict[str, Any]]:
    """Identify a robot's models from what it has stored; return what is to be told of each, as plain data.

    A model stays as it is if its object was in view for fewer than ``store.least_windows`` steps (the dagger of Table
    3.2), or if the stored actions are too much the same to tell their effects apart, as those of a greedy policy may
    be. What the robot knew becomes its ``old`` knowledge if ``reuse`` is "mixture", or the values of the new states if
    it is "copy". With "keep" a robot that has learned stays as it is.
    """
    first = agent.values is None
    if reuse == "keep" and not first:
        return []
    experience = schedule.experience
    if not first:  # of random experience a part is enough; of what was stored all counts
        experience = msgspec.structs.replace(experience, windows=schedule.store.steps)
    known, told = {model.kind: model for model in agent.models}, []
    for settings in _all_settings(agent):
        kind = settings.kind
        stretches = stored_by(agent, kind)
        windows = window_count(stretches)
        model, predictor = None, None
        if first or windows >= schedule.store.least_windows:
            width = schedule.world.camera.width_px
            model, predictor = identified_again(settings, stretches, experience, image_width=width)
        if model is not None and kind in known:
            if reuse == "copy" and not first and settings.estimator == "cva":
                model = align(model, known[kind], stretches)
            known[kind] = model
        if predictor is not None:
            agent.predictors[kind] = predictor
        kept = model is None
        told.append(_description(agent, kind, period, windows, stretches, kept=kept, schedule=schedule))
    if not first and agent.values is not None:
        agent.old = (agent.models, agent.values) if reuse == "mixture" else None
        agent.values = agent.values if reuse == "copy" else None
    agent.models = tuple(known[model.kind] for model in agent.models)
    return told


def _description(
    agent: Agent,
    kind: str,
    period: str,
    windows: int,
    stretches: list[Stretch],
    *,
    kept: bool,
    schedule: Schedule,
) -> dict[str, Any]:
    told: dict[str, Any] = {"period": period, "robot": agent.name, "object": kind, "windows": windows, "kept": kept}
    predictor = agent.predictors.get(kind)
    if predictor is not None:
        told |= {"order": predictor.order, "history_length": predictor.history_length}
        told["contribution"] = predictor.contribution.tolist()
        if schedule.store.report_orders and not kept:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", PersistentExcitationWarning)  # longer histories need more
                future_inputs = schedule.experience.future_inputs
                # Table 3.2 has histories of 1 to 3 steps: the rule that keeps them short.
                chosen = identify(stretches, future_inputs=future_inputs, history_rule="gain")
            agent.chosen[kind] = chosen
            told |= {"chosen_order": chosen.order, "chosen_history_length": chosen.history_length}
            told["chosen_contribution"] = chosen.contribution.tolist()
    return told


def residuals(model: LocalPredictionModel, stretches: Sequence[Stretch]) -> Array:
    """Return (windows, 2): one-step errors of the centre's y, and that y, of all rows that can be predicted."""
    parts = [np.empty((0, 2))]
    for actions, seen in stretches:
        error = seen[:, _CENTRE_Y] - model.predict(actions, seen)[:, _CENTRE_Y]
        parts.append(np.stack([error, seen[:, _CENTRE_Y]], axis=1)[np.isfinite(error)])
    return np.concatenate(parts)


def prediction_errors(agent: Agent, where: str) -> list[dict[str, Any]]:
    """Return for each object the error of predicting its centre's y one step ahead, over what is stored.

    orders: "used" are those of the recipe, "chosen" those of 3.2.3 and (3.6). rms_px: root mean square [px]. relative:
    that by the standard deviation of y itself.
    """
    told = []
    models = [("used", agent.predictors), ("chosen", agent.chosen)]
    for orders, kind, model in [(orders, *item) for orders, known in models for item in known.items()]:
        found = residuals(model, stored_by(agent, kind))
        if len(found) > 1:
            rms, spread = float(np.sqrt((found[:, 0] ** 2).mean())), float(found[:, 1].std())
            row = {"where": where, "robot": agent.name, "object": kind, "orders": orders, "windows": len(found)}
            told.append({**row, "rms_px": rms, "relative": rms / spread if spread > 0.0 else 0.0})
    return told


def exchange(agents: tuple[Agent, Agent], where: str) -> list[dict[str, Any]]:
    """Return how much larger a robot's prediction errors are with the other robot's models of the same objects."""
    told = []
    for agent, other in (agents, agents[::-1]):
        for kind, own in agent.predictors.items():
            if kind not in other.predictors:
                continue
            stretches = stored_by(agent, kind)
            mine, theirs = (residuals(model, stretches)[:, 0] for model in (own, other.predictors[kind]))
            if len(mine) and len(theirs) and mine.any():
                ratio = float(np.sqrt((theirs**2).mean() / (mine**2).mean()))
                told.append({"where": where, "robot": agent.name, "object": kind, "error_ratio": ratio})
    return told


def error_trace(agent: Agent) -> list[dict[str, Any]]:
    """Return the errors [px] in the stored trial whose objects were in view for the longest, a row a step and object.

    The first trial of the store is left out: its beginning may have been overwritten.
    """
    rows, kinds = rows_in_order(agent.store), list(agent.predictors)
    if not len(rows) or not kinds:
        return []
    trial = agent.store.trial[rows]
    seen = agent.store.areas[rows][:, [_OBJECTS[kind] for kind in kinds]] > 0.0
    numbers = [n for n in np.unique(trial) if n != trial[0]] or [trial[0]]
    longest = max(numbers, key=lambda n: int(seen[trial == n].sum(axis=0).min()))
    rows = rows[trial == longest]
    told = []
    for kind in kinds:
        features = np.where(
            agent.store.areas[rows, _OBJECTS[kind], None] > 0.0,
            agent.store.features[rows, _OBJECTS[kind], : OBJECT_KINDS[kind]],
            np.nan,
        )
        error = (
            features[:, _CENTRE_Y] - agent.predictors[kind].predict(agent.store.inputs[rows], features)[:, _CENTRE_Y]
        )
        told += [
            {"object": kind, "step": int(step) + 1, "error_px": float(error[step])}
            for step in np.flatnonzero(np.isfinite(error))
        ]
    return told
