"""Which of equally good actions a skill takes, whose policy is a table."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["ties_drawn"]


def ties_drawn(scores: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Return scores in which each state that was visited has a single best action, drawn from its equals.

    Args:
        scores: (states, actions), zeros of a state that was not visited.
        rng: the same draws whatever the scores.

    Example:
        >>> import numpy as np
        >>> from behaviors.actor_critic.ties import ties_drawn
        >>> scores = np.array([[1, 1, 0]] * 4 + [[0, 0, 0]], np.float32)
        >>> ties_drawn(scores, np.random.default_rng(3)).argmax(axis=1).tolist()
        [1, 0, 0, 1, 0]
    """
    best = scores == scores.max(axis=1, keepdims=True)
    chosen = np.where(best, rng.random(scores.shape), -1.0).argmax(axis=1)
    found = scores.copy()
    rows = np.flatnonzero(scores.any(axis=1))
    found[rows, chosen[rows]] = np.nextafter(scores[rows, chosen[rows]], np.float32(np.inf))
    return found
