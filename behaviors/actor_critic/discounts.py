"""Powers of a discount matrix: what lies so many steps ahead is worth that much."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import fractional_matrix_power

__all__ = ["discount_powers"]

Array = NDArray[np.float64]


def discount_powers(matrix: Array, share: float, most: int) -> Array:
    """Return (most + 1, N, N) powers 0, share, 2 share ... of a discount matrix, the principal ones.

    Args:
        matrix: Gamma (5.5), (N, N).
        share: of it that a single step has.
        most: how many steps.

    Example:
        >>> import numpy as np
        >>> from behaviors.actor_critic.discounts import discount_powers
        >>> turn = 0.5 * np.array([[0.0, -1.0], [1.0, 0.0]])  # eigenvalues +-0.5i
        >>> (discount_powers(turn, 0.5, 4)[4].round(3) + 0.0).tolist()
        [[-0.25, 0.0], [0.0, -0.25]]
    """
    diagonal = matrix.diagonal()
    if np.array_equal(matrix, np.diag(diagonal)) and (diagonal >= 0.0).all():
        return np.array([np.diag(diagonal ** (share * step)) for step in range(most + 1)])
    one = matrix if share == 1.0 else np.real(fractional_matrix_power(matrix, share))
    found = np.zeros((most + 1, *matrix.shape))
    found[0] = np.eye(len(matrix))
    for step in range(most):
        found[step + 1] = found[step] @ one
    return found
