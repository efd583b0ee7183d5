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
from numpy.typing import ArrayLike

from analysis._dynamics import (
    Matrix,
    champions_luck,
    chance_of,
    gain_of,
    interaction,
    largest_return,
    loss_of,
    noise_of,
    singular_values,
    spectral_noise,
    variogram_of,
    visits_of,
)
from coevo.errors import InputError

__all__ = ["LABELS", "MINIMUM_GENERATIONS", "Diagnosis", "diagnose"]

LABELS = ("progress", "cycling", "forgetting", "disengagement", "stagnation")
MINIMUM_GENERATIONS = 6

# What was chosen on the tuned families of analysis.calibration.dynamics; `coevo reproduce diagnosis` says what they do.
SATURATED = 0.04  # as many games are left to the weaker side at most
LATE = 0.25  # share of the generations, counted from the end, in which disengagement must show
SMALLEST_CHANGE = 0.06  # in the share of games won, for progress; less is luck or of no use
SURE_CHANGE = 0.03  # enough if it is beyond doubt: where most games are drawn, shares are small
BEYOND_DOUBT = 6.0  # standard errors
SMALLEST_LOSS = 0.05  # the same for forgetting; it is smaller, as some opponents may not be forgotten
STANDARD_ERRORS = 3.0  # by which a gain must stand out of the luck of champions
LOSS_STANDARD_ERRORS = 3.5  # the same of a loss, which is measured without bias
KEPT = 2.0  # with forgetting, the gain must be so many times the mean loss to be called progress
RETURN = 0.55  # share of the change that a cycle undoes when it comes round
EARLY_RETURN = 0.5  # the same within a third of the run, where a single rise and fall undoes little
SMALLEST_SWING = 0.005  # mean square of a cycle's swing: +-0.1 of a sine
INTRANSITIVE = 0.4  # share of the swing that depends on the opponent, from which it is not one ability that swings
LARGE_SWING = 0.04  # mean square beyond what luck of champions can be: +-0.28 of a sine
MIDDLE_SWING = 0.02  # from here on luck is rare, and shuffled generations need be less so
CHANCE = 0.01  # of shuffled generations that come round as well


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
        loss: of the share won at the best time, what is lost later against the same opponents (by time: mean over all
            opponents at the end; by lag: over opponents of one age; the clearer of both).
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

    Example:
        >>> import numpy as np
        >>> from analysis.progress import diagnose
        >>> ahead = np.subtract.outer(np.arange(30), np.arange(30))  # by how many generations
        >>> sorted(diagnose(1.0 / (1.0 + np.exp(-0.2 * ahead))).labels)
        ['progress']
        >>> sorted(diagnose(0.5 + 0.4 * np.sin(2.0 * np.pi * ahead / 10)).labels)
        ['cycling']
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


def _checked(wins: ArrayLike, games: int | None) -> Matrix:
    try:
        shares = np.array(wins, np.float64)
    except (TypeError, ValueError):
        raise InputError("wins must be a matrix of numbers, a row a generation; give an array of floats") from None
    if shares.ndim != 2 or shares.shape[0] != shares.shape[1]:
        raise InputError(
            f"wins has shape {shares.shape}, expected (generations, generations); "
            "take the same generations of both sides"
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
            f"wins goes from {shares.min():g} to {shares.max():g}, expected shares in 0..1; "
            "divide by the games of a pair"
        )
    if games is not None and games < 1:
        raise InputError(f"games is {games}, expected at least 1; leave it out if it is not known")
    return shares


# ----------------------------------------------------------------------------------------------------- saturation


def _late(n: int) -> int:
    return n - max(3, int(np.ceil(LATE * n)))


def _late_level(shares: Matrix) -> float:
    late = _late(len(shares))
    return float(shares[late:, late:].mean())


def _onset(shares: Matrix) -> int | None:
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


# ------------------------------------------------------------------------------------------------------ decisions


def _engaged(shares: Matrix, games: int | None) -> Diagnosis:
    """Diagnose a matrix as if both sides had games to win."""
    n = len(shares)
    noise = noise_of(shares, games)
    means = shares.mean(axis=1)
    luck = champions_luck(means)
    gain, gain_errors = gain_of(means, luck)
    loss, loss_errors, mean_loss = loss_of(shares, noise, luck)
    changes, by_opponent = shares - shares.mean(axis=0), interaction(shares)
    products = changes @ changes.T / n
    variogram, of_interaction = variogram_of(products), variogram_of(by_opponent @ by_opponent.T / n)
    fall, period = largest_return(variogram, n)
    swing = max(float(variogram.max()) - noise**2, 1e-9)
    swing_by_opponent = max(float(of_interaction.max()) - noise**2, 0.0) / swing
    values = singular_values(by_opponent)
    intransitive = swing_by_opponent >= INTRANSITIVE and values[0] > 2.6 * spectral_noise(values) * np.sqrt(n)
    visits = visits_of(changes, noise)

    comes_round = fall / swing
    regular = comes_round >= (RETURN if period > n / 3 else EARLY_RETURN)
    cycling = False
    if swing >= SMALLEST_SWING and (regular or visits >= 2):
        if intransitive or (swing >= LARGE_SWING and regular):
            cycling = True
        elif regular or visits >= 3:
            round_again, held = chance_of(products)
            enough = CHANCE if swing < MIDDLE_SWING else 5 * CHANCE
            cycling = (regular and round_again <= enough) or (visits >= 3 and held <= CHANCE)
    labels = set()
    progress = (gain >= SMALLEST_CHANGE and gain_errors >= STANDARD_ERRORS + 12 / n) or (
        gain >= SURE_CHANGE and gain_errors >= BEYOND_DOUBT + 12 / n
    )
    if cycling:
        labels.add("cycling")
        if progress and np.corrcoef(means, np.arange(n))[0, 1] >= 0.8:
            labels.add("progress")
    else:
        if loss >= SMALLEST_LOSS and loss_errors >= LOSS_STANDARD_ERRORS:
            labels.add("forgetting")
        if progress and not ("forgetting" in labels and gain < KEPT * mean_loss):
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
        comes_round=comes_round,
        visits=visits,
    )


def _text(found: Diagnosis, n: int) -> str:
    """Say in one or two sentences what the labels mean in this run."""
    said = []
    if "progress" in found.labels:
        said.append(
            f"later champions win {found.gain:.0%} more of the games against the same opponents than early ones"
        )
    if "cycling" in found.labels:
        every = f"about every {found.period} generations" if found.comes_round >= EARLY_RETURN else "at irregular times"
        said.append(f"what champions win and lose comes round {every}")
    if "forgetting" in found.labels:
        said.append(
            f"late champions lose {found.loss:.0%} of the games that earlier ones won against the same opponents"
        )
    if found.onset is not None:
        side = "wins nearly all games" if found.late_level > 0.5 else "wins hardly any game"
        when = "throughout" if found.onset == 0 else f"from generation {found.onset} (of {n}) on"
        said.append(f"{when} this side {side}, so that selection has little to go by")
    if "stagnation" in found.labels:
        said.append(
            f"no change that stands out from luck: later champions win {found.gain:+.0%} of the games against the same"
            " opponents"
        )
    names = " and ".join(label for label in LABELS if label in found.labels)
    return f"{names.capitalize()}: {'; '.join(said)}."
