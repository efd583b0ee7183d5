"""How often intervals over runs hold the true value: simulated sets of runs, of many kinds of distribution.

The methods beside the one that is used are here to compare with; see docs/decisions/0010-intervals-over-runs.md.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import click
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from coevo.console import Progress, output_options, show, table
from coevo.statistics import LEVEL, bootstrap_interval, probability_of_improvement

__all__ = ["DISTRIBUTIONS", "METHODS", "coverage", "covered", "improvement_covered", "truth"]

Draw = Callable[[Generator, tuple[int, ...]], NDArray[np.float64]]
Bounds = tuple[NDArray[np.float64], NDArray[np.float64]]


def _humps(share: float, apart: float, random: Generator, shape: tuple[int, ...]) -> NDArray[np.float64]:
    return random.standard_normal(shape) + apart * (random.random(shape) >= share)


# What measures of runs look like: symmetric, skewed, bounded shares, counts with ties, runs of two kinds.
DISTRIBUTIONS: dict[str, Draw] = {
    "normal": lambda random, shape: random.standard_normal(shape),
    "uniform": lambda random, shape: random.random(shape),
    "exponential": lambda random, shape: random.exponential(size=shape),
    "lognormal": lambda random, shape: random.lognormal(size=shape),
    "Student, 3 degrees": lambda random, shape: random.standard_t(3, shape),
    "beta 2, 5": lambda random, shape: random.beta(2, 5, shape),
    "beta 1/2, 1/2": lambda random, shape: random.beta(0.5, 0.5, shape),
    "goals, 30 % of 20": lambda random, shape: random.binomial(20, 0.3, shape).astype(float),
    "goals, 90 % of 20": lambda random, shape: random.binomial(20, 0.9, shape).astype(float),
    "goals, 97 % of 20": lambda random, shape: random.binomial(20, 0.97, shape).astype(float),
    "Poisson, 3": lambda random, shape: random.poisson(3, shape).astype(float),
    "two humps, 50 %": partial(_humps, 0.5, 8.0),
    "two humps, 80 %": partial(_humps, 0.8, 6.0),
}
_RESAMPLES = 1000  # of the methods to compare with
_AT_ONCE = 500  # sets whose resamples are held in memory together
_TRUTH = 1_000_000  # draws that the true value is taken from
_ROUNDING = 1e-9


@cache
def truth(name: str, estimator: str) -> float:
    """Return the mean of a distribution, or that of its middle half, from many draws."""
    drawn = np.sort(DISTRIBUTIONS[name](np.random.default_rng(0), (_TRUTH,)))
    return float(drawn.mean() if estimator == "mean" else drawn[_TRUTH // 4 : -_TRUTH // 4].mean())


class _Sets:
    """Sets of runs (sets, runs), each in order, and what the methods need of them."""

    def __init__(self, values: NDArray[np.float64], estimator: str, random: Generator) -> None:
        self.values = np.sort(values, axis=1)
        self.runs = values.shape[1]
        self.cut = int(0.25 * self.runs) if estimator == "iqm" else 0
        self.kept = self.runs - 2 * self.cut
        self.middle = self.values[:, self.cut : self.runs - self.cut].mean(axis=1)
        self.error = self._error(self.values)
        chosen = np.sort(random.integers(0, self.runs, (_RESAMPLES, self.runs)), axis=1)
        resampled = self.values[:, chosen]
        self.resampled = resampled[:, :, self.cut : self.runs - self.cut].mean(axis=2)
        self.resampled_error = self._error(resampled)

    def _error(self, ordered: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the winsorised standard error of a trimmed mean (Tukey and McLaughlin 1963), over the last axis."""
        least, most = ordered[..., [self.cut]], ordered[..., [self.runs - self.cut - 1]]
        spread = np.clip(ordered, least, most).var(axis=-1, ddof=1) * (self.runs - 1)
        error: NDArray[np.float64] = np.sqrt(spread / (self.kept * (self.kept - 1)))
        return error


def _percentile(sets: _Sets) -> Bounds:
    low, high = np.quantile(sets.resampled, [0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL], axis=1)
    return low, high


def _basic(sets: _Sets) -> Bounds:
    low, high = _percentile(sets)
    return 2.0 * sets.middle - high, 2.0 * sets.middle - low


def _bca(sets: _Sets) -> Bounds:
    from scipy import special

    cut = int(0.25 * (sets.runs - 1)) if sets.cut else 0
    left = [np.delete(sets.values, run, axis=1) for run in range(sets.runs)]
    influence = -np.stack([one[:, cut : sets.runs - 1 - cut].mean(axis=1) for one in left], axis=1)
    influence -= influence.mean(axis=1, keepdims=True)
    size = (influence**2).sum(axis=1) ** 1.5
    skew = np.divide((influence**3).sum(axis=1), 6.0 * size, out=np.zeros_like(size), where=size > 0.0)
    beside = sets.middle[:, None]
    below = (sets.resampled < beside).mean(axis=1) + 0.5 * (sets.resampled == beside).mean(axis=1)
    bias = special.ndtri(np.clip(below, 1.0 / _RESAMPLES, 1.0 - 1.0 / _RESAMPLES))
    ordered = np.sort(sets.resampled, axis=1)

    def end(level: float) -> NDArray[np.float64]:
        z = bias + special.ndtri(level)
        place = np.rint(special.ndtr(bias + z / (1.0 - skew * z)) * (_RESAMPLES - 1)).astype(int)
        found: NDArray[np.float64] = np.take_along_axis(ordered, place[:, None], axis=1)[:, 0]
        return found

    return end(0.5 - 0.5 * LEVEL), end(0.5 + 0.5 * LEVEL)


