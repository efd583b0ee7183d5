"""Random systems whose state is known, to identify local prediction models from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag, inv, solve_discrete_are

Array = NDArray[np.float64]
Segment = tuple[Array, Array]
Policy = Callable[[Array], Array]

STATES, INPUTS, OUTPUTS = 4, 2, 3
NOISE = 0.1


@dataclass(frozen=True)
class _Systems:
    """Many x_{t+1} = A x_t + B u_t + w_t, y_t = C x_t + D u_t + v_t; w and v white, deviation NOISE, (A.1).

    Matrices and signals have a leading axis of systems.
    """

    A: Array
    B: Array
    C: Array
    D: Array

    def simulate(self, rng: np.random.Generator, steps: int, kind: str, noise: float = NOISE) -> Segment:
        """Return actions (systems, steps, m) and the observations (systems, steps, q) that they led to."""
        count = len(self.A)
        act = _INPUTS[kind](rng, count)
        x, y = np.zeros((count, STATES)), np.zeros((count, OUTPUTS))
        w = noise * rng.normal(size=(steps, count, STATES))
        v = noise * rng.normal(size=(steps, count, OUTPUTS))
        actions, observations = np.empty((count, steps, INPUTS)), np.empty((count, steps, OUTPUTS))
        for t in range(steps):
            u = act(y)
            y = _times(self.C, x) + _times(self.D, u) + v[t]
            x = _times(self.A, x) + _times(self.B, u) + w[t]
            actions[:, t], observations[:, t] = u, y
        return actions, observations

    def kalman_predictions(self, actions: Array, observations: Array) -> Array:
        """Return the best possible one-step predictions: the stationary Kalman filter of each true system."""
        state_noise, noise = NOISE**2 * np.eye(STATES), NOISE**2 * np.eye(OUTPUTS)
        gain = np.empty((len(self.A), STATES, OUTPUTS))
        for i, (A, C) in enumerate(zip(self.A, self.C, strict=True)):
            covariance = solve_discrete_are(A.T, C.T, state_noise, noise)
            gain[i] = A @ covariance @ C.T @ inv(C @ covariance @ C.T + noise)
        x, predictions = np.zeros((len(self.A), STATES)), np.empty_like(observations)
        for t in range(actions.shape[1]):
            u = actions[:, t]
            predictions[:, t] = _times(self.C, x) + _times(self.D, u)
            x = _times(self.A, x) + _times(self.B, u) + _times(gain, observations[:, t] - predictions[:, t])
        return predictions


def _times(matrices: Array, vectors: Array) -> Array:
    """Product of each matrix with its vector."""
    return np.matmul(matrices, vectors[..., None])[..., 0]


def _random_systems(rng: np.random.Generator, count: int) -> _Systems:
    A = np.empty((count, STATES, STATES))
    for i in range(count):
        blocks: list[Array] = []
        while (left := STATES - sum(len(block) for block in blocks)) > 0:
            modulus = rng.uniform(0.5, 0.95)
            if left >= 2 and rng.random() < 0.5:
                angle = rng.uniform(0.2, np.pi - 0.2)
                turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
                blocks.append(modulus * turn)
            else:
                blocks.append(np.array([[modulus * rng.choice([-1.0, 1.0])]]))
        basis = np.linalg.qr(rng.normal(size=(STATES, STATES)))[0]
        A[i] = basis @ block_diag(*blocks) @ basis.T
    return _Systems(
        A=A,
        B=rng.normal(size=(count, STATES, INPUTS)),
        C=rng.normal(size=(count, OUTPUTS, STATES)),
        D=rng.normal(size=(count, OUTPUTS, INPUTS)),
    )


def _white(rng: np.random.Generator, count: int) -> Policy:
    return lambda _: rng.normal(size=(count, INPUTS))


def _held(rng: np.random.Generator, count: int) -> Policy:
    """Primitives of {-1, 0, 1}, each held for 1 to 20 steps."""
    action, left = np.zeros((count, INPUTS)), np.zeros((count, 1), dtype=np.int64)

    def act(_: Array) -> Array:
        nonlocal action, left
        action = np.where(left == 0, rng.integers(-1, 2, size=action.shape), action)
        left = np.where(left == 0, rng.integers(1, 21, size=left.shape), left) - 1
        return action

    return act


def _policy(rng: np.random.Generator, count: int) -> Policy:
    """Feedback: the signs of fixed combinations of the last observation, 20 % random primitives."""
    gain = rng.normal(size=(count, INPUTS, OUTPUTS))

    def act(observation: Array) -> Array:
        primitive = rng.integers(-1, 2, size=(count, INPUTS))
        return np.where(rng.random((count, 1)) < 0.2, primitive, np.sign(_times(gain, observation)))

    return act


_INPUTS = {"white": _white, "held": _held, "policy": _policy}


@pytest.fixture(scope="session")
def random_systems():
    """Return a function that draws systems of order 4, with 2 inputs and 3 outputs.

    Eigenvalues have a modulus of 0.5 to 0.95, real ones and pairs, in random orthogonal bases.
    """
    return _random_systems


@pytest.fixture(scope="session")
def record():
    """Return a function that gives segments of one random system."""

    def segments(seed: int, lengths: list[int], kind: str = "white") -> list[Segment]:
        rng = np.random.default_rng(seed)
        system = _random_systems(rng, 1)
        return [(u[0], y[0]) for u, y in (system.simulate(rng, steps, kind) for steps in lengths)]

    return segments
