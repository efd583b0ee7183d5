"""Play games of a setting between given trees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from coevo.game import Outcome, SoccerGame, programs_of
from coevo.seeds import RunStream, game_seeds
from coevo.tree import Tree

__all__ = ["play", "unseen_seeds"]


def unseen_seeds(seed: int, games: int) -> NDArray[np.uint64]:
    """Return seeds of games that no evolution plays."""
    return game_seeds(seed, RunStream.UNSEEN, count=games)


def play(game: SoccerGame, trees: Sequence[Tree | None], *, games: int, seed: int) -> Outcome:
    """Play ``games`` unseen games; the same seed is the same games for every team.

    Example:
        >>> from analysis.games import play
        >>> from coevo.game import SoccerGame
        >>> from coevo.recipes import read_experiment
        >>> from coevo.tree import parse
        >>> game = SoccerGame(read_experiment("two-learners"))
        >>> both = [parse("IF_ball_is_lost(search, pass)"), parse("shoot")]
        >>> alone = [parse("search"), parse("search")]
        >>> play(game, both, games=40, seed=1).goals_of(0) > play(game, alone, games=40, seed=1).goals_of(0)
        True
    """
    return game.arena.play(programs_of(game, trees), unseen_seeds(seed, games))
