"""ISODATA (Ball and Hall 1965): k-means whose clusters split where they are wide and merge where they are close."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Clusters", "isodata"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Clusters:
    """A partition of points.

    centres: (clusters, d) float64, those of the pinned points first, in their order.
    labels: (points,) int64, the cluster of each point.
    """

    centres: Array
    labels: NDArray[np.int64]


def isodata(
    points: Array,
    centres: Array,
    *,
    pinned: Sequence[int] = (),
    max_iterations: int = 10,
    split_std: float = 1.0,
    merge_distance: float = 0.5,
) -> Clusters:
    """Partition points from initial centres.

    An iteration assigns each point to its nearest centre (of equals the first), drops empty clusters, moves each
    centre to its cluster's mean and then splits, or else merges; the last one does neither. Without splits and
    merges this is Lloyd's k-means. The order of the points does not matter, to the last digit.

    Args:
        points: (points, d).
        centres: (clusters, d).
        pinned: the point pinned[i] stays in cluster i, which is never dropped or merged with that of another one.
        max_iterations: ends sooner when nothing changes.
        split_std: a cluster is split in the direction of its largest standard deviation if that is above this.
        merge_distance: two clusters whose centres are nearer than this become one.

    Raises:
        ValueError: there are more pinned points than centres, or they and the centres differ in dimension.

    Example:
        >>> import numpy as np
        >>> from behaviors.coordination.isodata import isodata
        >>> points = np.array([[0.0], [0.2], [5.0], [5.2]])
        >>> found = isodata(points, np.array([[2.0]]))  # one centre is given, and split
        >>> found.labels.tolist(), found.centres.ravel().round(1).tolist()
        ([0, 0, 1, 1], [0.1, 5.1])
    """
    if len(pinned) > len(centres) or centres.ndim != 2 or centres.shape[1] != points.shape[1]:
        raise ValueError(
            f"expected at least {len(pinned)} centres of {points.shape[1]} numbers, got shape {centres.shape}"
        )
    # Sums of floats depend on their order; sorted points make the answer that of the set of points.
    order = np.lexsort(points.T[::-1])
    back = np.empty(len(points), np.int64)
    back[order] = np.arange(len(points))
    points, pins = points[order], back[list(pinned)]
    labels = np.full(len(points), -1, np.int64)
    for iteration in range(max_iterations):
        before, labels = labels, _nearest(points, centres, pins)
        used = np.union1d(np.arange(len(pins)), labels)
        labels = np.searchsorted(used, labels)
        centres = np.array([points[labels == c].mean(axis=0) for c in range(len(used))])
        if iteration < max_iterations - 1:
            changed = _split(points, labels, centres, pins, split_std)
            if changed is None:
                changed = _merge(labels, centres, len(pins), merge_distance)
            if changed is not None:
                centres, labels = changed, np.full(len(points), -1, np.int64)
                continue
        if np.array_equal(before, labels):
            break
    return Clusters(centres, _nearest(points, centres, pins)[back])


def _nearest(points: Array, centres: Array, pins: NDArray[np.int64]) -> NDArray[np.int64]:
    distance = ((points[:, None, :] - centres[None, :, :]) ** 2).sum(axis=2)
    labels: NDArray[np.int64] = distance.argmin(axis=1).astype(np.int64)
    labels[pins] = np.arange(len(pins))
    return labels


def _split(
    points: Array, labels: NDArray[np.int64], centres: Array, pins: NDArray[np.int64], split_std: float
) -> Array | None:
    """Return the centres after each wide cluster became two, one deviation apart on either side; None if none is."""
    result, more = centres.copy(), []
    for c, centre in enumerate(centres):
        std = points[labels == c].std(axis=0)
        axis = int(std.argmax())
        if std[axis] <= split_std:
            continue
        low, high = centre.copy(), centre.copy()
        low[axis] -= std[axis]
        high[axis] += std[axis]
        if c < len(pins) and points[pins[c], axis] > centre[axis]:
            low, high = high, low  # the half that holds the pinned point keeps its number
        result[c] = low
        more.append(high)
    return np.vstack([result, *more]) if more else None


def _merge(labels: NDArray[np.int64], centres: Array, pins: int, merge_distance: float) -> Array | None:
    """Return the centres after close ones became one, the closest first, each at most once; None if none are."""
    apart = np.sqrt(((centres[:, None, :] - centres[None, :, :]) ** 2).sum(axis=2))
    pairs = [
        (apart[i, j], i, j)
        for j in range(max(pins, 1), len(centres))  # of two pinned clusters neither may go
        for i in range(j)
        if apart[i, j] < merge_distance
    ]
    sizes, result = np.bincount(labels, minlength=len(centres)), centres.copy()
    merged, gone = set[int](), list[int]()
    for _, i, j in sorted(pairs):
        if i in merged or j in merged:
            continue
        result[i] = (sizes[i] * centres[i] + sizes[j] * centres[j]) / (sizes[i] + sizes[j])
        merged |= {i, j}
        gone.append(j)
    return np.delete(result, gone, axis=0) if gone else None
