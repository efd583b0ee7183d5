"""What a skill is measured at: its card, as plain data and in words."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import msgspec
from msgspec import UNSET

from behaviors.measuring import Yardstick, evaluate
from behaviors.recipe import Recipe
from behaviors.settings import LearningSettings, MoverSettings
from behaviors.trials.task import STRAY_GOAL
from coevo.skill import Skill
from coevo.statistics import share_interval

__all__ = ["describe", "describe_curriculum", "make_card", "measure", "measured_mover"]

# What a skill of each task does, where its recipe has no description of its own.
_TASKS = {
    "shoot": "drives the ball into the opponent's goal",
    "pass": "plays the ball to its team mate",
    "avoid": "keeps clear of the nearest robot",
    "search": "turns and moves until the ball is in view",
    "defend": "keeps an attacker's ball out of its own goal",
    "home": "drives back to its own goal",
}


def make_card(recipe: Recipe, skill: Skill, *, games: int, seed: int) -> dict[str, Any]:
    """Measure a skill on unseen starts and return its card: plain data."""
    measured = {starts: measure(recipe, skill, games=games, seed=seed, starts=starts) for starts in _starts(recipe)}
    curriculum = {"curriculum": skill.about["curriculum"]} if "curriculum" in skill.about else {}
    return {
        "name": skill.name,
        "task": recipe.task,
        "description": recipe.description or _TASKS[recipe.task],
        "drive": skill.drive,
        "learned_with": {"seed": recipe.seed, "trials": recipe.trials},
        **curriculum,
        "digest": skill.digest,
        "states": int(skill.values.shape[0]),
        "orders": {model.kind: model.order for model in skill.objects},
        "history_lengths": {model.kind: model.history_length for model in skill.objects},
        "measured": measured,
        "random_actions": _beside(recipe, "random", games=games, seed=seed),
        "true_state_controller": _beside(recipe, "informed", games=games, seed=seed),
    }


def _beside(recipe: Recipe, yardstick: Yardstick, *, games: int, seed: int) -> dict[str, Any]:
    if recipe.mover.skill is not UNSET:  # the skill may be learned anew meanwhile
        return _yardstick.__wrapped__(recipe, yardstick, games, seed)
    task = msgspec.structs.replace(recipe, seed=0, trials=1, curriculum=UNSET)
    if recipe.reward is not UNSET:  # what is learned from it does not matter to them
        task = msgspec.structs.replace(task, reward=UNSET, learning=LearningSettings())
    return _yardstick(task, yardstick, games, seed)


@lru_cache(maxsize=8)  # a study measures hundreds of skills beside the same
def _yardstick(recipe: Recipe, yardstick: Yardstick, games: int, seed: int) -> dict[str, Any]:
    return {starts: measure(recipe, yardstick, games=games, seed=seed, starts=starts) for starts in _starts(recipe)}


def _starts(recipe: Recipe) -> list[str]:
    return ["in-view"] if recipe.task in ("search", "avoid") else ["in-view", "anywhere"]


def measured_mover(recipe: Recipe) -> MoverSettings | None:
    """Return what the other robot does when a skill is measured, None for what it does in the recipe.

    Success of avoid is defined against a robot that moves at random.
    """
    return MoverSettings(kind="random") if recipe.task == "avoid" else None


def measure(recipe: Recipe, skill: Skill | Yardstick, *, games: int, seed: int, starts: str) -> dict[str, Any]:
    """Return what a skill, or what it is compared with, does from unseen starts, with the 95 % confidence interval."""
    result = evaluate(recipe, skill, games=games, seed=seed, starts=starts, mover=measured_mover(recipe))
    data: dict[str, Any] = {
        "starts": starts,
        "games": games,
        "seed": seed,
        "success_rate": result.success_rate,
        "ci95": list(share_interval(int(result.success.sum()), games)),
        "mean_steps": float(result.steps.mean()),
        "collision_rate": result.collision_rate,
    }
    if recipe.ends == "goal":
        data["mean_kicks"] = float(result.kicks.mean())
        data["stray_goal_rate"] = float((result.outcomes == STRAY_GOAL).mean())
    if recipe.task == "avoid":
        chaser = MoverSettings(kind="chaser", speed=0.3)
        chased = evaluate(recipe, skill, games=games, seed=seed, starts=starts, mover=chaser)
        data["collision_rate_chaser"] = chased.collision_rate
        data["ci95_chaser"] = list(share_interval(int((~chased.success).sum()), games))
    return data


def describe(label: str, data: dict[str, Any]) -> list[str]:
    """Return what ``measure`` found in words, a line or two."""
    low, high = data["ci95"]
    first = (
        f"  {label:20s}  success {data['success_rate']:.3f} [{low:.3f}, {high:.3f}]"
        f"  collisions {data['collision_rate']:.3f}  mean {data['mean_steps']:.0f} steps  ({data['games']} trials)"
    )
    lines = [first]
    if "mean_kicks" in data:
        stray = f", goals of the other robot {data['stray_goal_rate']:.3f}" if data["stray_goal_rate"] else ""
        lines.append(f"{'':24s}{data['mean_kicks']:.1f} steps of contact with the ball a trial{stray}")
    if "collision_rate_chaser" in data:
        low, high = data["ci95_chaser"]
        chased = data["collision_rate_chaser"]
        lines.append(f"{'':24s}collisions with a chaser at 0.3 speed {chased:.3f} [{low:.3f}, {high:.3f}]")
    return lines


def describe_curriculum(told: dict[str, Any]) -> str:
    """Return in a sentence how far a curriculum came."""
    end = "its criteria were met there" if told["met"] else "its criteria were not met there"
    said = f"{told['trials']} trials, to level {told['level']} of 0 to {told['levels'] - 1}; {end}"
    axes = ", ".join(f"{kind} {axis}" for kind, axis in told["axes"])
    return f"{said}; axes: {axes}" if axes else said