def _studentised(sets: _Sets) -> Bounds:
    away = np.abs(sets.resampled - sets.middle[:, None])
    # Of a resample without spread the ratio has no bound, unless it is the estimate itself.
    ratios = np.divide(
        away, sets.resampled_error, out=np.where(away > _ROUNDING, np.inf, 0.0), where=sets.resampled_error > _ROUNDING
    )
    reach = np.quantile(ratios, LEVEL, axis=1, method="higher")
    half = np.multiply(reach, sets.error, out=np.zeros_like(reach), where=sets.error > 0.0)
    return sets.middle - half, sets.middle + half


def _tukey_mclaughlin(sets: _Sets) -> Bounds:
    from scipy import stats

    half = stats.t.ppf(0.5 + 0.5 * LEVEL, sets.kept - 1) * sets.error
    return sets.middle - half, sets.middle + half


METHODS: dict[str, Callable[[_Sets], Bounds]] = {
    "percentile": _percentile,
    "basic": _basic,
    "BCa": _bca,
    "bootstrap-t": _studentised,
    "Tukey-McLaughlin": _tukey_mclaughlin,
}


def covered(
    name: str, *, runs: int, sets: int, estimator: str, seed: int = 1, compare: bool = False
) -> dict[str, float]:
    """Return the share of simulated sets whose interval holds the true value, by method.

    Args:
        name: of ``DISTRIBUTIONS``. runs: in a set. sets: how many are simulated.
        estimator: of ``coevo.statistics.ESTIMATORS``.
        seed: of the simulation.
        compare: whether other methods are tried too; "used" is what ``bootstrap_interval`` does.
    """
    true, random = truth(name, estimator), np.random.default_rng([seed, runs])
    drawn = DISTRIBUTIONS[name](random, (sets, runs))
    _, low, high = bootstrap_interval(drawn.T, estimator)
    found = {"used": _share(true, low, high)}
    if compare:
        parts = [_Sets(part, estimator, random) for part in np.array_split(drawn, -(-sets // _AT_ONCE))]
        for method, interval in METHODS.items():
            low, high = (np.concatenate(ends) for ends in zip(*map(interval, parts), strict=True))
            found[method] = _share(true, low, high)
    return found


def _share(true: float, low: NDArray[np.float64], high: NDArray[np.float64]) -> float:
    return float(((low <= true + _ROUNDING) & (true <= high + _ROUNDING)).mean())


def improvement_covered(shift: float, *, runs: int, sets: int, seed: int = 1) -> float:
    """Return how often the interval of ``probability_of_improvement`` holds it, for normal groups a shift apart.

    Args:
        shift: in standard deviations. runs: in each group. sets: pairs of groups. seed: of the simulation.
    """
    from scipy import special

    true, random = float(special.ndtr(shift / np.sqrt(2.0))), np.random.default_rng([seed, runs])
    pairs = random.standard_normal((sets, 2, runs))
    intervals = [probability_of_improvement(first + shift, second) for first, second in pairs]
    return float(np.mean([low <= true <= high for _, low, high in intervals]))


@click.command()
@click.option("--sets", type=click.IntRange(min=1), default=4000, show_default=True, help="Simulated sets of a cell.")
@click.option("--runs", "sizes", type=click.IntRange(min=2), multiple=True, help="Runs in a set; by default 2 to 30.")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True)
@output_options
def coverage(*, sets: int, sizes: tuple[int, ...], seed: int, as_json: bool, quiet: bool) -> None:
    """Say how often 95 % intervals over runs hold the true value, by simulation.

    \b
    Example: coevo reproduce coverage
             coevo reproduce coverage --sets 500 --runs 10
    """
    numbers = sizes or (2, 3, 4, 5, 6, 8, 10, 20, 30)
    compared = 10 if 10 in numbers else max(numbers)
    with Progress(len(DISTRIBUTIONS), quiet=quiet) as progress:
        data = []
        for number, name in enumerate(DISTRIBUTIONS):
            data.append(_row(name, numbers, compared, sets, seed))
            progress.step(name, done=number + 1)
    shifts = {
        shift: {n: improvement_covered(shift, runs=n, sets=sets, seed=seed) for n in numbers} for shift in (0, 1, 2)
    }
    parts = [
        f"IQM, {compared} runs, by method:",
        _table(
            ["distribution", *data[0]["methods"]], [[one["distribution"], *one["methods"].values()] for one in data]
        ),
    ]
    for estimator, title in (("iqm", "IQM"), ("mean", "mean")):
        rows = [[one["distribution"], *one[estimator].values()] for one in data]
        parts += [f"\n{title}, the interval that is used, by runs:", _table(["distribution", *numbers], rows)]
    rows = [[f"normal, {shift} apart", *found.values()] for shift, found in shifts.items()]
    parts += ["\nProbability of improvement, by runs in each group:", _table(["groups", *numbers], rows)]
    told = {"sets": sets, "seed": seed, "intervals": data, "improvement": shifts}
    show(told, "\n".join(parts), as_json=as_json)


def _row(name: str, numbers: tuple[int, ...], compared: int, sets: int, seed: int) -> dict[str, Any]:
    row: dict[str, Any] = {"distribution": name}
    row["methods"] = covered(name, runs=compared, sets=sets, estimator="iqm", seed=seed, compare=True)
    for estimator in ("iqm", "mean"):
        shares = [covered(name, runs=n, sets=sets, estimator=estimator, seed=seed)["used"] for n in numbers]
        row[estimator] = dict(zip(numbers, shares, strict=True))
    return row


def _table(header: list[Any], rows: list[list[Any]]) -> str:
    cells = [[str(row[0]), *(f"{100.0 * share:.1f}" for share in row[1:])] for row in rows]
    return table([str(one) for one in header], cells)
