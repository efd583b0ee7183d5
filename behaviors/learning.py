"""Learn a skill, from nothing or from other skills: make the models, learn the table, measure the result."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, Self

import msgspec
import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from behaviors.actor_critic.ties import ties_drawn
from behaviors.checkpoint import REMEDY, parts_of, read_checkpoint, with_prefix, write_checkpoint
from behaviors.coordination.relearning import Coordinated, coordinate, shared_models
from behaviors.curriculum import CHECKS, GREEDY, RATES, Curriculum, check_curriculum
from behaviors.experience import make_models
from behaviors.frequencies import FREQUENCIES, frequency_table, tells_frequencies
from behaviors.measuring import Measured, evaluate, run_greedy, succeeded, warm_up, watch
from behaviors.practice import Practice, Standing
from behaviors.recipe import Recipe, of_seed, plain_recipe, recipe_digest
from behaviors.tabular.qlearning import make_learner
from behaviors.tabular.table import Table, make_table
from behaviors.trials.kernels import Results
from behaviors.trials.scene import Scene
from behaviors.trials.solo import blank_skill, no_start, solo_scene
from behaviors.trials.task import COLLISION, FAILURE, GOING, SUCCESS
from coevo.complexity import value_change
from coevo.errors import InputError
from coevo.seeds import SkillStream, game_seeds, generator
from coevo.skill import ObjectModel, Skill, load_skill
from coevo.skill.model import pack_models, unpack_models
from coevo.stage import LEARNER
from coevo.study import table_bytes

__all__ = ["Learning", "Measured", "evaluate", "learn", "succeeded", "warm_up", "watch"]

Report = Callable[[int, int, float], None]
Models = tuple[ObjectModel, ...]


class _Kept(NamedTuple):
    """What a checkpoint holds: models with all their axes, where the trials stand, where the curriculum does."""

    models: Models
    standing: Standing
    curriculum: tuple[dict[str, Any], dict[str, NDArray[Any]]] | None


class Learning:
    """A learning under way, a block of trials at a time; it can be kept in a file and gone on with.

    The table kept is the one whose greedy policy did best in the checks (see ``LearningSettings``).

    Attributes:
        moved: whether the level or the axes of a curriculum have changed after the last block, or it has ended.
    """

    moved = False

    def __init__(self, recipe: Recipe, *, seed: int, trials: int, kept: _Kept | None = None) -> None:
        """Begin to learn, or go on from where a learning stands.

        Args:
            recipe: what to learn and how.
            seed, trials: instead of those of the recipe.
            kept: of a learning of the same recipe, seed and trials.

        Raises:
            InputError: the recipe leaves nothing to learn from, its skills do not fit it or each other, or its
                curriculum cannot be learned.
        """
        self._recipe, self._seed, self._trials = recipe, seed, trials
        levels = [] if recipe.curriculum is UNSET else self._checked_levels()
        looked = 0  # steps
        if kept is not None:
            self._models = kept.models
        elif recipe.coordination is not UNSET:
            self._models = shared_models(recipe, seed)
        else:
            self._models, looked = make_models(recipe, seed)
        self._curriculum = None
        if recipe.curriculum is not UNSET:
            self._curriculum = Curriculum(recipe, levels, self._models, seed, model_steps=looked)
        if self._curriculum is not None and kept is not None and kept.curriculum is not None:
            self._curriculum.restore(*kept.curriculum)
        self._start = None if recipe.coordination is UNSET else self._coordinated()
        self._blank = self._blank_now()
        if kept is not None:
            table = self._fitting(kept.standing)
        elif self._start is not None:
            table = self._start.table()
        else:
            sparse = recipe.learning.storage == "sparse"
            table = make_table(*self._blank.values.shape, sparse=sparse, channels=self._channels)
        self._scene = self._scene_now(table)
        self._practice = Practice(
            self._scene,
            [0],
            trials,
            self._play,
            check=self._check,
            rule=recipe.learning,
            block=250 if recipe.curriculum is UNSET else recipe.curriculum.trials,
            standing=None if kept is None else kept.standing,
        )
        self._play(0, 0)  # compiles what is not compiled yet

    @property
    def _channels(self) -> int:
        """Number of rewards, 0 if they are not kept apart."""
        return 0 if self._recipe.reward is UNSET or not self._recipe.is_vector else len(self._recipe.reward.channels)

    def _fitting(self, standing: Standing) -> Table:
        """Return the table of a learning that stands there; one of another skill would be written beyond its end."""
        (table,) = standing.tables
        states, actions = self._blank.values.shape
        if (len(table.rows), table.values.shape[1], table.critic.shape[1]) != (states, actions, self._channels):
            raise ValueError("its table is of another skill")
        if not 0 <= standing.done <= self._trials:
            raise ValueError(f"it tells of {standing.done} trials")
        return table

    def _checked_levels(self) -> list[Recipe]:
        """Return the recipe on each level; a world without a start is found before anything is learned."""
        levels = check_curriculum(self._recipe, self._trials)
        for level, recipe in enumerate(levels):
            try:
                run_greedy(recipe, "random", 1, self._seed, SkillStream.CHECK)
            except InputError as error:
                raise InputError(f"level {level} of curriculum.keys: {error}") from None
        return levels

    def _coordinated(self) -> Coordinated:
        """Return the recipe's skills put together, with the axes that there are."""
        curriculum = self._curriculum
        if curriculum is None:
            return coordinate(self._recipe, seed=self._seed)
        first = curriculum.first_dimension
        start = coordinate(self._recipe, seed=self._seed, models=curriculum.models_of(first))
        for dimension in range(first + 1, curriculum.controller.dimension + 1):
            start = start.grown(curriculum.models_of(dimension), curriculum.origin(dimension))
        return start

    def _blank_now(self) -> Skill:
        """Return what is learned, before anything is: with the axes that there are."""
        if self._start is not None:
            return self._start.skill
        return blank_skill(self._recipe, self._models if self._curriculum is None else self._curriculum.models)

    def _scene_now(self, table: Table) -> Scene:
        """Return what the next trials happen in."""
        here = self._here
        skill = dataclasses.replace(self._blank, min_steps=here.action.min_steps, max_steps=here.action.max_steps)
        return solo_scene(here, skill, LEARNER, learner=make_learner(here.learning), table=table)

    @property
    def _here(self) -> Recipe:
        """The recipe as it is now: on a level, if it has levels."""
        return self._recipe if self._curriculum is None else self._curriculum.recipe

    @classmethod
    def load(cls, path: Path, recipe: Recipe, *, seed: int, trials: int) -> Self:
        """Go on with the learning in a checkpoint.

        Raises:
            InputError: the checkpoint is damaged, or of another recipe, seed, number of trials, or version.
        """
        header, arrays = read_checkpoint(path, _identity(recipe, seed, trials))
        try:
            models, standing = unpack_models(header["objects"], arrays), Standing.unpack(header, arrays)
            curriculum = (header["curriculum"], parts_of("curriculum", arrays)) if "curriculum" in header else None
            return cls(recipe, seed=seed, trials=trials, kept=_Kept(models, standing, curriculum))
        except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
            raise InputError(f"{path} is damaged ({error}); {REMEDY}") from None

    def save(self, path: Path) -> None:
        """Write a checkpoint, whole or not at all.

        Raises:
            OSError: it cannot be written.
        """
        objects, models = pack_models(self._models)
        header, arrays = self._practice.at.pack()
        if self._curriculum is not None:
            header["curriculum"], more = self._curriculum.pack()
            arrays |= with_prefix("curriculum", more)
        identity = _identity(self._recipe, self._seed, self._trials)
        write_checkpoint(path, identity, {"objects": objects, **header}, {**arrays, **models})

    @property
    def done(self) -> int:
        """How many trials have been run."""
        return self._practice.at.done

    @property
    def is_finished(self) -> bool:
        """Whether all trials have been run, or the criteria of the highest level are met."""
        ended = self._curriculum is not None and self._curriculum.controller.ended
        return ended or self._practice.is_finished

    def advance(self) -> float:
        """Run the next block of trials, and check the table if that is due; return the share that succeeded.

        Raises:
            InputError: no start was found.
        """
        before = self._practice.at.tables[0]
        if self._curriculum is not None and self._curriculum.asks_change:
            before = before._replace(values=before.values.copy())
        found = self._practice.advance()
        if self._curriculum is not None:
            self._observe(self._curriculum, found, before)
        return float(succeeded(self._recipe, found.ends).mean())

    def _observe(self, curriculum: Curriculum, found: Results, before: Table) -> None:
        """Let the curriculum take note of a block of trials, and follow it."""
        counted, at, change = _counted(self._recipe, found.ends), self._practice.at, None
        if curriculum.asks_greedy:
            now = dataclasses.replace(self._blank, values=self._kept(self._practice.values_now()[0]))
            of = run_greedy(self._here, now, self._recipe.learning.check_games, self._seed, SkillStream.CHECK)
            counted |= {f"{GREEDY}{name}": count for name, count in _counted(self._recipe, of.outcomes).items()}
        if curriculum.asks_change:
            known = before.values[: before.used[0]]
            after = at.tables[0].values[: at.tables[0].used[0]]
            was = np.vstack([known, np.zeros((len(after) - len(known), after.shape[1]))])
            change = value_change(was, after, relative=True)
        event = curriculum.observe(at.done, int(found.steps.sum()), counted, change)
        self.moved = event is not None
        if event is None:
            return
        if event.kind == "end":
            self._practice.end()
            return
        curriculum.outgrow(event, at)
        if event.kind == "axis_added" and self._start is not None:
            self._start = self._start.grown(curriculum.models, curriculum.origin(event.dimension))
        self._blank = self._blank_now()
        self._scene = self._scene_now(at.tables[0])
        self._practice.go_to(self._scene)

    def files(self) -> dict[str, bytes]:
        """Return what stands beside the skill, by name of its file: tables of a curriculum, of what happened."""
        files = {} if self._curriculum is None else self._curriculum.files()
        if self._curriculum is not None and self._practice.at.checks:
            files[CHECKS] = table_bytes(self._practice.at.checks)
        if tells_frequencies(self._recipe):
            files[FREQUENCIES] = frequency_table(self._practice.at.results)
        return files

    @property
    def words(self) -> str:
        """Where its curriculum stands, to go on a sentence; nothing without one."""
        return "" if self._curriculum is None else f"; {self._curriculum.words}"

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
        if self._curriculum is not None:
            about["curriculum"] = self._curriculum.about
        values = self._kept(self._practice.values_kept()[0])
        return dataclasses.replace(
            self._blank, values=values, about=about, sparse=self._recipe.learning.storage == "sparse"
        )

    def _kept(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return (states, actions) values of a skill from those of the table."""
        if self._recipe.is_vector:
            return ties_drawn(values, generator(self._seed, SkillStream.TIES))
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
            measured = run_greedy(changed, now, recipe.learning.check_games, self._seed, SkillStream.CHECK)
            success = float((measured.outcomes == SUCCESS).mean())
            told[starts] = measured.success_rate
            earned = success * recipe.goal_reward + measured.collision_rate * recipe.collision_reward
            if recipe.task == "defend":  # it earns nothing by a goal on the other side
                earned = float((measured.outcomes == FAILURE).mean()) * recipe.conceded_reward
            reward += 0.5 * earned
        return reward, told


def _counted(recipe: Recipe, ends: NDArray[np.int64]) -> dict[str, tuple[int, int]]:
    """Return how often each rate of a curriculum was achieved in trials, and of how many."""
    achieved = (succeeded(recipe, ends), ends == COLLISION, ends == FAILURE, ends == GOING)
    return {name: (int(which.sum()), len(ends)) for name, which in zip(RATES, achieved, strict=True)}


def _identity(recipe: Recipe, seed: int, trials: int) -> dict[str, Any]:
    """Return what decides the result of a learning."""
    plain: dict[str, Any] = msgspec.to_builtins(recipe)
    if recipe.coordination is not UNSET:
        sources = [of_seed(source, seed) for source in recipe.coordination.skills]
        plain["coordination"]["digests"] = {source: load_skill(source).digest for source in sources}
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
