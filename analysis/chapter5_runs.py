"""Runs of chapter 5 as they were learned: what a study of skills with several rewards left in its folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from coevo.errors import InputError
from coevo.soundness import require_as_learned
from coevo.statistics import probability_of_improvement
from coevo.study.folder import finished_runs

__all__ = ["CARD", "WHILE", "Arms", "Rewarded", "more_often", "read_arms", "read_runs", "within_sets"]

Arms = dict[str, list["Rewarded"]]
"""By the name of an arm, in the order of the study, its finished runs."""

# What a run is measured by: on its card, the greedy policy on unseen starts; and while it learned, per trial.
CARD = {
    "success": "success_rate_in_view",
    "success anywhere": "success_rate_anywhere",
    "collisions": "collision_rate_in_view",
    "contact": "mean_kicks_in_view",
}
WHILE = {"goals": "goals", "trials with collisions": "collided", "trials with kicks": "kicked"}


@dataclass(frozen=True)
class Rewarded:
    """A finished run.

    Attributes:
        arm, seed: which.
        row: of the table of the study: what the card says.
        blocks: rows of ``frequencies.csv``.
    """

    arm: str
    seed: int
    row: Mapping[str, str]
    blocks: pd.DataFrame

    def on_card(self, what: str) -> float:
        """Return one of CARD, NaN where the card does not have it."""
        return float(self.row.get(CARD[what]) or "nan")

    def while_learning(self, what: str, share: float = 1.0) -> float:
        """Return one of WHILE, per trial, over the first ``share`` of the trials."""
        first = self.blocks[self.blocks["trial"] <= max(share * self.blocks["trial"].max(), self.blocks["trial"].min())]
        return float(first[WHILE[what]].sum() / first["trials"].sum())

    @cached_property
    def best_block(self) -> float:
        """The most goals per trial in any block."""
        return float((self.blocks["goals"] / self.blocks["trials"]).max())

    def curve(self, what: str) -> pd.DataFrame:
        """Return one of WHILE per trial, over windows of four blocks: columns ``trial``, ``share``."""
        sums = self.blocks[[WHILE[what], "trials"]].rolling(4, min_periods=1).sum()
        return pd.DataFrame({"trial": self.blocks["trial"], "share": sums[WHILE[what]] / sums["trials"]})


def within_sets(first: Mapping[int, float], second: Mapping[int, float]) -> NDArray[np.float64]:
    """Return (2, sets) what two arms have, by their seeds, in the sets that both have."""
    seeds = sorted(first.keys() & second.keys())
    return np.array([[one[seed] for seed in seeds] for one in (first, second)])


def more_often(values: NDArray[np.float64]) -> str:
    """Return in words how probably the first of two arms has more than the second: (2, sets), as ``within_sets``."""
    return "{:.2f} [{:.2f}, {:.2f}]".format(*probability_of_improvement(*values))


def read_arms(folder: Path) -> Arms:
    """Read the finished runs of a study of one learner.

    Raises:
        InputError: there is none, or one of them is not of chapter 5.
    """
    arms: Arms = {}
    for arm, seed, row, blocks in read_runs(folder):
        arms.setdefault(arm, []).append(Rewarded(arm, seed, row, blocks))
    return arms


def read_runs(folder: Path) -> list[tuple[str, int, dict[str, str], pd.DataFrame]]:
    """Return of each finished run of a study its arm, seed, row of the table, and blocks of trials.

    Raises:
        InputError: there is none, or one of them is not of chapter 5.
    """
    found = []
    for path, row in finished_runs(folder):
        require_as_learned(path)
        try:
            blocks = pd.read_csv(path / "frequencies.csv")
        except FileNotFoundError:
            raise InputError(
                f"{path} was not learned as in chapter 5: it has no frequencies.csv, which comes with"
                ' learning.method = "actor-critic" or ends = "goal", and with recipes of the kind "team"'
            ) from None
        except (OSError, ValueError) as error:
            raise InputError(f"{path} is damaged ({error}); remove it, and run 'coevo study' again") from None
        found.append((row.get("arm", row["recipe"]), int(row["seed"]), row, blocks))
    several = {"robot" in blocks for *_, blocks in found}
    if len(several) > 1:
        raise InputError(f"{folder} holds runs of one learner and of several; make a study of each")
    return found
