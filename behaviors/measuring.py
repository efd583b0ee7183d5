"""Measure a skill, or what it is compared with: trials of a task in which nothing is learned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from behaviors.recipe import Recipe
from behaviors.tabular.qlearning import make_learner
from behaviors.trials.scene import Scene, Watched
from behaviors.trials.solo import no_start, provisional_skill, solo_scene
from behaviors.trials.task import COLLISION, FAILURE, SUCCESS
from coevo.errors import InputError
from coevo.seeds import SkillStream, game_seeds
from coevo.skill import Skill
from coevo.stage import INFORMED, SKILL

__all__ = ["Measured", "Yardstick", "evaluate", "run_greedy", "succeeded", "warm_up", "watch"]

# What a skill is measured beside.
Yardstick = Literal["random", "informed"]


@dataclass(frozen=True)
class Measured:
    """Outcome of many trials of one policy.

    outcomes, steps: (trials,) int64; see behaviors.trials.task for the outcomes.
    success: (trials,) bool; for the task avoid, that no collision happened.
    collided: (trials,) bool, whether it ran into another robot.
    kicks: (trials,) int64, steps of contact with the ball.
    """

    outcomes: NDArray[np.int64]
    steps: NDArray[np.int64]
    success: NDArray[np.bool_]
    collided: NDArray[np.bool_]
    kicks: NDArray[np.int64]

    @property
    def success_rate(self) -> float:
        """Share of the trials that succeeded."""
        return float(self.success.mean())

    @property
    def collision_rate(self) -> float:
        """Share of the trials with a collision."""
        return float(self.collided.mean())


def succeeded(recipe: Recipe, outcomes: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Tell of (trials,) outcomes which are a success: of avoid, that no collision happened; of defend, no goal."""
    spared = {"avoid": COLLISION, "defend": FAILURE}
    success: NDArray[np.bool_] = outcomes != spared[recipe.task] if recipe.task in spared else outcomes == SUCCESS
    return success


def evaluate(
    recipe: Recipe,
    skill: Skill | Yardstick,
    *,
    games: int,
    seed: int,
    starts: str | None = None,
    mover: Any = None,
    epsilon: float = 0.0,
) -> Measured:
    """Run a skill from unseen starts, greedily but for a share of random actions.

    Args:
        recipe: the task.
        skill: what to measure: a skill; "random", actions that are each held as long as the recipe allows; or
            "informed", a controller that is told the true state (behaviors.trials.informed).
        games: how many trials.
        seed: the starts are drawn from it; they are never those of learning.
        starts: "in-view" or "anywhere", instead of the recipe's.
        mover: MoverSettings instead of the recipe's.
        epsilon: probability that an action is drawn at random.

    Example:
        >>> from behaviors.learning import evaluate
        >>> from behaviors.recipe import read_recipe
        >>> from coevo.skill import load_skill
        >>> recipe = read_recipe("shoot")
        >>> found = {who: evaluate(recipe, who, games=50, seed=7).success_rate for who in ("random", "informed")}
        >>> found["random"] < 0.2 < 0.8 < evaluate(recipe, load_skill("shoot"), games=50, seed=7).success_rate
        True
    """
    changed = msgspec.structs.replace(recipe, starts=starts or recipe.starts, mover=mover or recipe.mover)
    if isinstance(skill, Skill):
        _check_looks(recipe, skill)
    return run_greedy(changed, skill, games, seed, SkillStream.EVALUATION, epsilon)


def watch(
    recipe: Recipe, skill: Skill, *, games: int, seed: int, starts: str | None = None, mover: Any = None
) -> list[Watched]:
    """Return every step of the trials that ``evaluate`` runs with the same arguments.

    Raises:
        InputError: the skill is not one for this task, or no start was found.
    """
    changed = msgspec.structs.replace(recipe, starts=starts or recipe.starts, mover=mover or recipe.mover)
    _check_looks(recipe, skill)
    watched = _scene(changed, skill).watch(game_seeds(seed, SkillStream.EVALUATION, count=games))
    if watched is None:
        raise no_start(recipe)
    return watched


def warm_up(recipe: Recipe) -> None:
    """Load the machine code of trials, or compile it."""
    _scene(recipe, "random").run(game_seeds(recipe.seed, SkillStream.EVALUATION, count=0), total=0)


def _check_looks(recipe: Recipe, skill: Skill) -> None:
    kinds = {model.kind for model in skill.objects}
    if kinds != {model.kind for model in recipe.objects}:
        wanted = ", ".join(model.kind for model in recipe.objects)
        looks = ", ".join(sorted(kinds))
        raise InputError(f"the skill {skill.name!r} looks at {looks}; the task {recipe.task} needs {wanted}")


def run_greedy(
    recipe: Recipe, skill: Skill | Yardstick, games: int, seed: int, stream: SkillStream, epsilon: float = 0.0
) -> Measured:
    """Run ``games`` trials of the recipe without learning."""
    found = _scene(recipe, skill, epsilon).run(game_seeds(seed, stream, count=games), total=games)
    if found is None:
        raise no_start(recipe)
    collided = found.ends == COLLISION if recipe.ends == "event" else found.collisions > 0
    return Measured(found.ends, found.steps, succeeded(recipe, found.ends), collided, found.kicks)


def _scene(recipe: Recipe, skill: Skill | Yardstick, epsilon: float = 0.0) -> Scene:
    """Return what trials without learning happen in."""
    known = isinstance(skill, Skill)
    learner = make_learner(recipe.learning)._replace(epsilon_start=epsilon, epsilon_end=epsilon)
    return solo_scene(
        recipe,
        skill if isinstance(skill, Skill) else provisional_skill(recipe),
        INFORMED if skill == "informed" else SKILL,
        learner=learner,
        at_random=not known,
    )
