"""Is it progress? Name the dynamics of a run from games between the champions of all its generations.

Champions of every generation of one side meet those of every generation of the other (the data of CIAO plots, Cliff
and Miller 1995, and of the master tournament, Nolfi and Floreano 1998). A column is one fixed opponent; down a column
goes time. So a column that rises is progress that is real, whatever the opponents of the time did. The failures are
those of Watson and Pollack (2001) and of Bader-Natal and Pollack (2004); section 6.2 calls them cycles of switching
fixed strategies, a trap in a local maximum (disengagement, stagnation) and mutual skill development (progress).

docs/progress.md says what each label means, and how often it errs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coevo.errors import InputError

__all__ = ["LABELS", "MINIMUM_GENERATIONS", "Diagnosis", "diagnose"]

LABELS = ("progress", "cycling", "forgetting", "disengagement", "stagnation")
MINIMUM_GENERATIONS = 6

# What was chosen on the tuned families of analysis.calibration.dynamics; `coevo reproduce diagnosis` says what they do.
SATURATED = 0.04  # as many games are left to the weaker side at most
LATE = 0.25  # share of the generations, counted from the end, in which disengagement must show
SMALLEST_CHANGE = 0.06  # in the share of games won, for progress; less is luck or of no use
SMALLEST_LOSS = 0.05  # the same for forgetting; it is smaller, as some opponents may not be forgotten
STANDARD_ERRORS = 3.0  # by which a gain must stand out of the luck of champions
LOSS_STANDARD_ERRORS = 3.3  # the same of a loss, which is measured without bias
KEPT = 1.5  # with forgetting, the gain that is kept must outweigh the loss as much to be called progress
RETURN = 0.55  # share of the change that a cycle undoes when it comes round
SMALLEST_SWING = 0.005  # mean square of a cycle's swing: +-0.1 of a sine
INTRANSITIVE = 0.4  # share of the swing that depends on the opponent, from which it is not one ability that swings
LARGE_SWING = 0.06  # mean square beyond what luck of champions can be, +-0.35 of a sine
PERMUTATIONS = 199
CHANCE = 0.01  # of shuffled generations that come round as well

_Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class Diagnosis:
    """What the matrix of wins says about the side whose champions are its rows.

    Attributes:
        labels: of `LABELS`, at least one.
        text: one or two sentences for people.
        noise: standard deviation of one share by the luck of its games.
        late_level: share that the rows win in the last quarter of generations against opponents of that quarter.
        onset: generation from which on one side wins nearly all, None if both have games to win.
        gain: change of the share against the same opponents from the first to the last generations.
        gain_standard_errors: the same in standard errors, champions' luck included.
        loss: mean over opponents of what was lost between the best time against them and the end.
        loss_standard_errors: the same in standard errors.
        swing: mean square of the change of champions' shares over time, noise taken out.
        swing_by_opponent: share of the swing that differs from opponent to opponent.
        period: after how many generations champions are most like before; it means something with ``cycling`` only.
        comes_round: share of the swing that is undone after a period (1: the same again; 0 or less: never).
        visits: how often a typical strategy was held, left and taken up again (1: never again).
    """

    labels: frozenset[str]
    text: str
    noise: float
    late_level: float
    onset: int | None
    gain: float
    gain_standard_errors: float
    loss: float
    loss_standard_errors: float
    swing: float
    swing_by_opponent: float
    period: int
    comes_round: float
    visits: float


def diagnose(wins: ArrayLike, *, games: int | None = None) -> Diagnosis:
    """Name what happened in a run: the same matrix always gets the same answer.

    Args:
        wins: (generations, generations) float64 in 0..1: share of games that the champion of generation i of one side
            wins against that of generation j of the other; at least `MINIMUM_GENERATIONS`. Where champions of some
            generations only met, rows and columns are these generations in order.
        games: games behind each share. Noise is estimated from the matrix, and taken for no less than theirs.

    Raises:
        InputError: another shape, too few generations, or something else than shares.
    """
    shares = _checked(wins, games)
    n = len(shares)
    onset = _onset(shares)
    if onset is None:
        found = _engaged(shares, games)
        return replace(found, text=_text(found, n))
    # What came before counts if it was most of the run: the step into saturation itself is no progress.
    whole = _engaged(shares, games)
    before: frozenset[str] = frozenset()
    if onset >= MINIMUM_GENERATIONS:
        early = _engaged(shares[:onset, :onset], games)
        if onset >= 0.6 * n or ("progress" in early.labels and early.gain >= 0.3):
            whole, before = early, early.labels - {"stagnation"}
    found = replace(whole, labels=before | {"disengagement"}, onset=onset, late_level=_late_level(shares))
    return replace(found, text=_text(found, n))


# ---------------------------------------------------------------------------------------------------------- input


def _checked(wins: ArrayLike, games: int | None) -> _Matrix:
    try:
        shares = np.array(wins, np.float64)
    except (TypeError, ValueError):
        raise InputError("wins must be a matrix of numbers, a row a generation; give an array of floats") from None
    if shares.ndim != 2 or shares.shape[0] != shares.shape[1]:
        raise InputError(
            f"wins has shape {shares.shape}, expected (generations, generations); take the same generations of both sides"
        )
    if len(shares) < MINIMUM_GENERATIONS:
        raise InputError(
            f"wins has {len(shares)} generations, expected at least {MINIMUM_GENERATIONS}; "
            "let champions of more generations play"
        )
    if not np.isfinite(shares).all():
        raise InputError("wins has cells that are not finite, expected shares in 0..1; play the games that are missing")
    if shares.min() < 0 or shares.max() > 1:
        raise InputError(
            f"wins goes from {shares.min():g} to {shares.max():g}, expected shares in 0..1; divide by the games of a pair"
        )
    if games is not None and games < 1:
        raise InputError(f"games is {games}, expected at least 1; leave it out if it is not known")
    return shares


# -------------------------------------------------------------------------------------------------------- numbers


def _noise(shares: _Matrix, games: int | None) -> float:
    """Return the standard deviation of a share, the smaller of two estimates from the matrix.

    One is the median singular value of what is left without the means of rows and columns (Gavish and Donoho 2014):
    regular structure sits in few large singular values. The other is the median mixed difference of neighbours, which
    sharp edges do not move. Each is fooled by structure that the other sees through.
    """
    n = len(shares)
    values = _singular_values(_interaction(shares))
    local = float(np.quantile(np.abs(np.diff(np.diff(shares, axis=0), axis=1)), 0.75)) / (1.1503 * 2)
    noise = min(_spectral_noise(values), local)
    if games is not None:
        noise = max(noise, float(np.sqrt(np.mean(shares * (1 - shares)) / max(games - 1, 1))))
    return float(noise)


def _singular_values(matrix: _Matrix) -> NDArray[np.float64]:
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(matrix @ matrix.T)[::-1], 0.0)))


def _spectral_noise(values: NDArray[np.float64]) -> float:
    return float(np.median(values[:-1]) / np.sqrt(0.6528 * (len(values) - 1)))


def _interaction(shares: _Matrix) -> _Matrix:
    return shares - shares.mean(axis=0) - shares.mean(axis=1, keepdims=True) + shares.mean()


def _late(n: int) -> int:
    return n - max(3, int(np.ceil(LATE * n)))


def _late_level(shares: _Matrix) -> float:
    late = _late(len(shares))
    return float(shares[late:, late:].mean())


def _onset(shares: _Matrix) -> int | None:
    """Return the generation from which on contemporaries' games are all won or all lost, or None."""
    late = _late(len(shares))

    def saturated(start: int) -> bool:
        level = shares[start:, start:].mean()
        return bool(min(level, 1 - level) <= SATURATED)

    if not saturated(late):
        return None
    side = shares[late:, late:].mean() > 0.5
    start = late
    while start > 0:
        edge = np.concatenate([shares[start - 1, start - 1 :], shares[start:, start - 1]])
        level = float(edge.mean()) if not side else 1 - float(edge.mean())
        if level > 3 * SATURATED:
            break
        start -= 1
    return start


