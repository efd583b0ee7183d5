"""Learn a skill from nothing: gather experience, identify the models, learn the table, measure the result."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from behaviors.axes import simple_axes
from behaviors.lpm import identify
from behaviors.recipe import ModelSettings, Recipe
from behaviors.task import COLLISION, SUCCESS, task_params
from behaviors.trials import Learner, Scene, gather, run_trials
from coevo.errors import InputError
from coevo.skill import ObjectModel, Skill, SkillBank, load_skill, make_bank
from coevo.skill.estimate import make_memory
from coevo.skill.model import OBJECT_KINDS, state_count
from coevo.soccer.camera import ROBOTS, camera_params, make_retina
from coevo.soccer.drive import action_set
from coevo.soccer.physics import physics_params
from coevo.soccer.rng import game_seed
from coevo.soccer.world import World

__all__ = [
    "Measured",
    "Report",
    "best_of_learning",
    "evaluate",
    "learn",
    "learner",
    "make_scene",
    "no_start",
    "wilson_interval",
]

# What the random streams of a recipe's seed are for.
_EXPERIENCE, _LEARNING, _EVALUATION, _CHECK = 0, 1, 2, 3
_BLOCK = 250  # trials between two reports of progress
_CAMERA_OBJECTS = {"ball": 0, "own_goal": 1, "opponent_goal": 2, "mate": ROBOTS, "robot": ROBOTS + 1}

Report = Callable[[int, int, float], None]


@dataclass(frozen=True)
class Measured:
    """Outcome of many trials of one policy.

    outcomes, steps: (trials,) int64; see behaviors.task for the outcomes.
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


def make_scene(recipe: Recipe, bank: SkillBank) -> Scene:
    """Return the scene of a recipe's trials; the first skill of the bank is the learner's."""
    task = task_params(recipe)
    actions = action_set(recipe.world.robot)
    mates = [1, 0] if task.robots == 2 and recipe.task == "pass" else [-1] * task.robots
    return Scene(
        handles=_world(recipe, task.robots).handles,
        physics=physics_params(recipe.world),
        camera=camera_params(recipe.world),
        task=task,
        bank=bank,
        memory=make_memory(bank, mates),
        retina=make_retina(recipe.world),
        codes=actions.codes,
        commands=actions.commands,
    )


_worlds: dict[tuple[bytes, int], World] = {}


def _world(recipe: Recipe, robots: int) -> World:
    """Return a world of the recipe; kept, since a scene holds only addresses of it.

    None is made to be thrown away: pymunk has been seen to abort while it freed such a one.
    """
    key = (msgspec.json.encode(recipe.world), robots)
    if key not in _worlds:
        _worlds[key] = World(recipe.world, robots)
    return _worlds[key]


def _blank(recipe: Recipe, models: tuple[ObjectModel, ...]) -> Skill:
    states = int(np.prod([model.states for model in models]))
    actions = len(action_set(recipe.world.robot).codes)
    values = np.zeros((states, actions), np.float32)
    return Skill(
        recipe.name,
        recipe.world.robot.drive,
        models,
        values,
        recipe.action.min_steps,
        recipe.action.max_steps,
    )


def _provisional(recipe: Recipe) -> Skill:
    """Return a skill that looks at the right objects but knows nothing, with which experience is gathered."""
    models = tuple(
        ObjectModel(m.kind, 1, np.zeros((1, 2 + OBJECT_KINDS[m.kind])), np.zeros(2 + OBJECT_KINDS[m.kind]), m.cell)
        for m in recipe.objects
    )
    return _blank(recipe, models)


def _bank(skill: Skill) -> SkillBank:
    return make_bank([skill], drive=skill.drive, actions=skill.actions)


def experience(recipe: Recipe, seed: int) -> dict[str, list[tuple[NDArray[np.float64], NDArray[np.float64]]]]:
    """Act at random and return, for each object, the stretches in which it was in view.

    A stretch is (actions (T, 2), observations (T, q)) of one trial, each action paired with the image it led to.
    """
    scene = make_scene(recipe, _bank(_provisional(recipe)))
    objects = scene.memory.areas.shape[1]
    settings = recipe.experience
    stretches: dict[str, list[tuple[NDArray[np.float64], NDArray[np.float64]]]] = {m.kind: [] for m in recipe.objects}
    rows, part = 20_000, 0
    while min(sum(len(a) for a, _ in found) for found in stretches.values()) < settings.windows:
        trial, inputs = np.zeros(rows, np.int64), np.zeros((rows, 2))
        features, areas = np.zeros((rows, objects, 11)), np.zeros((rows, objects))
        random = game_seed(seed, _EXPERIENCE, part)
        filled = gather(
            scene,
            random,
            settings.hold_min_steps,
            settings.hold_max_steps,
            settings.trial_steps,
            trial,
            inputs,
            features,
            areas,
        )
        if filled < rows or part > 100:
            raise InputError(
                f"the recipe {recipe.name!r}: its objects hardly ever come into view, so no model can be identified"
            )
        for kind, found in stretches.items():
            thing = _object_slot(kind, scene)
            visible = areas[:, thing] > 0.0
            breaks = np.flatnonzero((np.diff(visible.astype(np.int8)) != 0) | (np.diff(trial) != 0)) + 1
            for piece in np.split(np.arange(rows), breaks):
                if visible[piece[0]]:
                    found.append((inputs[piece], features[piece, thing, : OBJECT_KINDS[kind]]))
        part += 1
    return stretches


