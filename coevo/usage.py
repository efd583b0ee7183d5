"""How a tree of a run is used: its games are played again, step for step, and counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coevo.errors import InputError
from coevo.evolution.evaluation import group_seeds
from coevo.game import programs_of
from coevo.run import Run
from coevo.seeds import RunStream, game_seeds
from coevo.tree import Tree, from_codes

__all__ = ["TreeUsage", "group_trees", "merge_usage", "play_seeds", "seeds_of_group", "tree_usage"]


@dataclass(frozen=True)
class TreeUsage:
    """What became of a tree in the games it was scored by.

    node_steps: (nodes,) int64, in how many steps each node was passed. skill_use: share of the steps by terminal.
    steps: decisions in all games; in soccer one a step.
    """

    node_steps: NDArray[np.int64]
    skill_use: dict[str, float]
    steps: int


def play_seeds(seed: int, games: int) -> NDArray[np.uint64]:
    """Return the seeds of games outside evolution."""
    return game_seeds(seed, RunStream.PLAY, count=games)


def group_trees(run: Run, generation: int, group: int) -> list[Tree | None]:
    """Return the trees that played each other in a group, one for each role, None for roles without one.

    Raises:
        InputError: there is no such generation or group.
    """
    trees: list[Tree | None] = [None] * len(run.game.roles)
    for role, name in run.evolving.items():
        rows = run.record(generation, name)
        member = rows[rows["group"] == group]
        if member.empty:
            last = int(rows["group"].max())
            raise InputError(f"generation {generation} of {run.path} has the groups 0 to {last}, got {group}")
        trees[role] = from_codes(np.asarray(member.iloc[0]["tree"], np.uint8), run.game.function_set(role))
    return trees


def seeds_of_group(run: Run, generation: int, group: int, game: int | None = None) -> NDArray[np.uint64]:
    """Return the seeds of the games of a group, or of one of them.

    Raises:
        InputError: there is no such game.
    """
    games = run.config.evaluation.games
    seeds = group_seeds(run.config.seed, generation, group, games)
    if game is None:
        return seeds
    if not 0 <= game < games:
        raise InputError(f"each group of {run.path} played the games 0 to {games - 1}, got {game}")
    return seeds[game : game + 1]


def tree_usage(run: Run, generation: int, group: int, robot: str) -> TreeUsage:
    """Play the games of a group again and count where the tree of ``robot`` went."""
    game, number = run.game, run.number_of(robot)
    programs = programs_of(game, group_trees(run, generation, group))
    seeds = seeds_of_group(run, generation, group)
    leaf_steps, program = game.play(programs, seeds).leaf_steps[number], programs[number]
    assert program is not None
    steps = int(leaf_steps.sum())
    names = game.function_set(number).terminals
    use = {
        name: float(leaf_steps[program.codes == -1 - k].sum()) / steps if steps else 0.0 for k, name in enumerate(names)
    }
    return TreeUsage(_add_up(leaf_steps, program.second), use, steps)


def _add_up(leaf_steps: NDArray[np.int64], second: Sequence[int] | NDArray[np.int32]) -> NDArray[np.int64]:
    """Give each IF the steps of both its branches."""
    steps = leaf_steps.copy()
    for node in range(len(steps) - 1, -1, -1):
        if second[node]:
            steps[node] = steps[node + 1] + steps[second[node]]
    return steps


def merge_usage(tree: Tree, node_steps: NDArray[np.int64], smaller: Tree) -> NDArray[np.int64]:
    """Return the steps of each node of a simplified tree, from those of the tree it was made of.

    Each leaf of ``tree`` sends its steps down ``smaller`` along conditions that it fulfilled itself.
    """
    steps = np.zeros(smaller.nodes, np.int64)
    for leaf, answers in _paths(tree):
        if node_steps[leaf]:
            node = 0
            while smaller.second[node]:
                node = node + 1 if answers[smaller.names[node]] else smaller.second[node]
            steps[node] += node_steps[leaf]
    return _add_up(steps, smaller.second)


def _paths(tree: Tree) -> list[tuple[int, dict[str, bool]]]:
    """Return each leaf with the answers to the conditions above it."""
    found: list[tuple[int, dict[str, bool]]] = []
    stack: list[tuple[int, dict[str, bool]]] = [(0, {})]
    while stack:
        node, answers = stack.pop()
        if tree.second[node]:
            stack.append((node + 1, {**answers, tree.names[node]: True}))
            stack.append((tree.second[node], {**answers, tree.names[node]: False}))
        else:
            found.append((node, answers))
    return found