def _champions_luck(means: NDArray[np.float64]) -> float:
    """Return the standard deviation of row means from one generation to the next, trends and steps taken out."""
    first = np.median(np.abs(np.diff(means))) / (0.6745 * np.sqrt(2))
    second = np.median(np.abs(np.diff(means, 2))) / (0.6745 * np.sqrt(6))
    return max(float(min(first, second)), 1e-3)


def _gain(means: NDArray[np.float64], luck: float) -> tuple[float, float]:
    """Return the gain from the first to the last generations, and the same in standard errors."""
    best = (0.0, 0.0)
    for share in (1 / 4, 1 / 8):
        width = int(np.ceil(share * len(means)))
        gain = float(means[-width:].mean() - means[:width].mean())
        errors = gain / (luck * float(np.sqrt(2 / width)))
        best = max(best, (gain, errors), key=lambda one: abs(one[1]))
    return best


def _loss(shares: _Matrix, noise: float, luck: float) -> tuple[float, float]:
    """Return what was lost since the best time, and the same in standard errors; by time or by lag, as is clearer.

    The best time against some opponents is chosen by every other of them, and the loss measured on the rest: so luck
    that made a time look best is not counted as lost later.
    """
    own = max(luck**2 - noise**2 / len(shares), 0.0)
    by_time, by_lag = _loss_by_time(shares, noise, own), _loss_by_lag(shares, noise, own)
    return max(by_time, by_lag, key=lambda one: one[1])


def _loss_by_time(shares: _Matrix, noise: float, own: float) -> tuple[float, float]:
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


def _loss_by_lag(shares: _Matrix, noise: float, own: float) -> tuple[float, float]:
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
    means = np.stack([np.bincount(bins[part], more[part], minlength=size) for part in (odd, ~odd)])
    means = means / np.maximum(counts, 1)
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


