"""Put several learned skills together, to be learned again only where they compete (appendix B.2)."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from behaviors.coordination.areas import RELEARN, Areas, Behaviour, areas_of, component, first_values, state_values
from behaviors.experience import model_of
from behaviors.recipe import Recipe, of_seed
from behaviors.settings import ModelSettings
from behaviors.tabular.growing import origins
from behaviors.tabular.qlearning import make_learner
from behaviors.tabular.table import Table, make_table
from behaviors.trials.solo import no_start, solo_scene
from coevo.config import check
from coevo.errors import InputError
from coevo.seeds import SkillStream, game_seeds
from coevo.skill import ObjectModel, Skill, load_skill, make_bank
from coevo.soccer.drive import action_set
from coevo.stage import LEARNER

__all__ = ["Coordinated", "coordinate", "expected_steps", "shared_models"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Coordinated:
    """Several skills on their composite space, before anything is learned again.

    skill: acts by each skill in its area and by the first values elsewhere.
    names, digests: of the skills.
    areas: who acts where.
    values: (states, actions) float64 to learn on: what (B.6) bootstraps from in the areas, first values elsewhere.
    """

    skill: Skill
    names: tuple[str, ...]
    digests: dict[str, str]
    areas: Areas
    values: Array

    @property
    def fixed(self) -> NDArray[np.bool_]:
        """(states,) whether a state is in a no-more-learning area."""
        fixed: NDArray[np.bool_] = self.areas.area != RELEARN
        return fixed

    def table(self) -> Table:
        """Return a table to learn on, its rows fixed in the no-more-learning areas."""
        return make_table(*self.values.shape)._replace(values=self.values.copy(), fixed=self.fixed)

    def keep(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return (states, actions) values with the skills' own in their areas.

        The table has them on another level there, and a row that is moved and rounded might choose another action.
        """
        return np.where(self.fixed[:, None], self.skill.values, values)

    def grown(self, models: Sequence[ObjectModel], origin: NDArray[np.int64]) -> Coordinated:
        """Return it after an object got an axis more: each state is what its origin was (4.3), and in its area.

        Args:
            models: with the axis.
            origin: (new states,) see ``origins``.
        """
        first = np.unique(origin, return_index=True)[1]
        areas = Areas(self.areas.area[origin], first[self.areas.kernels], self.areas.distance[origin])
        skill = dataclasses.replace(self.skill, objects=tuple(models), values=self.skill.values[origin])
        return dataclasses.replace(self, skill=skill, areas=areas, values=self.values[origin])

    @property
    def about(self) -> dict[str, Any]:
        """What a skill file tells of it."""
        return {"skills": self.digests, "states": self.sizes}

    @property
    def sizes(self) -> dict[str, int]:
        """Number of states in the area of each skill and in the re-learning area."""
        counted = {name: int((self.areas.area == i).sum()) for i, name in enumerate(self.names)}
        return {**counted, "re-learning": int((self.areas.area == RELEARN).sum())}


def coordinate(recipe: Recipe, *, seed: int, models: Sequence[ObjectModel] | None = None) -> Coordinated:
    """Put the recipe's skills together on the composite space and divide it into areas.

    Args:
        recipe: with ``coordination``.
        seed: of the learning, and of the trials from which the steps to the goals are estimated.
        models: of its objects; by default ``shared_models``, of which these may be the first axes.

    Raises:
        InputError: the skills do not fit the recipe or each other.
    """
    settings = recipe.coordination
    assert settings is not UNSET
    skills = _skills(recipe, seed)
    models = shared_models(recipe, seed) if models is None else tuple(models)
    behaviours = [_behaviour(recipe, skill, _own_states(models, skill), seed) for skill in skills]
    try:
        areas = areas_of(
            behaviours,
            max_iterations=settings.max_iterations,
            split_std=settings.split_std,
            merge_distance=settings.merge_distance,
        )
    except ValueError as error:
        raise InputError(f"the recipe {recipe.name!r}: {error}; choose other skills, or learn them longer") from None
    if settings.areas == "none":
        areas = dataclasses.replace(areas, area=np.full_like(areas.area, RELEARN))
    values = first_values(behaviours, areas.distance, how=settings.initial)
    table = values.copy()
    for i, one in enumerate(behaviours):
        here = areas.area == i
        values[here] = one.levelled[one.component[here]]
        table[here] = one.values[one.component[here]]
    skill = Skill(
        recipe.name,
        recipe.world.robot.drive,
        models,
        table.astype(np.float32),
        recipe.action.min_steps,
        recipe.action.max_steps,
    )
    digests = {source: found.digest for source, found in zip(_sources(recipe, seed), skills, strict=True)}
    return Coordinated(skill, tuple(one.name for one in behaviours), digests, areas, values)


def expected_steps(recipe: Recipe, skill: Skill, *, trials: int, seed: int) -> Array:
    """Return the expected number of physical steps to the goal from each state (states,), acting by the skill.

    It is the mean over greedy trials from anywhere, by the learning rule of the values with steps as rewards. A trial
    that ends without the goal counts its time limit on top; a state that was never met counts the time limit.

    Args:
        recipe: the skill's task.
        skill: what acts.
        trials: how many trials.
        seed: the starts are drawn from it.

    Raises:
        InputError: no start was found.
    """
    recipe = msgspec.structs.replace(recipe, starts="anywhere")
    never = float(recipe.time_limit_steps)
    mean = msgspec.structs.replace(recipe.learning, alpha=1.0, alpha_visits=1.0, update="lambda-returns")
    learner = make_learner(mean)._replace(gamma=1.0, easy_share=0.0, follows=True, never=never)
    table = make_table(len(skill.values), 1)
    table.values[:] = never
    seeds = game_seeds(seed, SkillStream.STEPS, count=trials)
    scene = solo_scene(recipe, skill, LEARNER, learner=learner, table=table)
    if scene.run(seeds, total=trials) is None:
        raise no_start(recipe)
    return scene.minds[0].table.values[:, 0]


