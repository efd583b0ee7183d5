"""Which history lengths and orders are chosen for what a robot sees, with and without noise in its eyes.

For Table 3.2 of Uchibe 1999: random actions of a robot with 4-wheel steering, a ball, a goal and a robot that stands.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import click
import numpy as np

from behaviors.experience import Stretch, enough, experience
from behaviors.lpm import MAX_HISTORY_LENGTH, LocalPredictionModel, PersistentExcitationWarning, identify
from behaviors.recipe import Recipe
from behaviors.schedule.models import residuals
from behaviors.settings import ExperienceSettings, ModelSettings, MoverSettings
from coevo.config import CameraSettings, RobotSettings, WorldSettings
from coevo.console import note, output_options, show, table

__all__ = ["norms", "orders", "prediction_error", "whole_pixels"]

_OBJECTS: tuple[Literal["ball", "opponent_goal", "robot"], ...] = ("ball", "opponent_goal", "robot")
_FUTURE: tuple[Literal["keep", "project"], ...] = ("keep", "project")
_SHOWN = 6  # of the mu; all are in the file
_RULES: tuple[Literal["norm", "gain", "aic"], ...] = ("norm", "gain", "aic")


def whole_pixels(stretches: Sequence[Stretch]) -> list[Stretch]:
    """Return what a camera would have seen that measures in whole pixels."""
    return [(actions, np.round(seen)) for actions, seen in stretches]


def norms(stretches: Sequence[Stretch], future_inputs: Literal["keep", "project"], longest: int) -> list[float]:
    """Return for each history length the norm of R of standardised observations, at the order of the smallest AIC."""
    deviation = np.concatenate([seen for _, seen in stretches]).std(axis=0)
    scale = np.where(deviation > 0.0, deviation, 1.0)
    found = []
    for length in range(1, longest + 1):
        model = identify(stretches, history_length=length, future_inputs=future_inputs)
        found.append(float(np.linalg.norm(model.residual_covariance / np.outer(scale, scale), 2)))
    return found


def prediction_error(model: LocalPredictionModel, stretches: Sequence[Stretch]) -> tuple[float, float]:
    """Return the rms error of the centre's y one step ahead [px], and that by the standard deviation of y."""
    error, seen = residuals(model, stretches).T
    rms = float(np.sqrt((error**2).mean()))
    return rms, rms / float(seen.std())


def _sight(seed: int, windows: int, noise_px: float) -> dict[str, list[Stretch]]:
    recipe = Recipe(
        name="orders",
        task="pass",
        objects=tuple(ModelSettings(kind=kind) for kind in _OBJECTS),
        mover=MoverSettings(kind="standing"),
        experience=ExperienceSettings(windows=windows),
        world=WorldSettings(robot=RobotSettings(drive="4ws"), camera=CameraSettings(noise_px=noise_px)),
    )
    return experience(recipe, seed).stretches


def _chosen(kind: str, stretches: Sequence[Stretch], windows: int) -> list[dict[str, Any]]:
    """Return what each rule chooses on half of the stretches, and how well that predicts the other half."""
    known, new = enough(stretches[::2], windows), stretches[1::2]
    told = []
    for future in _FUTURE:
        of_lengths = norms(known, future, MAX_HISTORY_LENGTH)
        for rule in _RULES:
            model = identify(known, future_inputs=future, history_rule=rule)
            error_px, relative = prediction_error(model, new)
            told.append(
                {
                    "object": kind,
                    "future_inputs": future,
                    "history_rule": rule,
                    "history_length": model.history_length,
                    "order": model.order,
                    "contribution": model.contribution.tolist(),
                    "norms": of_lengths,
                    "error_px": error_px,
                    "relative_error": relative,
                }
            )
    return told


def _cells(found: Sequence[dict[str, Any]]) -> list[str]:
    """Return what the seeds chose as text: history lengths, orders, first mu, errors."""
    first = found[0]
    mu = np.mean([(one["contribution"] + [0.0] * _SHOWN)[:_SHOWN] for one in found], axis=0)
    return [
        first["object"],
        first["sight"],
        first["future_inputs"],
        first["history_rule"],
        " ".join(str(one["history_length"]) for one in found),
        " ".join(str(one["order"]) for one in found),
        " ".join(f"{value:.2f}" for value in mu),
        f"{np.mean([one['error_px'] for one in found]):.2f}",
        f"{np.mean([one['relative_error'] for one in found]):.3f}",
    ]


@click.command()
@click.option(
    "--noise", "noises", multiple=True, type=click.FloatRange(min=0.0), default=(0.0, 0.5, 1.0, 2.0), show_default=True
)
@click.option("--seeds", type=click.IntRange(min=1), default=3, show_default=True, help="How many seeds, from 1 on.")
@click.option(
    "--windows",
    type=click.IntRange(min=1000),
    default=5000,
    show_default=True,
    help="Steps in view that a model is identified from.",
)
@click.option("--out", type=click.Path(path_type=Path), help="Write all numbers to a JSON file.")
@output_options
def orders(
    *, noises: tuple[float, ...], seeds: int, windows: int, out: Path | None, as_json: bool, quiet: bool
) -> None:
    """Print the history lengths and orders that are chosen, for each standard deviation of noise in pixels.

    \b
    Example: coevo reproduce orders
             coevo reproduce orders --seeds 1 --noise 0 --noise 1
    """
    told: list[dict[str, Any]] = []
    for seed in range(1, seeds + 1):
        for noise_px in noises:
            sight = _sight(seed, 2 * windows, noise_px)
            kinds = [(f"{noise_px:g} px", sight)]
            if noise_px == 0.0:
                kinds.append(("whole pixels", {kind: whole_pixels(seen) for kind, seen in sight.items()}))
            for name, seen in kinds:
                for kind in _OBJECTS:
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore", PersistentExcitationWarning)  # long histories need more
                        chosen = _chosen(kind, seen[kind], windows)
                    told += [{"sight": name, "seed": seed, **one} for one in chosen]
            note(f"seed {seed}, noise {noise_px:g} px done", quiet=quiet)
    groups: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for one in told:
        key = (one["object"], one["future_inputs"], one["history_rule"], one["sight"])
        groups.setdefault(key, []).append(one)
    header = [
        "object",
        "noise",
        "future inputs",
        "rule",
        "history lengths",
        "orders",
        "mean mu",
        "error [px]",
        "relative",
    ]
    show(told, table(header, [_cells(groups[key]) for key in sorted(groups)]), as_json=as_json, out=out)
