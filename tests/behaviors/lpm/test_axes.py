"""Tests of behaviors.lpm.axes."""

from __future__ import annotations

import numpy as np
import pytest

from behaviors.lpm import identify
from behaviors.lpm.axes import simple_axes, varimax


@pytest.mark.parametrize("seed", range(5))
def test_varimax_undoes_a_rotation_of_simple_loadings(seed: int) -> None:
    rng = np.random.default_rng(seed)
    simple = np.kron(np.eye(3), np.array([[0.9], [0.7]]))
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    found = simple @ turn @ varimax(simple @ turn)
    assert np.allclose(np.sort(np.abs(found), axis=1)[:, :2], 0.0, atol=1e-4)


def test_axes_do_not_depend_on_the_sample() -> None:
    def loadings(seed: int) -> np.ndarray:
        rng = np.random.default_rng(seed)
        u, y = rng.standard_normal((4000, 2)), np.zeros((4000, 2))
        for t in range(1, 4000):  # two lags of the same predictability: axes are open
            y[t] = 0.9 * y[t - 1] + u[t]
        model = identify([(u, y)], history_length=1, order=2)
        rotation = simple_axes(model, [(u, y)])
        assert np.allclose(rotation @ rotation.T, np.eye(2))
        x = model.states(u, y)[2:] @ rotation
        return np.abs(np.corrcoef(x.T, y[1:-1].T)[:2, 2:])

    for seed in range(3):
        found = loadings(seed)
        assert np.sort(found, axis=1)[:, 1].min() > 0.95
        assert found.argmax(axis=1).tolist() in ([0, 1], [1, 0])
