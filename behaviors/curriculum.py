"""Learning from easy to hard (chapter 4): which world comes next, and which axes a state has by now.

What moves them is ``coevo.complexity``. Here is what that means for a learner: recipes of the levels, models with the
axes that are there, the table grown by one, and a record of it all.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from behaviors.practice import Standing
from behaviors.recipe import Recipe
from behaviors.settings import CurriculumSettings
from behaviors.tabular.growing import grown_table, grown_values, origins
from coevo.complexity import Controller, Counted, Event, check_rates, check_wholes, every_level, values_at
from coevo.errors import InputError
from coevo.seeds import SkillStream, generator
from coevo.skill import ObjectModel
from coevo.study import table_bytes

__all__ = ["CHECKS", "GREEDY", "RATES", "TABLES", "Curriculum", "check_curriculum", "growth_order"]

Models = tuple[ObjectModel, ...]
RATES = ("success", "collisions", "failures", "timeouts")  # shares of trials
GREEDY = "greedy_"  # before one of these: of as many trials of the greedy policy as a check has, on the same level
CHECKS = "checks.csv"  # beside the skill: what its checks found, in the world of the recipe itself
TABLES = ("levels.csv", "observations.csv")  # what moved, and each observation
_TABLE = "curriculum"
# What a level may change: what happens and how it is learned, not who learns.
_ALLOWED = (
    *("world", "mover", "action", "learning", "time_limit_steps", "starts"),
    *("goal_reward", "collision_reward", "conceded_reward"),
)
_KEPT = ("world.robot.drive", "learning.storage")
_COLUMNS = ("trial", "level", "dimension", "trials", "steps", *RATES, "games", *(f"{GREEDY}{name}" for name in RATES))


def check_curriculum(recipe: Recipe, trials: int) -> list[Recipe]:
    """Return a recipe with a curriculum as it is on each level; what cannot be learned is refused.

    Args:
        recipe: with a curriculum.
        trials: how many there will be at most.

    Raises:
        InputError: a key is no setting, or none that a level may change; a level is refused by the settings; a
            criterion is about what nobody measures, or can never be met.
    """
    settings = _settings(recipe)
    for key in (key for table in settings.keys for key in table):
        if key.partition(".")[0] not in _ALLOWED or any(f"{kept}.".startswith(f"{key}.") for kept in _KEPT):
            raise InputError(
                f"{_TABLE}.keys: a level may change settings of {', '.join(_ALLOWED)}, but not"
                f" {' or '.join(_KEPT)}; got {key!r}"
            )
    check_rates(settings, [*RATES, *(f"{GREEDY}{name}" for name in RATES)], _TABLE)
    levels = [msgspec.structs.replace(one, curriculum=UNSET) for one in every_level(recipe, settings, table=_TABLE)]
    wholes = {"avoid": ("success", "collisions"), "defend": ("success", "failures")}
    whole = wholes.get(recipe.task, RATES)
    check_wholes(settings, [whole, [f"{GREEDY}{name}" for name in whole]], _TABLE)
    if all(level.mover.kind == "none" for level in levels):
        for name, criterion in settings.raise_when.items():
            if name.removeprefix(GREEDY) == "collisions" and criterion.at_least:
                raise InputError(
                    f"{_TABLE}.raise_when.{name}: at_least {criterion.at_least:g} can never be met without another"
                    " robot; set mover.kind"
                )
    if settings.window * settings.trials > trials:
        raise InputError(
            f"{_TABLE}: the criteria are looked at after window = {settings.window} x {settings.trials} trials, and can"
            f" never be met in trials = {trials}"
        )
    return levels


def _settings(recipe: Recipe) -> CurriculumSettings:
    assert recipe.curriculum is not UNSET
    return recipe.curriculum


def growth_order(recipe: Recipe, models: Models, seed: int) -> list[tuple[int, int]]:
    """Return (object, axis) of all axes that are added, in their order: the first axes of all objects, the second ...

    Args:
        recipe: with a curriculum.
        models: with all their axes.
        seed: of the learning.

    Raises:
        InputError: there are not so many axes.
    """
    settings = _settings(recipe)
    rows = []
    for number, model in enumerate(models):
        if model.kind in settings.grow:
            axes = list(range(model.order))
            if settings.axis_order == "reversed":
                axes.reverse()
            if settings.axis_order == "random":
                axes = generator(seed, SkillStream.AXES, number).permutation(model.order).tolist()
            rows.append([(number, axis) for axis in axes])
    found = [one for many in itertools.zip_longest(*rows) for one in many if one is not None]
    if settings.most_dimensions > len(found):
        raise InputError(
            f"{_TABLE}.most_dimensions: the models of {' and '.join(settings.grow)} have {len(found)} axes, got"
            f" {settings.most_dimensions}"
        )
    return found


class Curriculum:
    """Where the world and the axes of a learning stand.

    Args:
        recipe: with a curriculum.
        levels: of ``check_curriculum``.
        models: of its objects, with all their axes.
        seed: of the learning.
        model_steps: how many steps of random actions the models come from.

    Raises:
        InputError: there are not so many axes as are to be added.
    """

    def __init__(
        self, recipe: Recipe, levels: Sequence[Recipe], models: Models, seed: int, *, model_steps: int = 0
    ) -> None:
        self._model_steps = model_steps
        self._settings, self.levels, self.all_models = _settings(recipe), levels, models
        self._order = growth_order(recipe, models, seed)
        self.controller = Controller(self._settings)
        self._observed: list[list[int]] = []
        self._events: list[dict[str, Any]] = []
        self._tell(self.controller.start, self.controller.start)

    @property
    def recipe(self) -> Recipe:
        """The recipe as it is on the level."""
        return self.levels[self.controller.level]

    @property
    def models(self) -> Models:
        """Models with the axes that are there."""
        return self.models_of(self.controller.dimension)

    @property
    def first_dimension(self) -> int:
        """How many axes there were at the start."""
        return self._settings.dimension

    def models_of(self, dimension: int) -> Models:
        """Return models with so many of the axes that are added."""
        found = list(self.all_models)
        for number in {number for number, _ in self._order}:
            axes = [axis for one, axis in self._order[:dimension] if one == number]
            whole = self.all_models[number]
            found[number] = dataclasses.replace(whole, memory_matrix=whole.memory_matrix[axes])
        return tuple(found)

    @property
    def asks_greedy(self) -> bool:
        """Whether a criterion is about the greedy policy."""
        return any(name.startswith(GREEDY) for name in [*self._settings.raise_when, *self._settings.lower_when])

    @property
    def asks_change(self) -> bool:
        """Whether it matters by how much values have changed (4.4)."""
        return self._settings.converged_below > 0.0

    def observe(self, trial: int, steps: int, counted: Counted, change: float | None) -> Event | None:
        """Take note of an observation on the level, and return what follows from it.

        Args:
            trial: how many trials have been run in all.
            steps: that those of the observation took.
            counted: by each rate how often, and of how many; the greedy ones where they are asked for.
            change: (4.4), relative, where it is asked for.
        """
        controller, (_, trials) = self.controller, counted["success"]
        greedy = [counted.get(f"{GREEDY}{name}", (0, 0)) for name in RATES]
        told = [counted[name][0] for name in RATES]
        row = [trial, controller.level, controller.dimension, trials, steps, *told, greedy[0][1]]
        self._observed.append([*row, *(achieved for achieved, _ in greedy)])
        before = controller.level, controller.dimension
        event = controller.observe(counted, change=change)
        if event is not None:
            self._tell(event, event._replace(level=before[0], dimension=before[1]))
        return event

    def outgrow(self, event: Event, at: Standing) -> None:
        """Let the table of a learning, and the best of it, follow an event."""
        table = at.tables[0]
        if event.kind == "axis_added":
            origin = self.origin(event.dimension)
            at.best = [grown_values(values, table.rows, origin) for values in at.best]
            table = grown_table(table, origin, copy=self._settings.new_values == "copy")
        visits = np.floor(table.visits * self._settings.keep_visits).astype(np.int64)
        at.tables = [table._replace(visits=visits)]

    def origin(self, dimension: int) -> NDArray[np.int64]:
        """Return (states,) the state that each state of so many axes was with one axis less."""
        sizes = [(model.order, model.lost_states) for model in self.models_of(dimension - 1)]
        return origins(sizes, self._order[dimension - 1][0])

    # ------------------------------------------------------------------------------------------------------- told

    def _tell(self, event: Event, led_by: Event) -> None:
        """Write an event down, with what the trials were like that led to it, on the level that they were run on."""
        rows = np.array(self._observed[-self._settings.window :], np.int64).reshape(-1, len(_COLUMNS))
        rows = rows[(rows[:, 1] == led_by.level) & (rows[:, 2] == led_by.dimension)]
        trials = int(rows[:, 3].sum())
        rates = {name: int(rows[:, 5 + k].sum()) / trials if trials else "" for k, name in enumerate(RATES)}
        observed = np.array(self._observed, np.int64).reshape(-1, len(_COLUMNS))
        seconds = sum(int(row[4]) * self.levels[row[1]].world.physics.step_s for row in observed)
        self._events.append(
            {
                "trial": int(observed[-1, 0]) if len(observed) else 0,
                "event": event.kind,
                "level": event.level,
                "dimension": event.dimension,
                "success_rate": rates["success"],
                "collision_rate": rates["collisions"],
                "steps": int(observed[:, 4].sum()),
                "seconds": seconds,
                **{key: json.dumps(value) for key, value in values_at(self._settings, event.level).items()},
            }
        )

    @property
    def words(self) -> str:
        """Where it stands, in words."""
        axes = f", {self.controller.dimension} axes" if self._settings.grow else ""
        return f"level {self.controller.level} of 0 to {self._settings.levels - 1}{axes}"

    @property
    def about(self) -> dict[str, Any]:
        """What a skill file and its card tell of it."""
        return {
            "met": self.controller.ended,
            "trials": self._observed[-1][0] if self._observed else 0,
            "model_steps": self._model_steps,
            "level": self.controller.level,
            "levels": self._settings.levels,
            "dimension": self.controller.dimension,
            "axes": [[self.all_models[number].kind, axis] for number, axis in self._order[: self.controller.dimension]],
            "weak_critical_periods": [
                [event["level"], event["dimension"] - 1, event["trial"]]
                for event in self._events
                if event["event"] == "axis_added"
            ],
        }

    def files(self) -> dict[str, bytes]:
        """Return the tables that stand beside the skill, by name of the file."""
        events = list(self._events)
        if events[-1]["event"] != "end":
            at = Event("end", self.controller.level, self.controller.dimension, {})
            self._tell(at, at)
            events.append(self._events.pop())
        rows = [dict(zip(_COLUMNS, row, strict=True)) for row in self._observed]
        return dict(zip(TABLES, (table_bytes(events), table_bytes(rows, list(_COLUMNS))), strict=True))

    # -------------------------------------------------------------------------------------------- saved, restored

    def pack(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return where it stands, as plain data and arrays."""
        observed = np.array(self._observed, np.int64).reshape(-1, len(_COLUMNS))
        return {"events": self._events, "model_steps": self._model_steps}, {
            **self.controller.arrays(),
            "observed": observed,
        }

    def restore(self, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Stand where ``pack`` was given."""
        self.controller.restore(arrays)
        self._events, self._model_steps = list(header["events"]), int(header["model_steps"])
        self._observed = arrays["observed"].tolist()
