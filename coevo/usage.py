"""How a tree of a run is used: its games are played again, step for step, and counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coevo.evolution.evaluation import group_seeds
from coevo.run import Run
from coevo.seeds import RunStream, game_seeds
from coevo.tree import Program, Tree, compile_program

__all__ = ["TreeUsage", "merge_usage", "play_seeds", "tree_usage"]


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


def tree_usage(run: Run, generation: int, group: int, robot: str) -> TreeUsage:
    """Play the games of a group again and count where the tree of ``robot`` went."""
    settings, game = run.config, run.game
    programs: list[Program | None] = [None] * len(game.roles)
    for role, name in run.evolving.items():
        rows = run.record(generation, name)
        member = rows[rows["group"] == group].iloc[0]
        programs[role] = compile_program(np.asarray(member["tree"], np.uint8), game.function_set(role))
    seeds = group_seeds(settings.seed, generation, group, settings.evaluation.games)
    number = run.number_of(robot)
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
