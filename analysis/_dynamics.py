"""What is measured of a matrix of wins, to say what its labels are: noise, gains, losses, and what comes round.

Rows of a matrix are champions in order of time, columns the opponents that stay the same down a column.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Matrix",
    "champions_luck",
    "chance_of",
    "gain_of",
    "interaction",
    "largest_return",
    "loss_of",
    "noise_of",
    "singular_values",
    "spectral_noise",
    "variogram_of",
    "visits_of",
]

Matrix = NDArray[np.float64]
PERMUTATIONS = 199

# -------------------------------------------------------------------------------------------------------- numbers


def noise_of(shares: Matrix, games: int | None) -> float:
    """Return the standard deviation of a share, the smaller of two estimates from the matrix.

    One is the median singular value of what is left without the means of rows and columns (Gavish and Donoho 2014):
    regular structure sits in few large singular values. The other is the median mixed difference of neighbours, which
    sharp edges do not move. Each is fooled by structure that the other sees through.
    """
    values = singular_values(interaction(shares))
    local = float(np.quantile(np.abs(np.diff(np.diff(shares, axis=0), axis=1)), 0.75)) / (1.1503 * 2)
    noise = min(spectral_noise(values), local)
    if games is not None:
        noise = max(noise, float(np.sqrt(np.mean(shares * (1 - shares)) / max(games - 1, 1))))
    return max(float(noise), 1e-3)


def singular_values(matrix: Matrix) -> NDArray[np.float64]:
    """Return the singular values of a square matrix, the largest first."""
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(matrix @ matrix.T)[::-1], 0.0)), np.float64)


def spectral_noise(values: NDArray[np.float64]) -> float:
    return float(np.median(values[:-1]) / np.sqrt(0.6528 * (len(values) - 1)))


def interaction(shares: Matrix) -> Matrix:
    """Return what is left of shares without the means of rows and of columns."""
    rows, columns = shares.mean(axis=1, keepdims=True), shares.mean(axis=0)
    return np.asarray(shares - rows - columns + shares.mean(), np.float64)


def champions_luck(means: NDArray[np.float64]) -> float:
    """Return the standard deviation of row means from one generation to the next, trends and steps taken out."""
    first = np.median(np.abs(np.diff(means))) / (0.6745 * np.sqrt(2))
    second = np.median(np.abs(np.diff(means, 2))) / (0.6745 * np.sqrt(6))
    return max(float(min(first, second)), 1e-3)


def gain_of(means: NDArray[np.float64], luck: float) -> tuple[float, float]:
    """Return the gain from the first to the last generations, and the same in standard errors."""
    best = (0.0, 0.0)
    for share in (1 / 4, 1 / 8):
        width = int(np.ceil(share * len(means)))
        gain = float(means[-width:].mean() - means[:width].mean())
        errors = gain / (luck * float(np.sqrt(2 / width)))
        best = max(best, (gain, errors), key=lambda one: abs(one[1]))
    return best


def loss_of(shares: Matrix, noise: float, luck: float) -> tuple[float, float, float]:
    """Return what was lost since the best time, the same in standard errors, and the mean over all opponents.

    The first two are by time or by lag, whichever shows it more clearly.

    The best time against some opponents is chosen by every other of them, and the loss measured on the rest: so luck
    that made a time look best is not counted as lost later.
    """
    own = max(luck**2 - noise**2 / len(shares), 0.0)
    by_time, by_lag = _loss_by_time(shares, noise, own), _loss_by_lag(shares, noise, own)
    return (*max(by_time, by_lag, key=lambda one: one[1]), by_time[0])


def _loss_by_time(shares: Matrix, noise: float, own: float) -> tuple[float, float]:
    """Return the mean over opponents of their best time less the end."""
    n = len(shares)
    count = int(np.clip(n // 2, 3, 8))
    blocks = np.array_split(np.arange(n), count)
    over_time = np.stack([shares[block].mean(axis=0) for block in blocks])
    halves = [
        np.stack([over_time[:, block[block % 2 == parity]].mean(axis=1) for block in blocks], axis=1)
        for parity in (0, 1)
    ]
    lost = []
    for chosen, measured in (halves, halves[::-1]):
        best = chosen.argmax(axis=0)
        lost.append(measured[best, np.arange(count)] - measured[-1])
    loss = float(np.mean(lost))
    return loss, loss / float(np.sqrt(2 * noise**2 * count / n**2 + 2 * own * count / n + 1e-6))


def _loss_by_lag(shares: Matrix, noise: float, own: float) -> tuple[float, float]:
    """Return what champions win more against opponents of the best lag than their later ones do against the same."""
    n = len(shares)
    rows = n - max(2, n // 8)  # a later time of so many generations is left to compare with
    later = (shares.sum(axis=0) - shares.cumsum(axis=0))[:rows] / (n - 1 - np.arange(rows)[:, None])
    more = shares[:rows] - later
    lag = np.subtract.outer(np.arange(rows), np.arange(n)) + n
    width = max(1, n // 16)
    bins, size = lag // width, 2 * n // width + 1
    odd = np.broadcast_to(np.arange(n) % 2 == 1, lag.shape)
    counts = np.stack([np.bincount(bins[part], minlength=size) for part in (odd, ~odd)])
    sums = np.stack([np.bincount(bins[part], more[part], minlength=size) for part in (odd, ~odd)])
    means = sums / np.maximum(counts, 1)
    enough = counts.min(axis=0) >= max(2, n // 6) * width // 2
    lost, error = [], []
    for chosen, measured in ((0, 1), (1, 0)):
        best = int(np.argmax(np.where(enough, means[chosen] * np.sqrt(counts[chosen]), -np.inf)))
        lost.append(means[measured][best])
        champions = min(2 * counts[measured][best] / width, n)
        error.append(noise**2 / counts[measured][best] / 2 + own * (1 / champions + 4 / n))
    loss = float(np.mean(lost))
    return loss, loss / float(np.sqrt(np.mean(error) + 1e-6))


# --------------------------------------------------------------------------------------------------------- cycles


def variogram_of(products: Matrix) -> NDArray[np.float64]:
    """Return by lag 0 to 3/4 n half the mean square difference of two rows, from their scalar products (n, n)."""
    n = len(products)
    square = np.diagonal(products)
    apart = 0.5 * (square[:, None] + square[None, :]) - products
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    return np.asarray((np.bincount(lag.ravel(), apart.ravel()) / np.bincount(lag.ravel()))[: int(0.75 * n) + 1])


def largest_return(variogram: NDArray[np.float64], n: int) -> tuple[float, int]:
    """Return the largest fall of the variogram from a smaller lag to one of 2 to n/2, and that lag."""
    before = np.maximum.accumulate(variogram)
    lags = np.arange(2, n // 2 + 1)
    falls = before[lags - 1] - variogram[lags]
    best = int(np.argmax(falls))
    return float(falls[best]), int(lags[best])


def chance_of(products: Matrix) -> tuple[float, float]:
    """Return the shares of shuffled orders of generations that come round as well, and that hold on as well."""
    n = len(products)
    random = np.random.default_rng(0)
    variogram = variogram_of(products)
    fall = largest_return(variogram, n)[0]
    round_again, held = 1, 1
    for _ in range(PERMUTATIONS):
        order = random.permutation(n)
        shuffled = variogram_of(products[np.ix_(order, order)])
        round_again += largest_return(shuffled, n)[0] >= fall
        held += shuffled[1] <= variogram[1]
    return round_again / (PERMUTATIONS + 1), held / (PERMUTATIONS + 1)


def visits_of(changes: Matrix, noise: float) -> float:
    """Return the median over rows of how often rows like it come, with rows unlike it between (1: never again)."""
    powers, directions = np.linalg.eigh(changes @ changes.T)
    values = np.sqrt(np.maximum(powers, 0.0))
    kept = values > 2.2 * noise * np.sqrt(len(changes))
    if not kept.any():
        return 1.0
    rows = directions[:, kept] * values[kept]
    square = (rows**2).sum(axis=1)
    apart = np.sqrt(np.maximum(square[:, None] + square[None, :] - 2 * rows @ rows.T, 0))
    apart /= apart.max()
    visits, away = np.zeros(len(rows)), np.ones(len(rows), bool)
    for one in apart.T:
        back = away & (one < 0.3)
        visits += back
        away = (away & ~back) | (one > 0.7)
    return float(np.median(visits))
