"""Tournaments as tidy tables."""

from __future__ import annotations

import numpy as np
import pandas as pd

from analysis.tournament.against import Against
from analysis.tournament.play import Tournament
from coevo.statistics import share_interval

__all__ = ["against_table", "master_table", "matrix_table", "side_name"]


def side_name(tournament: Tournament, side: int) -> str:
    """Return the robots of a side."""
    return ", ".join(tournament.robots[side])


def matrix_table(tournament: Tournament) -> pd.DataFrame:
    """Return a row a side and pair: ``side``, ``generation``, ``met``, ``share``, ``lost``.

    ``generation`` is that of the side, ``met`` the generation of whom it met, ``share`` and ``lost`` shares of games.
    """
    generations = np.array(tournament.generations)
    n = len(generations)
    frames = [
        pd.DataFrame(
            {
                "side": side_name(tournament, side),
                "generation": np.repeat(generations, n),
                "met": np.tile(generations, n),
                "share": tournament.share(side).ravel(),
                "lost": tournament.lost(side).ravel(),
            }
        )
        for side in range(len(tournament.teams))
    ]
    return pd.concat(frames, ignore_index=True)


def master_table(tournament: Tournament) -> pd.DataFrame:
    """Return the master tournament: a row a side and generation, its mean over all it met.

    Columns: ``side``, ``generation``, ``share``, ``low``, ``high``: the interval is that of its games, against just
    these opponents.
    """
    rows = []
    for side in range(len(tournament.teams)):
        for generation, shares in zip(tournament.generations, tournament.share(side), strict=True):
            games = len(shares) * tournament.games
            won = round(float(shares.sum()) * tournament.games)
            rows.append((side_name(tournament, side), generation, won / games, *share_interval(won, games)))
    return pd.DataFrame(rows, columns=["side", "generation", "share", "low", "high"])


def against_table(against: Against, sides: dict[int, str]) -> pd.DataFrame:
    """Return a row a side, generation and outsider, with the columns of ``master_table`` and ``outsider``.

    Args:
        against: what was played.
        sides: a name for each team.
    """
    rows = []
    for at, team in enumerate(against.teams):
        for i, generation in enumerate(against.generations):
            for k, outsider in enumerate(against.outsiders):
                wins = int(against.wins[at, i, k])
                if wins >= 0:
                    low, high = share_interval(wins, against.games)
                    rows.append((sides[team], generation, outsider, wins / against.games, low, high))
    return pd.DataFrame(rows, columns=["side", "generation", "outsider", "share", "low", "high"])
