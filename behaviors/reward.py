"""Rewards of several channels, and how each is discounted: settings (Uchibe 1999, 5.2)."""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import UNSET, Meta, UnsetType
from numpy.typing import NDArray

from coevo.config import NonNegative, Positive, Settings

__all__ = ["ChannelSettings", "EarnSettings", "RewardSettings", "discount_matrix"]

_Amount = Annotated[float, Meta(ge=-1e6, le=1e6)]
_ZERO = 1e-12  # an imaginary part below it is that of a real eigenvalue


class EarnSettings(Settings, frozen=True, kw_only=True):
    """What a channel earns for each event."""

    goal: _Amount = 0.0  # what the task is about succeeds: for shoot a goal
    conceded: _Amount = 0.0  # a goal against it
    passed: _Amount = msgspec.field(name="pass", default=0.0)
    giveaway: _Amount = 0.0  # a pass that an opponent receives; of a team alone
    collision: _Amount = 0.0
    kick: _Amount = 0.0  # contact with the ball

    @property
    def amounts(self) -> dict[str, float]:
        """By name of the event what is earned for it, where that is not nothing."""
        named = {field.encode_name: float(getattr(self, field.name)) for field in msgspec.structs.fields(self)}
        return {event: amount for event, amount in named.items() if amount != 0.0}


class ChannelSettings(Settings, frozen=True, kw_only=True):
    """One element of the reward (5.3)."""

    name: Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_-]{0,15}$")]
    earns: EarnSettings
    discount: Annotated[float, Meta(ge=0.0, lt=1.0)] = 0.9  # its element of a diagonal Gamma (5.6)
    # How much worse than the best of a state an action may be and yet be as good to this channel: within it all get its
    # vote, and where all are, it abstains.
    tolerance: NonNegative = 1e-9


class RewardSettings(Settings, frozen=True, kw_only=True):
    """A vector-valued reward, for the method actor-critic; the order of the channels is that of their priority."""

    channels: Annotated[tuple[ChannelSettings, ...], Meta(min_length=1, max_length=8)]
    # Gamma (5.5), row by row, instead of the channels' discounts.
    matrix: tuple[tuple[_Amount, ...], ...] | UnsetType = UNSET
    # With learning.discount_per = "step": for how many physical steps the discounts are. "action": for an action,
    # however long, and this is without effect.
    discount_steps: Positive = 10.0
    # Contact, with the ball or with a robot, lasts: is it an event once an action, when it begins, or in every step?
    paid: Literal["action", "contact", "step"] = "action"

    def __post_init__(self) -> None:
        names = [channel.name for channel in self.channels]
        if len(set(names)) < len(names):
            raise ValueError("channels: expected each name once")
        for channel in self.channels:
            if not channel.earns.amounts:
                raise ValueError(f"channels: no event gives {channel.name!r} anything; set one of its earns")
        if self.matrix is not UNSET:
            count = len(self.channels)
            if len(self.matrix) != count or any(len(row) != count for row in self.matrix):
                raise ValueError(f"matrix: expected {count} rows of {count} numbers, one of each channel")
            radius = float(np.abs(np.linalg.eigvals(discount_matrix(self))).max())
            if radius >= 1.0:
                raise ValueError(
                    f"matrix: the sum (5.5) has no limit unless all eigenvalues lie within the unit circle; the largest"
                    f" has the modulus {radius:.4g}; make the discounts smaller"
                )

    def check_events(self, happens: Collection[str], where: str) -> None:
        """Refuse a channel that earns for what never happens.

        Raises:
            ValueError: an event is not one of those that happen.
        """
        for channel in self.channels:
            for event in channel.earns.amounts:
                if event not in happens:
                    raise ValueError(
                        f"reward.channels: {channel.name!r} earns for {event!r}, which never happens in {where}"
                    )

    def check_powers(self, per: str) -> None:
        """Refuse a matrix of which a part of an action's discount is not real.

        Raises:
            ValueError: an eigenvalue is negative or zero, and the discount is that of a step.
        """
        if per != "step" or self.matrix is UNSET:
            return
        matrix = discount_matrix(self)
        if np.array_equal(matrix, np.diag(matrix.diagonal())) and (matrix.diagonal() >= 0.0).all():
            return
        for eigenvalue in np.linalg.eigvals(matrix):
            if abs(eigenvalue.imag) < _ZERO and eigenvalue.real < _ZERO:
                raise ValueError(
                    f"reward.matrix: its eigenvalue {eigenvalue.real:.4g} has no real power for a single step; set"
                    ' learning.discount_per = "action", or choose another matrix'
                )


def discount_matrix(settings: RewardSettings) -> NDArray[np.float64]:
    """Return Gamma (5.5), (channels, channels).

    Example:
        >>> from behaviors.reward import ChannelSettings, EarnSettings, RewardSettings, discount_matrix
        >>> earns = {"s": (EarnSettings(goal=1.0), 0.9), "k": (EarnSettings(kick=1.0), 0.6)}
        >>> channels = tuple(ChannelSettings(name=name, earns=one, discount=d) for name, (one, d) in earns.items())
        >>> discount_matrix(RewardSettings(channels=channels)).tolist()
        [[0.9, 0.0], [0.0, 0.6]]
    """
    if settings.matrix is not UNSET:
        return np.array(settings.matrix, np.float64)
    return np.diag([channel.discount for channel in settings.channels]).astype(np.float64)