def _variogram(products: _Matrix) -> NDArray[np.float64]:
    """Return by lag 0 to 3/4 n half the mean square difference of two rows, from their scalar products (n, n)."""
    n = len(products)
    square = np.diagonal(products)
    apart = 0.5 * (square[:, None] + square[None, :]) - products
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    return np.asarray((np.bincount(lag.ravel(), apart.ravel()) / np.bincount(lag.ravel()))[: int(0.75 * n) + 1])


def _return(variogram: NDArray[np.float64], n: int) -> tuple[float, int]:
    """Return the largest fall of the variogram from a smaller lag to one of 2 to n/2, and that lag."""
    before = np.maximum.accumulate(variogram)
    lags = np.arange(2, n // 2 + 1)
    falls = before[lags - 1] - variogram[lags]
    best = int(np.argmax(falls))
    return float(falls[best]), int(lags[best])


def _chance(products: _Matrix) -> tuple[float, float]:
    """Return the shares of shuffled orders of generations that come round as well, and that hold on as well."""
    n = len(products)
    random = np.random.default_rng(0)
    variogram = _variogram(products)
    fall = _return(variogram, n)[0]
    round_again, held = 1, 1
    for _ in range(PERMUTATIONS):
        order = random.permutation(n)
        shuffled = _variogram(products[np.ix_(order, order)])
        round_again += _return(shuffled, n)[0] >= fall
        held += shuffled[1] <= variogram[1]
    return round_again / (PERMUTATIONS + 1), held / (PERMUTATIONS + 1)


def _visits(changes: _Matrix, noise: float) -> float:
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


# ------------------------------------------------------------------------------------------------------ decisions


def _engaged(shares: _Matrix, games: int | None) -> Diagnosis:
    """Diagnose a matrix as if both sides had games to win."""
    n = len(shares)
    noise = _noise(shares, games)
    means = shares.mean(axis=1)
    luck = _champions_luck(means)
    gain, gain_errors = _gain(means, luck)
    loss, loss_errors = _loss(shares, noise, luck)
    changes, by_opponent = shares - shares.mean(axis=0), _interaction(shares)
    products = changes @ changes.T / n
    variogram, of_interaction = _variogram(products), _variogram(by_opponent @ by_opponent.T / n)
    fall, period = _return(variogram, n)
    swing = max(float(variogram.max()) - noise**2, 1e-9)
    swing_by_opponent = max(float(of_interaction.max()) - noise**2, 0.0) / swing
    values = _singular_values(by_opponent)
    intransitive = swing_by_opponent >= INTRANSITIVE and values[0] > 2.6 * _spectral_noise(values) * np.sqrt(n)
    visits = _visits(changes, noise)

    cycling = False
    if swing >= SMALLEST_SWING and (fall / swing >= RETURN or visits >= 2):
        if intransitive or (swing >= LARGE_SWING and fall / swing >= RETURN):
            cycling = True
        elif fall / swing >= RETURN or visits >= 3:
            round_again, held = _chance(products)
            cycling = (fall / swing >= RETURN and round_again <= CHANCE) or (visits >= 3 and held <= CHANCE)
    labels = set()
    progress = gain >= SMALLEST_CHANGE and gain_errors >= STANDARD_ERRORS + 12 / n
    if cycling:
        labels.add("cycling")
        if progress and np.corrcoef(means, np.arange(n))[0, 1] >= 0.8:
            labels.add("progress")
    else:
        if loss >= SMALLEST_LOSS and loss_errors >= LOSS_STANDARD_ERRORS:
            labels.add("forgetting")
        if progress and not ("forgetting" in labels and gain < KEPT * loss):
            labels.add("progress")
    return Diagnosis(
        labels=frozenset(labels or {"stagnation"}),
        text="",
        noise=noise,
        late_level=_late_level(shares),
        onset=None,
        gain=gain,
        gain_standard_errors=gain_errors,
        loss=loss,
        loss_standard_errors=loss_errors,
        swing=swing,
        swing_by_opponent=swing_by_opponent,
        period=period,
        comes_round=fall / swing,
        visits=visits,
    )


def _text(found: Diagnosis, n: int) -> str:
    """Say in one or two sentences what the labels mean in this run."""
    said = []
    if "progress" in found.labels:
        said.append(
            f"later champions win {found.gain:+.0%} of the games more than early ones against the same opponents"
        )
    if "cycling" in found.labels:
        every = f"about every {found.period} generations" if found.comes_round >= RETURN else "at irregular times"
        said.append(f"what champions win and lose comes round {every}")
    if "forgetting" in found.labels:
        said.append(f"late champions lose {found.loss:.0%} of the games that earlier ones won against the same opponents")
    if found.onset is not None:
        side = "wins" if found.late_level > 0.5 else "loses"
        when = "throughout" if found.onset == 0 else f"from generation {found.onset} (of {n}) on"
        said.append(f"{when} this side {side} nearly all games, so that selection has little to go by")
    if "stagnation" in found.labels:
        said.append("champions of different times do equally well against the same opponents")
    names = " and ".join(label for label in LABELS if label in found.labels)
    return f"{names.capitalize()}: {'; '.join(said)}."
