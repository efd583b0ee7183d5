"""Settings of environmental complexity: levels of any setting, and what they wait for (chapter 4, section 6.5)."""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from coevo.config.reader import NonNegative, Settings, Share

__all__ = ["ComplexitySettings", "CriterionSettings", "LevelsSettings", "Stall"]

Stall = Literal["grow", "lower", "raise", "stay", "end"]
_Value = bool | int | float | str | list[Any] | dict[str, Any]
_Together = Annotated[
    dict[str, Annotated[tuple[_Value, ...], Meta(min_length=1, max_length=10_000)]], Meta(min_length=1)
]


class CriterionSettings(Settings, frozen=True, kw_only=True):
    """What a measured rate must be; a rate is a share, such as that of trials with success (4.5)."""

    at_least: Share | None = None
    at_most: Share | None = None

    def __post_init__(self) -> None:
        if self.at_least is None and self.at_most is None:
            raise ValueError("expected at_least or at_most, or both")
        if self.at_least is not None and self.at_most is not None and self.at_least > self.at_most:
            raise ValueError(f"at_least {self.at_least:g} and at_most {self.at_most:g} can never be met together")


class ComplexitySettings(Settings, frozen=True, kw_only=True):
    """How complexity is controlled: the algorithm of Fig. 4.3, for any settings and any measured rates.

    ``keys`` holds tables of dotted keys, each with its values, lowest level first. Keys of one table move together;
    several tables move one after the other.
    """

    keys: Annotated[tuple[_Together, ...], Meta(min_length=1, max_length=100)]
    first: Annotated[int, Meta(ge=0)] = 0  # the level to start on
    # All of these rates are required, over the last `window` observations on the level, to go one level up ...
    raise_when: Annotated[dict[str, CriterionSettings], Meta(min_length=1)]
    lower_when: dict[str, CriterionSettings] = msgspec.field(default_factory=dict)  # ... and all of these to go down
    window: Annotated[int, Meta(ge=1, le=1_000_000)] = 1
    # It stalls after so many windows, each an observation later than the one before, none of which came nearer to the
    # criteria than the best before it by more than `improvement` (0: it never does); or when the values of actions have
    # converged: (4.4) below `converged_below`.
    patience: Annotated[int, Meta(ge=0, le=1_000_000)] = 0
    improvement: Share = 0.0
    converged_below: NonNegative = 0.0
    # What to do then: the first of these that is possible. To grow is to ask for an axis, a weak critical period.
    on_stall: Annotated[tuple[Stall, ...], Meta(min_length=1)] = ("grow", "stay")
    dimension: Annotated[int, Meta(ge=0, le=1000)] = 0  # axes at the start
    most_dimensions: Annotated[int, Meta(ge=0, le=1000)] = 0  # and how far they may grow
    at_the_top: Literal["end", "stay"] = "end"  # when the criteria are met on the highest level

    @property
    def levels(self) -> int:
        """How many levels there are: keys of a further table begin where those of the table before have ended."""
        return 1 + sum(len(next(iter(table.values()))) - 1 for table in self.keys)

    def __post_init__(self) -> None:
        _check_tables(self.keys)
        if self.first >= self.levels:
            raise ValueError(f"first: expected a level from 0 to {self.levels - 1}, got {self.first}")
        if self.most_dimensions < self.dimension:
            raise ValueError(f"most_dimensions must be at least dimension {self.dimension}, got {self.most_dimensions}")


class LevelsSettings(ComplexitySettings, frozen=True, kw_only=True):
    """An environment that co-evolves (6.5): an observation is a generation, rates are shares of its games.

    With ``keep``, a level is higher if it is harder for the team ``against``: as soon as that team wins more than
    ``most`` of the decided games the level goes up, and it goes down as soon as another team does. While both sides win
    enough, it goes up where ``raise_when`` is met, which is at once where that is left out.
    """

    raise_when: dict[str, CriterionSettings] = msgspec.field(default_factory=dict)
    keep: Literal["", "both sides winning"] = ""
    against: Annotated[int, Meta(ge=0)] = 0
    most: Annotated[float, Meta(gt=0.5, lt=1.0)] = 0.7
    window: Annotated[int, Meta(ge=1, le=100_000)] = 3  # [C] generations
    on_stall: Annotated[tuple[Stall, ...], Meta(min_length=1)] = ("stay",)
    at_the_top: Literal["stay"] = "stay"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.keep and not self.raise_when:
            raise ValueError('expected keep = "both sides winning", or raise_when with the rates to reach')
        wrong = {"grow", "end"}.intersection(self.on_stall)
        if wrong:
            raise ValueError(f"on_stall: evolution has no axes and ends by itself; got {min(wrong)!r}")
        if self.most_dimensions or self.converged_below:
            raise ValueError("dimension, most_dimensions and converged_below are for learners; evolution has no axes")


def _check_tables(tables: tuple[_Together, ...]) -> None:
    keys = [key for table in tables for key in table]
    for one, other in itertools.permutations(keys, 2):
        if one == other or other.startswith(f"{one}."):
            raise ValueError(f"keys: {other!r} stands in them twice; give each setting once")
    for table in tables:
        first = next(iter(table))
        for key, values in table.items():
            if len(values) != len(table[first]):
                raise ValueError(
                    f"keys: {first!r} and {key!r} move together, but have {len(table[first])} and {len(values)} values;"
                    " give as many, or tables of their own"
                )
            if not all(map(_is_plain, values)):
                raise ValueError(
                    f"keys: {key!r}: expected numbers, texts, true and false, and lists and tables of these"
                )
    if all(len(values) == 1 for table in tables for values in table.values()):
        raise ValueError("keys: expected two or more values of a setting, lowest level first")


def _is_plain(value: object) -> bool:
    """Return whether a value is one that settings have, all through: a date, None or NaN is none."""
    if isinstance(value, dict | list):
        return all(map(_is_plain, value.values() if isinstance(value, dict) else value))
    return isinstance(value, bool | int | str) or (isinstance(value, float) and not math.isnan(value))
