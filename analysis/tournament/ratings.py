"""Ratings of champions from a tournament, with their uncertainty: the model of Bradley and Terry, by statsmodels.

The logarithm of the odds that i wins against j is the difference of their ratings (R. A. Bradley and M. E. Terry, "Rank
analysis of incomplete block designs", Biometrika 39, 1952); on the scale of chess 400 points are odds of 10 to 1. A
game that nobody wins counts as half a win for each. One rating a champion cannot say that a beats b, b beats c and c
beats a: where a tournament cycles, ratings mislead, and ``misfit`` tells so.
"""

from __future__ import annotations

import importlib.util
import warnings
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.tournament.play import Tournament
from coevo.errors import InputError
from coevo.statistics import LEVEL

__all__ = ["Ratings", "can_rate", "rate"]

_POINTS = 400.0 / np.log(10.0)
_MISFIT = 1.5  # above it one number a champion is too few
_PRIOR_GAMES = 1.0  # each champion's draws against an average one: who always wins has a finite rating


@dataclass(frozen=True)
class Ratings:
    """What champions are worth.

    Attributes:
        table: a row a champion: ``team``, ``generation``, ``rating``, ``low``, ``high`` (95 % interval). The mean over
            each team is 0, as only champions of one side have met the same opponents.
        misfit: Pearson's chi-square a degree of freedom: about 1 or less if one number a champion is enough (less where
            many games are drawn), more where results depend on who meets whom, as in cycles.
    """

    table: pd.DataFrame
    misfit: float

    @property
    def mislead(self) -> bool:
        """Whether results depend on who meets whom."""
        return self.misfit > _MISFIT


def can_rate() -> bool:
    """Return whether what ratings need is installed."""
    return importlib.util.find_spec("statsmodels") is not None


def _outcomes(tournament: Tournament) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the design (pairs, champions) and (pairs, 2) points won and lost."""
    n, teams = len(tournament.generations), len(tournament.teams)
    rows, points = [], []
    for side in range(teams if teams > 2 else 1):
        won = tournament.share(side) * tournament.games
        lost = tournament.lost(side) * tournament.games
        drawn = tournament.games - won - lost
        for i in range(n):
            for j in range(n):
                row = np.zeros(teams * n)
                row[side * n + i] = 1.0
                for other in range(teams):
                    if other != side:
                        row[other * n + j] -= 1.0 / (teams - 1)
                rows.append(row)
                points.append([won[i, j] + 0.5 * drawn[i, j], lost[i, j] + 0.5 * drawn[i, j]])
    return np.array(rows), np.array(points)


def rate(tournament: Tournament) -> Ratings:
    """Return the ratings of all champions of a finished tournament of at least two teams.

    Raises:
        InputError: there is one team alone, or statsmodels is not installed.
    """
    try:
        import statsmodels.api as sm
        from statsmodels.tools.sm_exceptions import PerfectSeparationWarning
    except ImportError:
        raise InputError("ratings need statsmodels; install it with: pip install 'coevo[report]'") from None
    from scipy import stats

    teams, n = len(tournament.teams), len(tournament.generations)
    if teams < 2:
        raise InputError("one team alone has nobody to be rated against; its share of games won says it all")
    design, points = _outcomes(tournament)
    prior = np.full((teams * n, 2), 0.5 * _PRIOR_GAMES)
    model = sm.GLM(np.vstack([points, prior]), np.vstack([design, np.eye(teams * n)]), family=sm.families.Binomial())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PerfectSeparationWarning)  # the prior keeps all ratings finite
        fit = model.fit()
    mean = np.asarray(fit.params).reshape(teams, n)
    centre = np.eye(teams * n) - np.kron(np.eye(teams), np.full((n, n), 1.0 / n))  # each team's mean is 0
    error = np.sqrt(np.diag(centre @ np.asarray(fit.cov_params()) @ centre.T)).reshape(teams, n)
    half = float(stats.norm.ppf(0.5 + 0.5 * LEVEL)) * error
    rating = mean - mean.mean(axis=1, keepdims=True)
    table = pd.DataFrame(
        {
            "team": np.repeat(tournament.teams, n),
            "generation": np.tile(tournament.generations, teams),
            "rating": _POINTS * rating.ravel(),
            "low": _POINTS * (rating - half).ravel(),
            "high": _POINTS * (rating + half).ravel(),
        }
    )
    free = len(points) - np.linalg.matrix_rank(design)
    expected = np.asarray(fit.fittedvalues)[: len(points)]
    total = points.sum(axis=1)
    chi = float(((points[:, 0] - total * expected) ** 2 / (total * expected * (1.0 - expected))).sum())
    return Ratings(table, chi / max(1, free))
