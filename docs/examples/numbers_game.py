"""A game of one's own: the numbers games of the co-evolution literature, played by decision trees.

In the numbers games (R. A. Watson and J. B. Pollack, "Coevolutionary dynamics in a minimal substrate", GECCO 2001) a
player is a few numbers, one in each dimension, and more is better. What makes them interesting is that players
never see the numbers, only who wins:

    compare-on-one: the dimension decides in which the two players differ most.
    intransitive: the dimension decides in which they differ least. Here a can beat b, b beat c, and c beat a.

Here a player is a tree that answers questions. A question belongs to a dimension and has a few bits, which are what
the tree can ask about; the number of a tree in a dimension is how many of its questions it answers rightly. In each
game only some of the questions are put, drawn by the game's seed. The right answers are known, so it is known what
the best trees do: they answer every question rightly, and nobody beats them.

    coevo evolve docs/examples/numbers.toml
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coevo.errors import InputError
from coevo.game import Played, Role
from coevo.tree import FunctionSet, Program

__all__ = ["NumbersGame", "lead", "make"]

_TERMINALS = ("say_zero", "say_one")


class NumbersGame:
    """Two teams of one tree each; see the module.

    Args:
        rule: "compare-on-one" or "intransitive".
        dimensions: how many numbers a player has.
        asked: the share of all questions that a game puts.
    """

    roles = (Role("red", 0), Role("blue", 1))
    counts = ("won", "lost", "right")

    def __init__(self, rule: str, dimensions: int, asked: float) -> None:
        self._rule, self._asked = rule, asked
        # One row a question: which dimension it belongs to, then its bits.
        self.questions = np.array(
            [
                (d, *bits)
                for d, bits in itertools.product(range(dimensions), itertools.product((0, 1), repeat=dimensions))
            ]
        )
        dimension = self.questions[:, 0]
        self.right = self.questions[np.arange(len(dimension)), 1 + dimension]  # in dimension d, bit d is the answer
        asks = [
            *(f"IF_dimension_is_{d}" for d in range(1, dimensions)),
            *(f"IF_bit_{b}_is_one" for b in range(dimensions)),
        ]
        self._functions = FunctionSet(tuple(asks), _TERMINALS)
        of_dimension = [dimension == d for d in range(1, dimensions)]
        # What is true in each question, by the number of the function: (questions, functions).
        self._true = np.stack([*of_dimension, *(self.questions[:, 1:].T == 1)], axis=1)

    def function_set(self, role: int) -> FunctionSet:  # noqa: ARG002 - both are made of the same
        """Return what trees are made of."""
        return self._functions

    def leaves(self, program: Program) -> NDArray[np.int64]:
        """Return (questions,) the leaf at which a tree answers each question."""
        found = []
        for true in self._true:
            node = 0
            while program.codes[node] >= 0:  # a function: the first branch is "yes", and begins at the next node
                node = node + 1 if true[program.codes[node]] else int(program.second[node])
            found.append(node)
        return np.array(found)

    def play(self, programs: Sequence[Program | None], seeds: NDArray[np.uint64]) -> Played:
        """Play one game a seed; see ``coevo.game.Game``."""
        leaves, right = [], []
        for program in programs:
            assert program is not None
            leaves.append(self.leaves(program))
            right.append(-1 - program.codes[leaves[-1]] == self.right)  # terminal k has the code -1 - k
        generators = [np.random.default_rng(int(seed)) for seed in seeds]
        asked = np.array([generator.random(len(self.right)) < self._asked for generator in generators])
        asked = asked.reshape(len(seeds), len(self.right))
        in_dimension = self.questions[:, :1] == np.arange(self.questions[:, 0].max() + 1)
        numbers = [(asked & correct).astype(np.int64) @ in_dimension for correct in right]  # (games, dimensions)
        winner = self._winner(numbers[0] - numbers[1])
        return Played(
            counts={
                "won": np.stack([winner == 0, winner == 1], axis=1).astype(np.int64),
                "lost": np.stack([winner == 1, winner == 0], axis=1).astype(np.int64),
                "right": np.stack([number.sum(axis=1) for number in numbers], axis=1),
            },
            winner=winner,
            leaf_steps=[
                np.bincount(leaf, asked.sum(axis=0), minlength=len(program.codes)).astype(np.int64)
                for leaf, program in zip(leaves, programs, strict=True)
                if program is not None
            ],
        )

    def _winner(self, difference: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return (games,) 0 or 1, -1 where the numbers are equal; ``difference``: (games, dimensions)."""
        size = np.abs(difference)
        if self._rule == "compare-on-one":
            decides = np.argmax(size, axis=1)
        else:
            decides = np.argmin(np.where(size == 0, np.iinfo(np.int64).max, size), axis=1)
        sign = np.sign(difference[np.arange(len(difference)), decides])
        return np.where(sign > 0, 0, np.where(sign < 0, 1, -1))


def make(table: Mapping[str, Any]) -> NumbersGame:
    """Return the game that the table ``[game]`` of a recipe describes; its ``kind`` has brought us here."""
    rule, dimensions, asked = table.get("rule", "compare-on-one"), table.get("dimensions", 2), table.get("asked", 0.5)
    unknown = set(table) - {"rule", "dimensions", "asked"}
    if unknown or rule not in ("compare-on-one", "intransitive") or dimensions not in range(1, 7):
        raise InputError(f"game: expected rule, dimensions (1 to 6) and asked, got {dict(table)}")
    return NumbersGame(rule, dimensions, float(asked))


def lead(
    measures: Mapping[str, NDArray[np.int64]],
    *,
    games: int,
    generation: int,  # noqa: ARG001 - it is the same in every generation
    generations: int,  # noqa: ARG001
) -> NDArray[np.float64]:
    """Return the fitness (individuals,), smaller is better: games lost less games won, as a share of all."""
    return (measures["lost"] - measures["won"]) / games
