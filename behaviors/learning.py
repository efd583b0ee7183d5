"""Learn a skill, from nothing or from other skills: make the models, learn the table, measure the result."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

import msgspec
import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from behaviors.checkpoint import Standing, read_checkpoint, write_checkpoint
from behaviors.coordination.relearning import coordinate
from behaviors.experience import make_models
from behaviors.recipe import Recipe, plain_recipe, recipe_digest
from behaviors.tabular.decisions import most_decisions
from behaviors.tabular.qlearning import make_learner
from behaviors.tabular.table import all_states, make_table
from behaviors.trials.solo import blank_skill, no_start, provisional_skill, solo_scene
from behaviors.trials.task import COLLISION, SUCCESS
from coevo.errors import InputError
from coevo.skill import Skill, load_skill
from coevo.soccer.rng import game_seed
from coevo.stage import INFORMED, LEARNER, SKILL

__all__ = ["Learning", "Measured", "evaluate", "learn", "wilson_interval"]

# What the random streams of a recipe's seed are for; 0 is for experience.
_LEARNING, _EVALUATION, _CHECK = 1, 2, 3
_BLOCK = 250  # trials between two reports of progress

# What a skill is measured beside.
Yardstick = Literal["random", "informed"]
Report = Callable[[int, int, float], None]


@dataclass(frozen=True)
class Measured:
    """Outcome of many trials of one policy.

    outcomes, steps: (trials,) int64; see behaviors.alone.task for the outcomes.
    success: (trials,) bool; for the task avoid, that no collision happened.
    """

    outcomes: NDArray[np.int64]
    steps: NDArray[np.int64]
    success: NDArray[np.bool_]

    @property
    def success_rate(self) -> float:
        """Share of the trials that succeeded."""
        return float(self.success.mean())

    @property
    def collision_rate(self) -> float:
        """Share of the trials that ended in a collision."""
        return float((self.outcomes == COLLISION).mean())


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the 95 % confidence interval of a share (Wilson 1927), which is sound near 0 and 1 too."""
    z = 1.959963984540054
    share, scale = successes / trials, 1.0 + z * z / trials
    centre = (share + z * z / (2.0 * trials)) / scale
    half = z * float(np.sqrt(share * (1.0 - share) / trials + z * z / (4.0 * trials * trials))) / scale
    return max(0.0, centre - half), min(1.0, centre + half)


