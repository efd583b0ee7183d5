"""Runs of chapter 4 as they were learned: what a study of recipes with a curriculum left in its folder."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from coevo.config import read_toml
from coevo.errors import InputError
from coevo.soundness import require_as_learned
from coevo.study.folder import finished_runs

__all__ = ["Arms", "Learned", "Stay", "read_arms"]

Arms = dict[str, list["Learned"]]
"""By the name of an arm, in the order of the study, its finished runs."""


class Stay(NamedTuple):
    """Trials on one level with the same axes.

    level, dimension: where.
    began, ended: how many trials had been run before it, and at its end.
    first, best, last: rate of success over a window: the first whole one, the best, the last; NaN if there was none.
    collisions: their rate over the last window.
    met: after how many trials of all the criteria were met, NaN if they were not.
    """

    level: int
    dimension: int
    began: int
    ended: int
    first: float
    best: float
    last: float
    collisions: float
    met: float


@dataclass(frozen=True)
class Learned:
    """A finished run.

    Attributes:
        arm, seed: which.
        row: of the table of the study: what the card says.
        limit: the trials that it had at most.
        settings: of its curriculum.
        blocks: rows of ``observations.csv``.
        events: rows of ``levels.csv``.
        checks: rows of ``checks.csv``, none where nothing was checked.
    """

    arm: str
    seed: int
    row: Mapping[str, str]
    limit: int
    settings: Mapping[str, Any]
    blocks: pd.DataFrame
    events: Sequence[Mapping[str, str]]
    checks: pd.DataFrame

    @property
    def top(self) -> int:
        """The highest level."""
        return sum(len(next(iter(table.values()))) - 1 for table in self.settings["keys"])

    @property
    def lowest(self) -> int:
        """The k of the lowest level: the text counts them from 0 where nothing moves there, and else from 1."""
        return int(next(iter(self.settings["keys"][0].values()))[0] != 0)

    @property
    def minds_collisions(self) -> bool:
        """Whether a criterion is about collisions."""
        return any(name.endswith("collisions") for name in self.settings["raise_when"])

    @property
    def floor(self) -> int:
        """How many trials whoever meets the criteria in every window needs: a window a level."""
        levels = self.top + 1 - int(self.settings["first"])
        return levels * int(self.settings["window"]) * int(self.settings["trials"])

    @cached_property
    def stays(self) -> list[Stay]:
        """Its stays, in their order."""
        place = self.blocks[["level", "dimension"]]
        number = (place != place.shift()).any(axis=1).cumsum()
        return [self._stay(part) for _, part in self.blocks.groupby(number)]

    def _stay(self, part: pd.DataFrame) -> Stay:
        sums = part.drop(columns=["level", "dimension"]).rolling(int(self.settings["window"])).sum().dropna()
        rates = sums["success"] / sums["trials"]
        first, best, last = (rates.iloc[0], rates.max(), rates.iloc[-1]) if len(rates) else (np.nan,) * 3
        collisions = (sums["collisions"] / sums["trials"]).iloc[-1] if len(rates) else np.nan
        is_met = pd.Series(True, index=sums.index)
        for name, criterion in self.settings["raise_when"].items():
            rate = sums[name] / sums["games" if name.startswith("greedy_") else "trials"]
            is_met &= rate.between(criterion.get("at_least", 0.0), criterion.get("at_most", 1.0))
        met = part["trial"][is_met[is_met].index].min()
        level, dimension, trial, trials = (int(part[key].iloc[0]) for key in ("level", "dimension", "trial", "trials"))
        ended = int(part["trial"].iloc[-1])
        return Stay(level, dimension, trial - trials, ended, first, best, last, float(collisions), float(met))

    @property
    def met(self) -> float:
        """After how many trials the criteria were met on the highest level, NaN if they were not."""
        return min((stay.met for stay in self.stays if stay.level == self.top and stay.met > 0), default=np.nan)

    def needed(self, what: str = "trials") -> tuple[float, float]:
        """Return the least and the most that it needed: the same, if it met the criteria on the highest level.

        Who did not would have needed more than it had, or would never have done it.

        Args:
            what: ``trials``, ``net`` (trials less the floor), ``steps``, ``samples`` (steps, with those that the
                models come from), or ``hours`` of the robot's own time.
        """
        if what in ("trials", "net"):
            floor = self.floor if what == "net" else 0
            return (self.met - floor,) * 2 if self.met > 0 else (self.limit - floor, np.inf)
        until = self.blocks["trial"] <= (self.met if self.met > 0 else np.inf)
        steps = self.blocks["steps"][until]
        if what == "hours":
            steps = steps * self.blocks["level"][until].map(self._step_hours)
        found = float(steps.sum()) + (float(self.row.get("model_steps") or 0) if what == "samples" else 0.0)
        return (found, found) if self.met > 0 else (found, np.inf)

    @cached_property
    def _step_hours(self) -> dict[int, float]:
        """The length of a step on each level that it was on."""
        found = {}
        before = (0, 0, 0.0)
        for event in self.events:
            level, steps, seconds = int(event["level"]), int(event["steps"]), float(event["seconds"])
            if steps > before[1]:
                found[before[0]] = (seconds - before[2]) / (steps - before[1]) / 3600.0
            before = (level, steps, seconds)
        return found


def read_arms(folder: Path) -> Arms:
    """Read the finished runs of a study.

    Raises:
        InputError: there is none, or one of them is not of a recipe with a curriculum.
    """
    arms: Arms = {}
    runs = finished_runs(folder)
    several = len({row["recipe"] for _, row in runs}) > 1
    for path, row in runs:
        arm = row.get("arm", row["recipe"])
        name = f"{row['recipe']} {arm}" if several and "arm" in row else arm
        arms.setdefault(name, []).append(_read_run(path, name, row))
    return arms


def _read_run(path: Path, arm: str, row: Mapping[str, str]) -> Learned:
    require_as_learned(path)
    recipe = read_toml(path / "recipe.toml")
    if "curriculum" not in recipe:
        raise InputError(f"{path} was not learned from easy to hard: its recipe has no [curriculum]")
    try:
        blocks = pd.read_csv(path / "observations.csv")
        with (path / "levels.csv").open(encoding="utf-8", newline="") as file:
            events = list(csv.DictReader(file))
        checks = pd.read_csv(path / "checks.csv") if (path / "checks.csv").exists() else pd.DataFrame()
    except (OSError, ValueError) as error:
        raise InputError(f"{path} is damaged ({error}); remove it, and run 'coevo study' again") from None
    return Learned(arm, int(row["seed"]), row, int(recipe["trials"]), recipe["curriculum"], blocks, events, checks)
