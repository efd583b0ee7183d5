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

from behaviors.checkpoint import read_checkpoint, write_checkpoint
from behaviors.coordination.relearning import coordinate
from behaviors.experience import make_models
from behaviors.practice import Practice, Standing
from behaviors.recipe import Recipe, plain_recipe, recipe_digest
from behaviors.tabular.qlearning import make_learner
from behaviors.tabular.table import make_table
from behaviors.trials.kernels import Results
from behaviors.trials.scene import Scene, Watched
from behaviors.trials.solo import blank_skill, no_start, provisional_skill, solo_scene
from behaviors.trials.task import COLLISION, FAILURE, SUCCESS
from coevo.errors import InputError
from coevo.seeds import SkillStream, game_seeds
from coevo.skill import ObjectModel, Skill, load_skill
from coevo.skill.model import pack_models, unpack_models
from coevo.stage import INFORMED, LEARNER, SKILL

__all__ = ["Learning", "Measured", "evaluate", "learn", "succeeded", "warm_up", "watch"]

# What a skill is measured beside.
Yardstick = Literal["random", "informed"]
Report = Callable[[int, int, float], None]
Models = tuple[ObjectModel, ...]


@dataclass(frozen=True)
class Measured:
    """Outcome of many trials of one policy.

    outcomes, steps: (trials,) int64; see behaviors.trials.task for the outcomes.
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


class Learning:
    """A learning under way, a block of trials at a time; it can be kept in a file and gone on with.

    The table kept is the one whose greedy policy did best in the checks (see ``LearningSettings``).
    """

    def __init__(
        self, recipe: Recipe, *, seed: int, trials: int, standing: tuple[Models, Standing] | None = None
    ) -> None:
        """Begin to learn, or go on from where a learning stands.

        Args:
            recipe: what to learn and how.
            seed, trials: instead of those of the recipe.
            standing: models and standing of a learning of the same recipe, seed and trials.

        Raises:
            InputError: the recipe leaves nothing to learn from, or its skills do not fit it or each other.
        """
        self._recipe, self._seed, self._trials = recipe, seed, trials
        self._start = None if recipe.coordination is UNSET else coordinate(recipe, seed=seed)
        if self._start is not None:
            self._blank = self._start.skill
        else:
            self._blank = blank_skill(recipe, make_models(recipe, seed) if standing is None else standing[0])
        if standing is not None:
            table = standing[1].tables[0]
        elif self._start is not None:
            table = self._start.table()
        else:
            table = make_table(*self._blank.values.shape, sparse=recipe.learning.storage == "sparse")
        self._scene = solo_scene(recipe, self._blank, LEARNER, learner=make_learner(recipe.learning), table=table)
        self._practice = Practice(
            self._scene,
            [0],
            trials,
            self._play,
            check=self._check,
            rule=recipe.learning,
            standing=None if standing is None else standing[1],
        )
        self._play(0, 0)  # compiles what is not compiled yet

    @classmethod
    def load(cls, path: Path, recipe: Recipe, *, seed: int, trials: int) -> Self:
        """Go on with the learning in a checkpoint.

        Raises:
            InputError: the checkpoint is damaged, or of another recipe, seed, number of trials, or version.
        """
        header, arrays = read_checkpoint(path, _identity(recipe, seed, trials))
        models = unpack_models(header["objects"], arrays)
        return cls(recipe, seed=seed, trials=trials, standing=(models, Standing.unpack(header, arrays)))

    def save(self, path: Path) -> None:
        """Write a checkpoint, whole or not at all.

        Raises:
            OSError: it cannot be written.
        """
        objects, models = pack_models(self._blank.objects)
        header, arrays = self._practice.at.pack()
        identity = _identity(self._recipe, self._seed, self._trials)
        write_checkpoint(path, identity, {"objects": objects, **header}, {**arrays, **models})

    @property
    def done(self) -> int:
        """How many trials have been run."""
        return self._practice.at.done

    @property
    def is_finished(self) -> bool:
        """Whether all trials have been run."""
        return self._practice.is_finished

    def advance(self) -> float:
        """Run the next block of trials, and check the table if that is due; return the share that succeeded.

        Raises:
            InputError: no start was found.
        """
        return float(succeeded(self._recipe, self._practice.advance().ends).mean())

    def skill(self) -> Skill:
        """Return what has been learned so far."""
        about = {
            "recipe": plain_recipe(self._recipe),
            "recipe_digest": recipe_digest(self._recipe),
            "seed": self._seed,
            "trials": self._trials,
            "kept_after_trials": self._practice.kept_after,
            "states_visited": int((self._practice.at.tables[0].visits.sum(axis=1) > 0).sum()),
        }
        if self._start is not None:
            about["coordination"] = self._start.about
        values = self._kept(self._practice.values_kept()[0])
        return dataclasses.replace(
            self._blank, values=values, about=about, sparse=self._recipe.learning.storage == "sparse"
        )

    def _kept(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return (states, actions) values of a skill from those of the table."""
        return values if self._start is None else self._start.keep(values)

    def _play(self, first: int, count: int) -> Results:
        """Learn from the next trials."""
        seeds = game_seeds(self._seed, SkillStream.LEARNING, count=count, first=first)
        found = self._scene.run(seeds, first=first, total=self._trials)
        if found is None:
            raise no_start(self._recipe)
        return found

    def _check(self) -> tuple[float, dict[str, float]]:
        """Return the mean reward of the greedy policy, half from starts in view, half from anywhere.

        These starts are the same for all checks of one learning, and are neither those of learning nor of evaluation.
        """
        recipe = self._recipe
        now = dataclasses.replace(self._blank, values=self._kept(self._practice.values_now()[0]))
        reward, told = 0.0, {}
        for starts in ("in-view", "anywhere"):
            changed = msgspec.structs.replace(recipe, starts=starts)
            measured = _run(changed, now, recipe.learning.check_games, self._seed, SkillStream.CHECK)
            success = float((measured.outcomes == SUCCESS).mean())
            told[starts] = measured.success_rate
            earned = success * recipe.goal_reward + measured.collision_rate * recipe.collision_reward
            if recipe.task == "defend":  # it earns nothing by a goal on the other side
                earned = float((measured.outcomes == FAILURE).mean()) * recipe.conceded_reward
            reward += 0.5 * earned
        return reward, told


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

    Example:
        >>> from behaviors.learning import evaluate, learn
        >>> from behaviors.recipe import read_recipe
        >>> recipe = read_recipe("search")
        >>> skill = learn(recipe, seed=1, trials=300)
        >>> skill.name, skill.values.shape
        ('search', (29, 9))
        >>> evaluate(recipe, skill, games=50, seed=7).success_rate > 0.9
        True
    """
    seed = recipe.seed if seed is None else seed
    trials = recipe.trials if trials is None else trials
    learning = Learning(recipe, seed=seed, trials=trials)
    while not learning.is_finished:
        share = learning.advance()
        if report is not None:
            report(learning.done, trials, share)
    return learning.skill()


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
    return _run(changed, skill, games, seed, SkillStream.EVALUATION, epsilon)


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


def _run(
    recipe: Recipe, skill: Skill | Yardstick, games: int, seed: int, stream: SkillStream, epsilon: float = 0.0
) -> Measured:
    """Run ``games`` trials of the recipe without learning."""
    found = _scene(recipe, skill, epsilon).run(game_seeds(seed, stream, count=games), total=games)
    if found is None:
        raise no_start(recipe)
    return Measured(found.ends, found.steps, succeeded(recipe, found.ends))


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