def _sources(recipe: Recipe, seed: int) -> list[str]:
    assert recipe.coordination is not UNSET
    return [of_seed(source, seed) for source in recipe.coordination.skills]


def _skills(recipe: Recipe, seed: int) -> list[Skill]:
    """Return the skills that a recipe puts together; those whose actions are not the recipe's are refused."""
    skills = [load_skill(source) for source in _sources(recipe, seed)]
    for skill in skills:
        _check_actions(recipe, skill)
    return skills


def _own_states(models: Sequence[ObjectModel], skill: Skill) -> NDArray[np.int64]:
    """Return (composite states,) the state that a skill is in, which may look at the first axes of an object only.

    Raises:
        InputError: it looks at more of them, or at others.
    """
    kinds = [model.kind for model in models]
    places = [kinds.index(model.kind) for model in skill.objects]
    found = component([model.states for model in models], places)
    whole = [models[place] for place in places]
    for n, own in enumerate(skill.objects):
        if not _is_first_of(own, whole[n]):
            raise InputError(
                f"the skill {skill.name!r} looks at {own.order} axes of the {own.kind}, which are not the first of the"
                f" {whole[n].order} that there are at the start; set curriculum.dimension and axis_order to its axes"
            )
    sizes = [(model.order, model.lost_states) for model in whole]
    for n, own in enumerate(skill.objects):
        while sizes[n][0] > own.order:
            sizes[n] = (sizes[n][0] - 1, own.lost_states)
            found = origins(sizes, n)[found]
    return found


def _behaviour(recipe: Recipe, skill: Skill, own_states: NDArray[np.int64], seed: int) -> Behaviour:
    """Return a skill as a behaviour of the composite space, its way to the goal measured in the recipe's world."""
    settings = recipe.coordination
    assert settings is not UNSET
    own = check(Recipe, dict(skill.about.get("recipe", {})), f"the recipe in the skill {skill.name!r}")
    own = msgspec.structs.replace(own, world=recipe.world)
    has_goal, steps = own.task != "avoid", None
    if has_goal and settings.worth == "steps":
        steps = expected_steps(own, skill, trials=settings.steps_trials, seed=seed)
    values = skill.values.astype(np.float64)
    worth = state_values(values, steps=steps, gamma=recipe.learning.gamma, reward=own.goal_reward)
    return Behaviour(skill.name, values, worth, own_states, not has_goal and settings.avoid_where == "threat")


def _check_actions(recipe: Recipe, skill: Skill) -> None:
    """Refuse a skill whose actions are not the recipe's: its values would be of other actions."""
    make_bank([skill], drive=recipe.world.robot.drive, actions=len(action_set(recipe.world.robot).codes))
    limits = recipe.action
    if (skill.min_steps, skill.max_steps) != (limits.min_steps, limits.max_steps):
        raise InputError(
            f"actions of the skill {skill.name!r} last {skill.min_steps} to {skill.max_steps} steps, those of the"
            f" recipe {recipe.name!r} {limits.min_steps} to {limits.max_steps}; set action.min_steps and max_steps"
        )


def shared_models(recipe: Recipe, seed: int) -> tuple[ObjectModel, ...]:
    """Return one model for each object of the recipe, with all its axes: all skills that look at it must share them.

    A skill may look at the first axes only. The model is that of ``model_of``, or of the skill with the most axes.

    Args:
        recipe: with ``coordination``.
        seed: of the learning.

    Raises:
        InputError: skills look at an object through different models, or at other objects than the recipe.
    """
    found: dict[str, tuple[str, ObjectModel]] = {}
    skills = _skills(recipe, seed)
    for skill in skills:
        for model in skill.objects:
            name, first = found.setdefault(model.kind, (skill.name, model))
            if _is_first_of(first, model):
                found[model.kind] = (skill.name, model)
            elif not _is_first_of(model, first):
                raise InputError(
                    f"the skills {name!r} and {skill.name!r} look at the {model.kind} through different models, so"
                    f" their states differ; learn one of them with model_of = {name!r} for its {model.kind}"
                )
    listed = [model.kind for model in recipe.objects]
    if set(listed) != set(found):
        raise InputError(
            f"the recipe {recipe.name!r} lists the objects {', '.join(listed)}; its skills look at {', '.join(found)}"
        )
    return tuple(_whole(one, *found[one.kind], seed) for one in recipe.objects)


def _whole(settings: ModelSettings, name: str, shared: ObjectModel, seed: int) -> ObjectModel:
    """Return the model of an object with all its axes, where the recipe says which it is."""
    if settings.model_of is UNSET:
        return shared
    whole = model_of(settings.model_of, settings.kind, seed)
    if not _is_first_of(shared, whole):
        raise InputError(
            f"the axes of the {settings.kind} of the skill {name!r} are not the first of those of the skill"
            f" {of_seed(settings.model_of, seed)!r} (model_of), so their states differ"
        )
    return whole


def _is_first_of(one: ObjectModel, whole: ObjectModel) -> bool:
    """Tell whether a model is another with its first axes only, or all of them."""
    cut = dataclasses.replace(whole, memory_matrix=whole.memory_matrix[: one.order])
    pairs = zip(dataclasses.astuple(one), dataclasses.astuple(cut), strict=True)
    return all(np.array_equal(a, b) for a, b in pairs)