class Learning:
    """A learning under way, a block of trials at a time; it can be kept in a file and gone on with.

    The table kept is the one whose greedy policy did best in the checks (see ``LearningSettings``).
    """

    def __init__(self, recipe: Recipe, *, seed: int, trials: int, standing: Standing | None = None) -> None:
        """Begin to learn, or go on from where a learning stands.

        Args:
            recipe: what to learn and how.
            seed, trials: instead of those of the recipe.
            standing: of a learning of the same recipe, seed and trials.

        Raises:
            InputError: the recipe leaves nothing to learn from, or its skills do not fit it or each other.
        """
        self._recipe, self._seed, self._trials = recipe, seed, trials
        self._sparse = recipe.learning.storage == "sparse"
        self._start = None if recipe.coordination is UNSET else coordinate(recipe, seed=seed)
        if self._start is not None:
            self._blank = self._start.skill
        else:
            self._blank = blank_skill(recipe, make_models(recipe, seed) if standing is None else standing.models)
        if standing is None:
            empty = make_table(*self._blank.values.shape, sparse=self._sparse)
            standing = Standing(self._blank.objects, empty if self._start is None else self._start.table())
        self._at = standing
        learner = make_learner(recipe.learning)
        self._scene = solo_scene(recipe, self._blank, LEARNER, learner=learner, table=standing.table)
        standing.table = self._scene.minds[0].table
        self._play(0)  # compiles what is not compiled yet

    @classmethod
    def load(cls, path: Path, recipe: Recipe, *, seed: int, trials: int) -> Self:
        """Go on with the learning in a checkpoint.

        Raises:
            InputError: the checkpoint is damaged, or of another recipe, seed, number of trials, or version.
        """
        standing = read_checkpoint(path, _identity(recipe, seed, trials))
        return cls(recipe, seed=seed, trials=trials, standing=standing)

    def save(self, path: Path) -> None:
        """Write a checkpoint, whole or not at all.

        Raises:
            OSError: it cannot be written.
        """
        write_checkpoint(path, self._at, _identity(self._recipe, self._seed, self._trials))

    @property
    def done(self) -> int:
        """How many trials have been run."""
        return self._at.done

    @property
    def is_finished(self) -> bool:
        """Whether all trials have been run."""
        return self._at.done == self._trials

    def advance(self) -> float:
        """Run the next block of trials, and check the table if that is due; return the share that succeeded.

        Raises:
            InputError: no start was found.
        """
        at, settings, first = self._at, self._recipe.learning, self._at.done
        outcomes = self._play(min(_BLOCK, self._trials - first))
        at.done = done = first + len(outcomes)
        due = settings.check_every and (
            self.is_finished or done // settings.check_every > first // settings.check_every
        )
        if due and done >= settings.check_from * self._trials:
            score = self._check()
            if score >= at.best_score:
                at.best, at.best_score, at.kept_after = at.table.values[: at.table.used[0]].copy(), score, done
        return float(_success(self._recipe, outcomes).mean())

    def skill(self) -> Skill:
        """Return what has been learned so far."""
        at = self._at
        about = {
            "recipe": plain_recipe(self._recipe),
            "recipe_digest": recipe_digest(self._recipe),
            "seed": self._seed,
            "trials": self._trials,
            "kept_after_trials": at.done if at.best is None else at.kept_after,
            "states_visited": int((at.table.visits.sum(axis=1) > 0).sum()),
        }
        if self._start is not None:
            about["coordination"] = self._start.about
        values = self._values(at.table.values if at.best is None else at.best)
        return dataclasses.replace(self._blank, values=values, about=about, sparse=self._sparse)

    def _values(self, learned: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return (states, actions) values of a skill from those of the table's rows."""
        values = all_states(learned, self._at.table.rows)
        return values if self._start is None else self._start.keep(values)

    def _play(self, count: int) -> NDArray[np.int64]:
        """Learn from the next trials and return their outcomes."""
        recipe, at, scene = self._recipe, self._at, self._scene
        scene.grow(0, count * most_decisions(recipe.time_limit_steps, recipe.action.min_steps))
        at.table = scene.minds[0].table
        found = scene.run(_seeds(self._seed, _LEARNING, at.done, count), first=at.done, total=self._trials)
        if found is None:
            raise no_start(recipe)
        return found.ends

    def _check(self) -> float:
        """Return the mean reward of the greedy policy, half from starts in view, half from anywhere.

        These starts are the same for all checks of one learning, and are neither those of learning nor of evaluation.
        """
        recipe = self._recipe
        now = dataclasses.replace(self._blank, values=self._values(self._at.table.values))
        reward = 0.0
        for starts in ("in-view", "anywhere"):
            changed = msgspec.structs.replace(recipe, starts=starts)
            measured = _run(changed, now, recipe.learning.check_games, self._seed, _CHECK)
            success = float((measured.outcomes == SUCCESS).mean())
            reward += 0.5 * (success * recipe.goal_reward + measured.collision_rate * recipe.collision_reward)
        return reward


def _identity(recipe: Recipe, seed: int, trials: int) -> dict[str, Any]:
    """Return what decides the result of a learning."""
    plain: dict[str, Any] = msgspec.to_builtins(recipe)
    if recipe.coordination is not UNSET:
        plain["coordination"]["digests"] = {source: load_skill(source).digest for source in recipe.coordination.skills}
    return {**plain, "seed": seed, "trials": trials}


def learn(recipe: Recipe, *, seed: int | None = None, trials: int | None = None, report: Report | None = None) -> Skill:
    """Learn the recipe's skill: from nothing, or with ``coordination`` from several skills.

    Args:
        recipe: what to learn and how.
        seed, trials: replace those of the recipe.
        report: called with (trials done, trials in all, share of the last block that succeeded).

    Raises:
        InputError: the recipe leaves nothing to learn from, or its skills do not fit it or each other.
    """
    seed = recipe.seed if seed is None else seed
    trials = recipe.trials if trials is None else trials
    learning = Learning(recipe, seed=seed, trials=trials)
    while not learning.is_finished:
        share = learning.advance()
        if report is not None:
            report(learning.done, trials, share)
    return learning.skill()


def _seeds(seed: int, stream: int, first: int, count: int) -> NDArray[np.uint64]:
    return np.array([game_seed(seed, stream, first + n) for n in range(count)], np.uint64)


def _success(recipe: Recipe, outcomes: NDArray[np.int64]) -> NDArray[np.bool_]:
    success: NDArray[np.bool_] = outcomes != COLLISION if recipe.task == "avoid" else outcomes == SUCCESS
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
            "informed", a controller that is told the true state (behaviors.alone.informed).
        games: how many trials.
        seed: the starts are drawn from it; they are never those of learning.
        starts: "in-view" or "anywhere", instead of the recipe's.
        mover: MoverSettings instead of the recipe's.
        epsilon: probability that an action is drawn at random.
    """
    changed = msgspec.structs.replace(recipe, starts=starts or recipe.starts, mover=mover or recipe.mover)
    if isinstance(skill, Skill):
        kinds = {model.kind for model in skill.objects}
        if kinds != {model.kind for model in recipe.objects}:
            wanted = ", ".join(model.kind for model in recipe.objects)
            looks = ", ".join(sorted(kinds))
            raise InputError(f"the skill {skill.name!r} looks at {looks}; the task {recipe.task} needs {wanted}")
    return _run(changed, skill, games, seed, _EVALUATION, epsilon)


def _run(
    recipe: Recipe, skill: Skill | Yardstick, games: int, seed: int, stream: int, epsilon: float = 0.0
) -> Measured:
    """Run ``games`` trials of the recipe without learning."""
    known = isinstance(skill, Skill)
    learner = make_learner(recipe.learning)._replace(epsilon_start=epsilon, epsilon_end=epsilon)
    scene = solo_scene(
        recipe,
        skill if isinstance(skill, Skill) else provisional_skill(recipe),
        INFORMED if skill == "informed" else SKILL,
        learner=learner,
        at_random=not known,
    )
    found = scene.run(_seeds(seed, stream, 0, games), total=games)
    if found is None:
        raise no_start(recipe)
    return Measured(found.ends, found.steps, _success(recipe, found.ends))
