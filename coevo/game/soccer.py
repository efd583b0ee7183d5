"""Soccer as a game of the contract: robots that see choose among learned skills."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from coevo.config import RunSettings
from coevo.game.arena import Arena, Outcome
from coevo.game.contract import Played, Role
from coevo.game.functions import function_sets, given_trees
from coevo.tree import FunctionSet, Program, Tree

__all__ = ["SoccerGame"]


class SoccerGame:
    """Games of soccer of one setting; see ``coevo.game.contract.Game``.

    Args:
        settings: the experiment.

    Example:
        >>> from coevo.game import SoccerGame
        >>> from coevo.recipes import read_experiment
        >>> from coevo.seeds import RunStream, game_seeds
        >>> from coevo.tree import compile_program, parse, tree_codes
        >>> game = SoccerGame(read_experiment("two-learners"))
        >>> sets = [game.function_set(role) for role in range(2)]
        >>> trees = [parse("IF_ball_is_lost(search, pass)"), parse("shoot")]
        >>> programs = [compile_program(tree_codes(tree, one), one) for tree, one in zip(trees, sets, strict=True)]
        >>> played = game.play(programs, game_seeds(1, RunStream.PLAY, count=4))
        >>> played.counts["goals"].shape  # games, robots
        (4, 2)
        >>> bool((played.winner >= 0).sum() == (played.counts["goals"] + played.counts["lost"]).max(axis=1).sum())
        True
    """

    counts = ("goals", "lost", "kicks", "collisions", "steps", "passes", "own_goals")

    def __init__(self, settings: RunSettings) -> None:
        self.settings = settings
        self.roles = tuple(
            Role(f"r{number}", player.team, player.control == "evolve")
            for number, player in enumerate(settings.players)
        )
        self._teams = np.array([role.team for role in self.roles], np.int64)

    @cached_property
    def arena(self) -> Arena:
        """The world that the games are played in, made when it is first needed."""
        return Arena(self.settings)

    @cached_property
    def _functions(self) -> tuple[FunctionSet, ...]:
        return function_sets(self.settings)

    def function_set(self, role: int) -> FunctionSet:
        """Return what the trees of a robot are made of."""
        return self._functions[role]

    def trees_of(self, trees: Sequence[Tree | None]) -> list[Tree | None]:
        """Return the trees that everybody plays by: those of the robots that evolve, and those that settings give."""
        return [own or given for own, given in zip(trees, given_trees(self.settings), strict=True)]

    def play(self, programs: Sequence[Program | None], seeds: NDArray[np.uint64]) -> Played:
        """Play one game a seed; see ``coevo.game.contract.Game`` and ``Arena.play``."""
        return self.played(self.arena.play(programs, seeds))

    def played(self, outcome: Outcome) -> Played:
        """Return what an outcome means to each robot: goals of its team, goals of any other, and what it did itself."""
        scorer = outcome.scorer[:, None]
        counts = {
            "goals": (scorer == self._teams).astype(np.int64),
            "lost": ((scorer >= 0) & (scorer != self._teams)).astype(np.int64),
            "kicks": outcome.kicks,
            "collisions": outcome.collisions,
            "steps": np.repeat(outcome.steps[:, None], len(self.roles), axis=1),
            "passes": outcome.passes,
            "own_goals": outcome.own_goals,
        }
        none = np.zeros(0, np.int64)  # a tree that is given for good is nobody's to ask about
        leaves = [s if role.evolves else none for s, role in zip(outcome.leaf_steps, self.roles, strict=True)]
        return Played(counts, outcome.scorer, leaves)
