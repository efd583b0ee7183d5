"""Powers of a discount matrix: what lies so many steps ahead is worth that much."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import fractional_matrix_power

__all__ = ["discount_powers"]

Array = NDArray[np.float64]


def discount_powers(matrix: Array, exponents: Array) -> Array:
    """Return (exponents, N, N) powers of a discount matrix, the principal ones where an exponent is not whole.

    Args:
        matrix: Gamma (5.5), (N, N).
        exponents: (exponents,), none negative.

    Example:
        >>> import numpy as np
        >>> from behaviors.actor_critic.discounts import discount_powers
        >>> turn = 0.5 * np.array([[0.0, -1.0], [1.0, 0.0]])  # eigenvalues +-0.5i
        >>> discount_powers(turn, np.array([0.0, 2.0])).round(3).tolist()
        [[[1.0, 0.0], [0.0, 1.0]], [[-0.25, 0.0], [0.0, -0.25]]]
    """
    diagonal = matrix.diagonal()
    found = np.zeros((len(exponents), *matrix.shape))
    if np.array_equal(matrix, np.diag(diagonal)) and (diagonal >= 0.0).all():
        for n, element in enumerate(diagonal):
            found[:, n, n] = element**exponents
        return found
    for k, exponent in enumerate(exponents):
        if exponent == int(exponent):
            found[k] = np.linalg.matrix_power(matrix, int(exponent))
        else:
            found[k] = np.real(fractional_matrix_power(matrix, exponent))
    return found
