"""Learn a skill from nothing: gather experience, identify the models, learn the table, measure the result."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from behaviors.decisions import make_decisions, most_decisions
from behaviors.experience import Stretch, blind_models, in_view, make_model
from behaviors.qlearning import make_learner
from behaviors.recipe import Recipe, plain_recipe, recipe_digest
from behaviors.table import Table, all_states, make_table, with_room
from behaviors.task import COLLISION, SUCCESS, task_params
from behaviors.trials import Scene, gather, run_trials
from coevo.errors import InputError
from coevo.skill import ObjectModel, Skill, SkillBank, make_bank
from coevo.skill.estimate import make_memory
from coevo.skill.model import MOST_STATES, OBJECT_KINDS
from coevo.soccer.camera import ROBOTS, camera_params, make_retina
from coevo.soccer.drive import action_set
from coevo.soccer.physics import physics_params
from coevo.soccer.rng import game_seed
from coevo.soccer.world import World

__all__ = ["Measured", "evaluate", "learn", "wilson_interval"]

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


def _scene(recipe: Recipe, bank: SkillBank) -> Scene:
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
    """Return a world of the recipe; kept, since a scene holds only addresses of it."""
    key = (msgspec.json.encode(recipe.world), robots)
    return _worlds.setdefault(key, World(recipe.world, robots))


def _blank(recipe: Recipe, models: tuple[ObjectModel, ...]) -> Skill:
    states = math.prod(model.states for model in models)
    if states > MOST_STATES:
        sizes = " x ".join(str(model.states) for model in models)
        raise InputError(
            f"the recipe {recipe.name!r}: its objects have {sizes} = {states} states together, and {MOST_STATES} is the"
            " most a skill may have; give some of them a smaller order"
        )
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
    return _blank(recipe, blind_models(recipe.objects))


def _bank(skill: Skill) -> SkillBank:
    return make_bank([skill], drive=skill.drive, actions=skill.actions)


def experience(recipe: Recipe, seed: int) -> dict[str, list[Stretch]]:
    """Act at random and return, for each object, the stretches in which it was in view.

    A stretch is (actions (T, 2), observations (T, q)) of one trial, each action paired with the image it led to.
    """
    scene = _scene(recipe, _bank(_provisional(recipe)))
    objects = scene.memory.areas.shape[1]
    settings = recipe.experience
    stretches: dict[str, list[Stretch]] = {m.kind: [] for m in recipe.objects}
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
            found.extend(in_view(trial, inputs, features[:, thing, : OBJECT_KINDS[kind]], areas[:, thing]))
        part += 1
    return stretches


def _object_slot(kind: str, scene: Scene) -> int:
    return scene.memory.areas.shape[1] - 1 if kind == "robot" else _CAMERA_OBJECTS[kind]


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
    seed = recipe.seed if seed is None else seed
    trials = recipe.trials if trials is None else trials
    stretches = experience(recipe, seed)
    width = recipe.world.camera.width_px
    models = tuple(make_model(m, stretches[m.kind], recipe.experience, image_width=width)[0] for m in recipe.objects)
    skill = _blank(recipe, models)
    settings = recipe.learning
    learner = make_learner(settings)
    scene, decisions = _scene(recipe, _bank(skill)), make_decisions(recipe.time_limit_steps)
    states, actions = skill.values.shape
    table = make_table(states, actions, sparse=settings.storage == "sparse")
    best, best_score, kept_after = None, -np.inf, trials
    for first in range(0, trials, _BLOCK):
        block = min(_BLOCK, trials - first)
        done = first + block
        table = with_room(table, block * most_decisions(recipe.time_limit_steps, recipe.action.min_steps))
        seeds = np.array([game_seed(seed, _LEARNING, first + n) for n in range(block)], np.uint64)
        outcomes, steps = np.zeros(block, np.int64), np.zeros(block, np.int64)
        if not run_trials(scene, learner, True, False, first, trials, seeds, table, decisions, outcomes, steps):
            raise _no_start(recipe)
        if report is not None:
            report(done, trials, float(_success(recipe, outcomes).mean()))
        due = settings.check_every and (done == trials or done // settings.check_every > first // settings.check_every)
        if due and done >= settings.check_from * trials:
            score = _check(recipe, skill, table, seed)
            if score >= best_score:
                best, best_score, kept_after = table.values[: table.used[0]].copy(), score, done
    about = {
        "recipe": plain_recipe(recipe),
        "recipe_digest": recipe_digest(recipe),
        "seed": seed,
        "trials": trials,
        "kept_after_trials": kept_after,
        "states_visited": int((table.visits.sum(axis=1) > 0).sum()),
    }
    values = all_states(table.values if best is None else best, table.rows)
    return dataclasses.replace(skill, values=values, about=about, sparse=settings.storage == "sparse")


def _success(recipe: Recipe, outcomes: NDArray[np.int64]) -> NDArray[np.bool_]:
    success: NDArray[np.bool_] = outcomes != COLLISION if recipe.task == "avoid" else outcomes == SUCCESS
    return success


def _no_start(recipe: Recipe) -> InputError:
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
    scene = _scene(recipe, make_bank([used], drive=recipe.world.robot.drive, actions=actions))
    seeds = np.array([game_seed(seed, stream, n) for n in range(games)], np.uint64)
    outcomes, steps = np.zeros(games, np.int64), np.zeros(games, np.int64)
    learner, unused = make_learner(recipe.learning), make_table(1, actions)
    decisions = make_decisions(recipe.time_limit_steps)
    if not run_trials(scene, learner, False, skill is None, 0, games, seeds, unused, decisions, outcomes, steps):
        raise _no_start(recipe)
    return Measured(outcomes, steps, _success(recipe, outcomes))


def _check(recipe: Recipe, skill: Skill, table: Table, seed: int) -> float:
    """Return the mean reward of the greedy policy of a table, half from starts in view, half from anywhere.

    These starts are the same for all checks of one learning, and are neither those of learning nor of evaluation.
    """
    now = dataclasses.replace(skill, values=all_states(table.values, table.rows))
    reward = 0.0
    for starts in ("in-view", "anywhere"):
        measured = _run(msgspec.structs.replace(recipe, starts=starts), now, recipe.learning.check_games, seed, _CHECK)
        success = float((measured.outcomes == SUCCESS).mean())
        reward += 0.5 * (success * recipe.goal_reward + measured.collision_rate * recipe.collision_reward)
    return reward
