"""ISODATA: k-means of scipy when it may neither split nor merge, and what must hold of any partition."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.cluster.vq import kmeans2

from behaviors.coordination.isodata import isodata


def cloud(seed, count=60, dimensions=2):
    return np.random.default_rng(seed).normal(size=(count, dimensions))


def blobs(*middles, count=40, seed=1):
    """Return points around each middle, far nearer to it than the middles are to each other."""
    random = np.random.default_rng(seed)
    return np.vstack([random.normal(middle, 0.1, (count, len(middle))) for middle in middles])


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10_000), st.integers(1, 6), st.integers(1, 3))
def test_without_splits_and_merges_it_is_lloyds_k_means(seed, clusters, dimensions):
    points = cloud(seed, dimensions=dimensions)
    found = isodata(points, points[:clusters], max_iterations=200, split_std=np.inf, merge_distance=0.0)
    if len(found.centres) < clusters:  # it drops a cluster that lost its last point; k-means keeps it
        return
    centres, labels = kmeans2(points, points[:clusters], iter=200, minit="matrix")
    assert np.array_equal(found.labels, labels)
    np.testing.assert_allclose(found.centres, centres, rtol=1e-12, atol=1e-12)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10_000), st.integers(1, 4), st.floats(0.2, 1.5), st.floats(0.0, 1.5), st.integers(1, 12))
def test_every_point_is_in_the_cluster_of_its_nearest_centre(seed, pins, split_std, merge_distance, iterations):
    points = cloud(seed)
    pinned = list(range(pins))
    centres = np.vstack([points[pinned], points[pinned].mean(axis=0)])
    numbers = {"max_iterations": iterations, "split_std": split_std, "merge_distance": merge_distance}
    found = isodata(points, centres, pinned=pinned, **numbers)
    assert found.labels.shape == (len(points),)
    assert found.labels[pinned].tolist() == pinned
    distance = np.linalg.norm(points[:, None] - found.centres[None], axis=2)
    free = np.arange(len(points)) >= pins
    assert np.array_equal(found.labels[free], distance.argmin(axis=1)[free])
    again = isodata(points, centres, pinned=pinned, **numbers)
    assert np.array_equal(found.labels, again.labels)
    assert np.array_equal(found.centres, again.centres)
    # The same points in another order are in the same clusters, and the centres are the same to the last digit.
    order = np.random.default_rng(seed + 1).permutation(len(points))
    places = np.argsort(order)
    other = isodata(points[order], centres, pinned=places[pinned].tolist(), **numbers)
    assert np.array_equal(other.labels, found.labels[order])
    assert np.array_equal(other.centres, found.centres)


def test_a_wide_cluster_splits_into_what_it_is_made_of():
    points = blobs((0.0, 0.0), (10.0, 0.0), (10.0, 7.0))
    found = isodata(points, points.mean(axis=0, keepdims=True), split_std=1.0, merge_distance=0.5)
    parts = [found.labels[k : k + 40] for k in (0, 40, 80)]
    assert len(found.centres) == 3
    assert [len(set(part.tolist())) for part in parts] == [1, 1, 1]
    assert len({int(part[0]) for part in parts}) == 3


def test_clusters_that_are_close_become_one():
    points = blobs((0.0, 0.0), (5.0, 0.0))
    found = isodata(points, np.array([[-0.1, 0.0], [0.1, 0.0], [5.0, 0.0]]), split_std=1.0, merge_distance=0.5)
    assert found.labels.tolist() == [0] * 40 + [1] * 40
    np.testing.assert_allclose(found.centres, [points[:40].mean(axis=0), points[40:].mean(axis=0)])


def test_pinned_points_keep_clusters_of_their_own_however_close():
    points = blobs((0.0, 0.0))
    found = isodata(points, points[[3, 7]], pinned=[3, 7], merge_distance=5.0)
    assert len(found.centres) == 2
    assert found.labels[[3, 7]].tolist() == [0, 1]


@pytest.mark.parametrize("pinned", [0, 40])
def test_when_its_cluster_splits_a_pinned_point_stays_in_the_first_part(pinned):
    points = blobs((0.0, 0.0), (10.0, 0.0))
    found = isodata(points, points.mean(axis=0, keepdims=True), pinned=[pinned])
    assert found.labels[pinned] == 0
    assert (found.labels == 0).sum() == 40


def test_an_empty_cluster_is_dropped():
    points = blobs((0.0, 0.0), (5.0, 0.0))
    far = np.array([[0.0, 0.0], [90.0, 90.0], [5.0, 0.0]])
    assert isodata(points, far).labels.tolist() == [0] * 40 + [1] * 40


@pytest.mark.parametrize(("centres", "pinned"), [(np.zeros((1, 2)), [0, 1]), (np.zeros((2, 3)), []), (np.zeros(2), [])])
def test_centres_that_do_not_fit_are_refused(centres, pinned):
    with pytest.raises(ValueError, match="expected at least"):
        isodata(cloud(1), centres, pinned=pinned)
