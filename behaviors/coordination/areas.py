"""Coordination of several learned behaviours on their tables (appendix B.2): areas, values, and who acts where.

Behaviour i has values ^iQ over its own discrete states ^iX. The composite space ^cX is the product of the states of
all objects that any of them looks at, so each composite state ^cx says which ^ix every behaviour is in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from behaviors.coordination.isodata import isodata

__all__ = ["RELEARN", "Areas", "Behaviour", "areas_of", "component", "first_values", "state_values"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

RELEARN = -1  # the area of states where the behaviours compete


@dataclass(frozen=True)
class Behaviour:
    """A learned behaviour, seen from the composite space.

    name: for messages.
    values: (own states, actions) float64, ^iQ.
    worth: (own states,) float64, ^iV of (B.7): what it is worth to leave a state to this behaviour.
    component: (composite states,) int64, ^ix of each ^cx.
    threatened: applies where its values are lowest, not highest: it has no goal, but something to prevent.
    """

    name: str
    values: Array
    worth: Array
    component: Index
    threatened: bool = False

    @property
    def claim(self) -> Array:
        """(composite states,) ^iq_max of each composite state, or its negative if the behaviour is ``threatened``."""
        best: Array = self.values.max(axis=1)[self.component]
        return -best if self.threatened else best

    @property
    def levelled(self) -> Array:
        """(own states, actions) ^iQ, each row moved so that its best value is ^iV: as (B.6) bootstraps from it."""
        return np.asarray(self.values + (self.worth - self.values.max(axis=1))[:, None])


@dataclass(frozen=True)
class Areas:
    """How the composite space is divided.

    area: (composite states,) int64, the number of the behaviour that acts there, or RELEARN.
    kernels: (behaviours,) int64, the kernel state of each.
    distance: (composite states, behaviours) float64, of (B.5) to each kernel, W = diag(1 / variance).
    """

    area: Index
    kernels: Index
    distance: Array


def component(sizes: Sequence[int], axes: Sequence[int]) -> Index:
    """Return the state within the product of some axes for each state of the product of all; the last varies fastest.

    Args:
        sizes: number of states along each axis of the composite space.
        axes: which of these a behaviour looks at, in its own order.
    """
    places = np.unravel_index(np.arange(int(np.prod(sizes))), tuple(sizes))
    own = np.ravel_multi_index(tuple(places[axis] for axis in axes), tuple(sizes[axis] for axis in axes))
    return np.asarray(own, np.int64)


def state_values(values: Array, *, steps: Array | None, gamma: float, reward: float) -> Array:
    """Return what each state is worth under a behaviour's policy, ^iV of (B.7).

    The print lost an exponent there; the text discounts by the expected number of physical steps to the goal:
    ^iV(x) = gamma^steps(x) R. A behaviour without a goal, whose values are punishments, keeps max ^iQ.

    Args:
        values: (states, actions).
        steps: (states,) expected physical steps to the goal; None for a behaviour that has none.
        gamma: discount of a physical step.
        reward: of the goal, R.
    """
    return values.max(axis=1) if steps is None else np.asarray(gamma**steps * reward)


def areas_of(
    behaviours: Sequence[Behaviour], *, max_iterations: int = 10, split_std: float = 1.0, merge_distance: float = 0.5
) -> Areas:
    """Divide the composite space into one no-more-learning area for each behaviour and the re-learning area (B.2.2).

    Points are q(x), each ^iq_max over its standard deviation, so that the weighted distance (B.5) is the plain one.
    The kernel of a behaviour is where its q exceeds the mean of the others' most: with a shared object, the
    coordinates of (B.3) and (B.4) need not meet in one state. ISODATA starts from the kernels and the point midway.
    What ends up in a cluster without a kernel is to be learned again.

    Args:
        behaviours: two or more.
        max_iterations, split_std, merge_distance: of ISODATA, in standard deviations of q.

    Raises:
        ValueError: a behaviour values all states alike, or two behaviours have the same kernel.
    """
    q = np.stack([one.claim for one in behaviours], axis=1)
    deviation = np.sort(q, axis=0).std(axis=0)  # sorted, so that the order of states does not change the last digit
    for one, spread in zip(behaviours, deviation, strict=True):
        if spread == 0.0:
            raise ValueError(f"{one.name} values all states alike, so nothing tells where it applies")
    q /= deviation
    count = len(behaviours)
    excess = q - (q.sum(axis=1, keepdims=True) - q) / (count - 1)
    kernels = excess.argmax(axis=0).astype(np.int64)
    if len(set(kernels.tolist())) < count:
        raise ValueError(f"{' and '.join(one.name for one in behaviours)} apply best in the same state")
    centres = q[kernels]
    clusters = isodata(
        q,
        np.vstack([centres, centres.mean(axis=0)]),
        pinned=kernels.tolist(),
        max_iterations=max_iterations,
        split_std=split_std,
        merge_distance=merge_distance,
    )
    area = np.where(clusters.labels < count, clusters.labels, RELEARN)
    distance = np.stack([((q - centre) ** 2).sum(axis=1) for centre in centres], axis=1)
    return Areas(area.astype(np.int64), kernels, distance)


def first_values(behaviours: Sequence[Behaviour], distance: Array, *, how: str) -> Array:
    """Return values to begin the re-learning with, (composite states, actions), in agreement with the areas' values.

    blend: each behaviour's levelled values, weighted by the inverse of its kernel's distance (Shepard 1968). A state
    near a kernel begins with what that behaviour's area is worth, one midway with the mean.
    sum: the levelled values add up, as the rewards of the composite task do.
    zero: nothing is known.

    Args:
        behaviours: whose values.
        distance: (composite states, behaviours) of (B.5).
        how: "blend", "sum" or "zero".
    """
    result = np.zeros((len(distance), behaviours[0].values.shape[1]))
    if how == "zero":
        return result
    # 1 / d_i times the product of all d: has no pole at a kernel, and no two kernels have the same q.
    weight = np.stack([np.delete(distance, i, axis=1).prod(axis=1) for i in range(len(behaviours))], axis=1)
    weight /= weight.sum(axis=1, keepdims=True)
    for i, one in enumerate(behaviours):
        share = weight[:, i, None] if how == "blend" else 1.0
        result += share * one.levelled[one.component]
    return result