def _object_slot(kind: str, scene: Scene) -> int:
    return scene.memory.areas.shape[1] - 1 if kind == "robot" else _CAMERA_OBJECTS[kind]


def _model(
    settings: ModelSettings, stretches: list[tuple[NDArray[np.float64], NDArray[np.float64]]], recipe: Recipe
) -> ObjectModel:
    enough: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    total = 0
    for stretch in stretches:
        enough.append(stretch)
        total += len(stretch[0])
        if total >= recipe.experience.windows:
            break
    found = identify(
        enough,
        history_length=settings.history_length,
        order=settings.order,
        future_inputs=recipe.experience.future_inputs,
    )
    memory_matrix = found.memory_matrix
    if settings.axes == "varimax":
        memory_matrix = simple_axes(found, enough).T @ memory_matrix
    return ObjectModel(settings.kind, found.history_length, memory_matrix, found.past_mean, settings.cell)


def _models(recipe: Recipe, seed: int) -> tuple[ObjectModel, ...]:
    """Return the models of the recipe's objects: those of other skills, or identified from random actions."""
    given = {m.kind: _model_of(m.model_of, m.kind) for m in recipe.objects if m.model_of is not UNSET}
    stretches = experience(recipe, seed) if len(given) < len(recipe.objects) else {}
    return tuple(given.get(m.kind) or _model(m, stretches[m.kind], recipe) for m in recipe.objects)


def _model_of(source: str, kind: str) -> ObjectModel:
    skill = load_skill(source)
    for model in skill.objects:
        if model.kind == kind:
            return model
    looks = ", ".join(model.kind for model in skill.objects)
    raise InputError(f"model_of: the skill {source!r} looks at {looks}, so it has no model of {kind}")


def learn(recipe: Recipe, *, seed: int | None = None, trials: int | None = None, report: Report | None = None) -> Skill:
    """Learn the recipe's skill from nothing.

    The table kept is the one whose greedy policy did best in the checks (see ``LearningSettings``).

    Args:
        recipe: what to learn and how.
        seed, trials: replace those of the recipe.
        report: called with (trials done, trials in all, share of the last block that succeeded).

    Raises:
        InputError: the recipe leaves nothing to learn from.
    """
    if recipe.coordination is not UNSET:
        raise InputError(f"the recipe {recipe.name!r} coordinates skills: behaviors.relearning.learn_recipe learns it")
    seed = recipe.seed if seed is None else seed
    trials = recipe.trials if trials is None else trials
    skill = _blank(recipe, _models(recipe, seed))
    scene, numbers = make_scene(recipe, _bank(skill)), learner(recipe)
    values, visits = np.zeros(skill.values.shape), np.zeros(skill.values.shape, np.int64)

    def block(first: int, *results: NDArray[Any]) -> bool:
        seeds, outcomes, steps = results
        return run_trials(scene, numbers, True, False, first, trials, seeds, values, visits, outcomes, steps)

    return best_of_learning(
        recipe, skill, block, lambda: values, visits, seed=seed, trials=trials, report=report, about={}
    )


def learner(recipe: Recipe) -> Learner:
    """Return the recipe's numbers of Q learning, for compiled code."""
    return Learner(*(getattr(recipe.learning, name) for name in Learner._fields))


