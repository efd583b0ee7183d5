"""Matrices of wins whose dynamics are known, to choose the limits of the diagnosis and to say how often it errs."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from analysis.calibration.dynamics import held_out, numbers, textbook, tuned
from analysis.progress import LABELS

__all__ = ["SETS", "Family", "cases"]

Family = Callable[[Generator, int], NDArray[np.float64]]


def _exact(game: Callable[[Generator], NDArray[np.float64]]) -> Family:
    def family(random: Generator, _n: int) -> NDArray[np.float64]:
        return game(random)

    family.__name__ = game.__name__
    return family


SETS: dict[str, dict[str, tuple[Family, ...]]] = {
    "tuned": {kind: (*tuned.FAMILIES[kind], *textbook.FAMILIES[kind]) for kind in LABELS},
    "held-out": {kind: held_out.FAMILIES[kind] for kind in LABELS},
    "numbers": {kind: (_exact(numbers.GAMES[kind]),) for kind in LABELS},
}
# Generations and games a pair, both drawn evenly in their logarithms.
_SIZES = {"tuned": ((8, 80), (5, 100)), "held-out": ((8, 200), (5, 100))}


def cases(which: str, kind: str, count: int, *, seed: int) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield matrices of one kind, the families of a set in turn: (name of the family, shares (n, n)).

    Args:
        which: of `SETS`; the shares of ``tuned`` and ``held-out`` are those of so many games, ``numbers`` is exact.
        kind: of `analysis.progress.LABELS`.
        count: how many.
        seed: the same seed gives the same matrices.
    """
    families = SETS[which][kind]
    for case in range(count):
        family = families[case % len(families)]
        random = np.random.default_rng([seed, list(SETS).index(which), LABELS.index(kind), case])
        if which == "numbers":
            yield family.__name__, family(random, 0)
            continue
        generations, games = (int(np.exp(random.uniform(*np.log(limits)))) for limits in _SIZES[which])
        yield family.__name__, random.binomial(games, family(random, generations)) / games
