"""What a game is to everything that breeds, records and shows: roles that choose by trees, and what is counted.

Evolution, the run folder and analysis know a game by this file alone. Soccer is one; a recipe names another by
``game.kind = "module:factory"``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from coevo.errors import InputError
from coevo.records import CHOSE
from coevo.tree import FunctionSet, Program, Tree, compile_program, tree_codes

__all__ = ["Game", "Played", "Role", "check_game", "check_played", "programs_of", "teams_of", "terminals_of"]

_NAME = re.compile(r"[A-Za-z]\w{0,31}", re.ASCII)
# Columns of a run folder that are not counts of a game, as those are not that begin with CHOSE.
_TAKEN = {"generation", "robot", "index", "group", "fitness", "depth", "nodes", "tree", "operator"} | {
    *("parent_1", "parent_2", "rounds", "fitness_best", "fitness_mean", "fitness_worst"),
    *(f"{size}_{which}" for size in ("depth", "nodes") for which in ("best", "mean", "worst")),
}


class Role(NamedTuple):
    """Someone who plays.

    name: letters, digits and _; the column ``robot`` of a run folder.
    team: who wins together; numbers from 0.
    evolves: whether trees are bred for it; else it does what the game says.
    """

    name: str
    team: int
    evolves: bool = True


@dataclass(frozen=True)
class Played:
    """What happened in a set of games.

    Attributes:
        counts: for each name of ``Game.counts`` (games, roles) int64.
        winner: (games,) int64, the team that won, -1 if none did.
        leaf_steps: per role (nodes,) int64, how often each node of its tree was the leaf that decided; (0,) for a role
            without a tree.
    """

    counts: Mapping[str, NDArray[np.int64]]
    winner: NDArray[np.int64]
    leaf_steps: Sequence[NDArray[np.int64]]


class Game(Protocol):
    """A game between roles; each thread makes one of its own."""

    @property
    def roles(self) -> tuple[Role, ...]:
        """Who plays; at least one evolves."""

    @property
    def counts(self) -> tuple[str, ...]:
        """What is counted of each role in each game; these are columns of a run folder and what fitness is made of."""

    def function_set(self, role: int) -> FunctionSet:
        """Return what the trees of a role are made of."""

    def play(self, programs: Sequence[Program | None], seeds: NDArray[np.uint64]) -> Played:
        """Play one game a seed.

        Args:
            programs: for each role that evolves its tree, None for the others.
            seeds: (games,) uint64; the same programs and seed are the same game, whatever was played before.
        """


def teams_of(game: Game) -> tuple[int, ...]:
    """Return the numbers of the teams, ascending."""
    return tuple(sorted({role.team for role in game.roles}))


def terminals_of(game: Game) -> tuple[str, ...]:
    """Return what the trees of any role that evolves can choose, each name once, in the order of the roles."""
    sets = [game.function_set(number) for number, role in enumerate(game.roles) if role.evolves]
    return tuple(dict.fromkeys(name for functions in sets for name in functions.terminals))


def programs_of(game: Game, trees: Sequence[Tree | None]) -> list[Program | None]:
    """Return the programs of trees, one for each role, None for roles that have no tree.

    Raises:
        InputError: a tree asks or chooses what its role does not know.
    """
    programs: list[Program | None] = [None] * len(trees)
    for role, tree in enumerate(trees):
        if tree is not None:
            functions = game.function_set(role)
            programs[role] = compile_program(tree_codes(tree, functions), functions)
    return programs


def check_game(game: Game, what: str) -> None:
    """Refuse a game that breaks the contract; its play is checked by ``check_played``.

    Raises:
        InputError: says what was expected.
    """
    for part in ("roles", "counts", "function_set", "play"):
        if not hasattr(game, part):
            raise InputError(f"{what}: a game has roles, counts, function_set and play; this one has no {part}")
    names = [role.name for role in game.roles]
    for kind, given in (("role", names), ("count", game.counts)):
        wrong = next((name for name in given if not _NAME.fullmatch(name) or given.count(name) > 1), None)
        if wrong is not None:
            raise InputError(f"{what}: expected names of letters, digits and _, each once; got the {kind} {wrong!r}")
    taken = sorted(name for name in game.counts if name in _TAKEN or name.startswith(CHOSE))
    if taken:
        raise InputError(f"{what}: a run folder has a column {taken[0]!r} of its own; count under another name")
    if not any(role.evolves for role in game.roles):
        raise InputError(f"{what}: at least one role must evolve")
    for number, role in enumerate(game.roles):
        if role.team < 0:
            raise InputError(f"{what}: expected the team of {role.name} to be 0 or more, got {role.team}")
        if role.evolves and not isinstance(game.function_set(number), FunctionSet):
            raise InputError(f"{what}: function_set({number}) must return a coevo.tree.FunctionSet")


def check_played(game: Game, played: Played, programs: Sequence[Program | None], games: int) -> None:
    """Refuse results that are not what the contract promises.

    Raises:
        InputError: says what was expected.
    """
    expected = (games, len(game.roles))
    if set(played.counts) != set(game.counts):
        raise InputError(f"the game promises to count {', '.join(game.counts)}; it counted {', '.join(played.counts)}")
    for name, values in played.counts.items():
        if np.shape(values) != expected or values.dtype.kind not in "iu":
            raise InputError(f"the game must count {name!r} as integers of shape {expected}")
    if np.shape(played.winner) != (games,):
        raise InputError(f"the game must return the winner of each of {games} games, got {np.shape(played.winner)}")
    sizes = [0 if program is None else len(program.codes) for program in programs]
    if [len(steps) for steps in played.leaf_steps] != sizes:
        raise InputError(f"the game must return leaf_steps for trees of {sizes} nodes")