def best_of_learning(
    recipe: Recipe,
    skill: Skill,
    block: Callable[..., bool],
    table: Callable[[], NDArray[np.float64]],
    visits: NDArray[np.int64],
    *,
    seed: int,
    trials: int,
    report: Report | None,
    about: dict[str, Any],
) -> Skill:
    """Run the trials of a learning in blocks and return the skill with the table that did best in the checks.

    Args:
        recipe: what is learned and how.
        skill: its models, any table.
        block: learns from trials: called with the number of the first one, their seeds, and arrays for their outcomes
            and steps; returns False if no start was found.
        table: returns the action values (states, actions) as they are now.
        visits: (states, actions) int64, updated by ``block``.
        seed, trials, report: see ``learn``.
        about: what to say of the skill besides the usual.

    Raises:
        InputError: no start was found.
    """
    settings = recipe.learning
    best: NDArray[np.float64] | None = None
    best_score, kept_after = -np.inf, trials
    for first in range(0, trials, _BLOCK):
        size = min(_BLOCK, trials - first)
        done = first + size
        seeds = np.array([game_seed(seed, _LEARNING, first + n) for n in range(size)], np.uint64)
        outcomes, steps = np.zeros(size, np.int64), np.zeros(size, np.int64)
        if not block(first, seeds, outcomes, steps):
            raise no_start(recipe)
        if report is not None:
            report(done, trials, float(_success(recipe, outcomes).mean()))
        due = settings.check_every and (done == trials or done // settings.check_every > first // settings.check_every)
        if due and done >= settings.check_from * trials:
            score = _check(recipe, skill, table(), seed)
            if score >= best_score:
                best, best_score, kept_after = table().copy(), score, done
    values = (table() if best is None else best).astype(np.float32)
    said = {
        "recipe": msgspec.to_builtins(recipe),
        "recipe_digest": hashlib.sha256(msgspec.json.encode(recipe)).hexdigest(),
        "seed": seed,
        "trials": trials,
        "kept_after_trials": kept_after,
        "states_visited": int((visits.sum(axis=1) > 0).sum()),
        **about,
    }
    return dataclasses.replace(skill, values=values, about=said)


def _success(recipe: Recipe, outcomes: NDArray[np.int64]) -> NDArray[np.bool_]:
    success: NDArray[np.bool_] = outcomes != COLLISION if recipe.task == "avoid" else outcomes == SUCCESS
    return success


def no_start(recipe: Recipe) -> InputError:
    """Return the error to raise when trials find no start."""
    return InputError(f"the recipe {recipe.name!r}: no start was found where the learner sees what the task is about")


def evaluate(
    recipe: Recipe,
    skill: Skill | None,
    *,
    games: int,
    seed: int,
    starts: str | None = None,
    mover: Any = None,
) -> Measured:
    """Run a skill greedily from unseen starts.

    Args:
        recipe: the task.
        skill: what to measure; None for random actions, each held as long as the recipe allows.
        games: how many trials.
        seed: the starts are drawn from it; they are never those of learning.
        starts: "in-view" or "anywhere", instead of the recipe's.
        mover: MoverSettings instead of the recipe's.
    """
    changed = msgspec.structs.replace(recipe, starts=starts or recipe.starts, mover=mover or recipe.mover)
    if skill is not None:
        kinds = {model.kind for model in skill.objects}
        if kinds != {model.kind for model in recipe.objects}:
            wanted = ", ".join(model.kind for model in recipe.objects)
            looks = ", ".join(sorted(kinds))
            raise InputError(f"the skill {skill.name!r} looks at {looks}; the task {recipe.task} needs {wanted}")
    return _run(changed, skill, games, seed, _EVALUATION)


def _run(recipe: Recipe, skill: Skill | None, games: int, seed: int, stream: int) -> Measured:
    """Run ``games`` trials of the recipe without learning; without a skill, at random."""
    used = skill if skill is not None else _provisional(recipe)
    actions = len(action_set(recipe.world.robot).codes)
    scene = make_scene(recipe, make_bank([used], drive=recipe.world.robot.drive, actions=actions))
    seeds = np.array([game_seed(seed, stream, n) for n in range(games)], np.uint64)
    outcomes, steps = np.zeros(games, np.int64), np.zeros(games, np.int64)
    values, visits = np.zeros((1, actions)), np.zeros((1, 1), np.int64)
    if not run_trials(scene, learner(recipe), False, skill is None, 0, games, seeds, values, visits, outcomes, steps):
        raise no_start(recipe)
    return Measured(outcomes, steps, _success(recipe, outcomes))


def _check(recipe: Recipe, skill: Skill, values: NDArray[np.float64], seed: int) -> float:
    """Return the mean reward of the greedy policy of ``values``, half from starts in view, half from anywhere.

    These starts are the same for all checks of one learning, and are neither those of learning nor of evaluation.
    """
    now = dataclasses.replace(skill, values=values.astype(np.float32))
    reward = 0.0
    for starts in ("in-view", "anywhere"):
        measured = _run(msgspec.structs.replace(recipe, starts=starts), now, recipe.learning.check_games, seed, _CHECK)
        success = float((measured.outcomes == SUCCESS).mean())
        reward += 0.5 * (success * recipe.goal_reward + measured.collision_rate * recipe.collision_reward)
    return reward


assert state_count(1) == 5  # three cells and two lost states
