"""How a tree of a run is used: its games are played again, step for step, and counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from coevo.errors import InputError
from coevo.evolution.grouping import Groups, groups_of, line_ups
from coevo.evolution.opponents import frozen_codes
from coevo.game import programs_of
from coevo.run import Run
from coevo.seeds import RunStream, game_seeds
from coevo.tree import FunctionSet, Tree, from_codes, simplify
from coevo.tree.draw import as_svg
from coevo.tree.fold import FOLD
from coevo.tree.rules import Rule, in_words, leaf_rules

__all__ = [
    "TreeUsage",
    "UsedTree",
    "champions_in_words",
    "group_trees",
    "last_generation",
    "merge_usage",
    "play_seeds",
    "seeds_of_group",
    "tree_usage",
    "used_tree",
    "without_unused",
]


@dataclass(frozen=True)
class TreeUsage:
    """What became of a tree in the games it was scored by.

    node_steps: (nodes,) int64, in how many steps each node was passed. skill_use: share of the steps by terminal.
    steps: decisions in all games; in soccer one a step.
    """

    node_steps: NDArray[np.int64]
    skill_use: dict[str, float]
    steps: int


@dataclass(frozen=True)
class UsedTree:
    """A tree of a run with what became of it in the games that it was scored by; a notebook shows its picture.

    Attributes:
        robot, generation, rank: which tree; rank 0 is the best of its generation.
        index: of it in its generation.
        tree: as it was bred.
        usage: what became of it.
        functions: what it is made of.
        games: how many it was scored by.
        fitness: its own.
        generation_fitness: (population,) float64, of all trees of its robot in its generation, best first.
        again: fitness and number of the games by which the last champions were chosen once more, if it is one.
    """

    robot: str
    generation: int
    rank: int
    tree: Tree
    usage: TreeUsage
    functions: FunctionSet
    games: int
    fitness: float
    generation_fitness: NDArray[np.float64]
    index: int = 0
    again: tuple[float, int] | None = None

    @cached_property
    def simplified(self) -> Tree:
        """The simplified tree, which does the same in every situation."""
        return simplify(self.tree, self.functions)

    @cached_property
    def simplified_steps(self) -> NDArray[np.int64]:
        """(nodes,) int64, how often each node of the simplified tree was passed."""
        return merge_usage(self.tree, self.usage.node_steps, self.simplified)

    @cached_property
    def rules(self) -> list[Rule]:
        """When each leaf of the simplified tree is reached, those that decided most first: all that the tree does."""
        return _most_used(leaf_rules(self.simplified, self.functions, self.simplified_steps))

    @cached_property
    def in_use(self) -> tuple[Tree, NDArray[np.int64]]:
        """The tree without what was never used, simplified again, and its steps: what it did in its games, no more."""
        kept, steps = without_unused(self.simplified, self.simplified_steps)
        smaller = simplify(kept, self.functions)
        return smaller, merge_usage(kept, steps, smaller)

    @cached_property
    def rules_in_use(self) -> list[Rule]:
        """The rules of ``in_use``: shorter than ``rules``, and true of the games that were played."""
        tree, steps = self.in_use
        return _most_used(leaf_rules(tree, self.functions, steps))

    @property
    def title(self) -> str:
        """Which tree it is, for headings."""
        return f"{self.robot}, generation {self.generation}, rank {self.rank}"

    def _repr_svg_(self) -> str:
        """Return the simplified tree as a picture, folded by use."""
        return self.picture(FOLD, simplified=True)

    def picture(self, fold: float | None, *, simplified: bool) -> str:
        """Return the tree, or the simplified one, as an SVG picture; ``fold`` as of ``coevo.tree.draw.as_text``."""
        return as_svg(
            self.simplified if simplified else self.tree,
            self.simplified_steps if simplified else self.usage.node_steps,
            fold=fold,
            terminals=self.functions.terminals,
            title=f"{self.title}{', simplified' if simplified else ''}",
            descriptions=self.functions.descriptions,
        )


def _most_used(rules: list[Rule]) -> list[Rule]:
    return sorted(rules, key=lambda rule: -(rule.steps or 0))


def last_generation(run: Run) -> int:
    """Return the number of the last finished generation; 0 if there is none."""
    return max(run.finished - 1, 0)


def champions_in_words(run: Run, generation: int) -> str:
    """Return what the champions of a generation are called."""
    last = generation == run.config.gp.generations - 1 and run.champions() is not None
    return f"the champions of generation {generation}" if last else f"the best of generation {generation}"


def used_tree(run: Run, robot: str | None = None, generation: int | None = None, rank: int | None = None) -> UsedTree:
    """Play the games of a tree again and return it with its use.

    Args:
        run: a run folder.
        robot: whose tree; by default that of the first that evolves.
        generation: by default the last that is finished.
        rank: 0 is the best of the generation; by default its champion (``Run.champion``).

    Raises:
        InputError: there is no such robot, generation or rank.
    """
    robot = robot or next(iter(run.evolving.values()))
    generation = last_generation(run) if generation is None else generation
    found, place = run.champion(robot, generation) if rank is None else (generation, rank)
    tree, rows = run.tree(robot, found, place), run.record(found, robot)
    index = int(rows["index"].iloc[place])
    return UsedTree(
        robot,
        found,
        place,
        tree,
        tree_usage(run, found, robot, index),
        run.game.function_set(run.number_of(robot)),
        run.config.evaluation.games,
        float(rows["fitness"].iloc[place]),
        rows["fitness"].to_numpy(np.float64),
        index,
        _again(run, robot, found, index),
    )


def _again(run: Run, robot: str, generation: int, index: int) -> tuple[float, int] | None:
    """Return fitness and games of an individual when it was judged again, None if it is not the chosen champion."""
    table = run.champions()
    if table is None:
        return None
    row = table[table["robot"] == robot].iloc[0]
    chosen = (int(row["generation"]), int(row["index"])) == (generation, index)
    return (float(row["fitness_again"]), int(row["games"])) if chosen else None


def play_seeds(seed: int, games: int) -> NDArray[np.uint64]:
    """Return the seeds of games outside evolution."""
    return game_seeds(seed, RunStream.PLAY, count=games)


def _groups(run: Run, generation: int, group: int) -> Groups:
    if not 0 <= generation < run.finished:
        run.records(generation)  # says which there are
    groups = groups_of(run.config, run.game.roles, generation)
    if not 0 <= group < len(groups):
        raise InputError(f"generation {generation} of {run.path} has the groups 0 to {len(groups) - 1}, got {group}")
    return groups


def _line_ups(run: Run, generation: int, groups: Groups, numbers: Sequence[int]) -> list[list[Tree | None]]:
    """Return the trees that played in some groups."""

    @cache
    def best_of(role: int, earlier: int) -> NDArray[np.uint8]:
        return np.asarray(run.record(earlier, run.evolving[role])["tree"].iloc[0], np.uint8)

    game, codes = run.game, {record.role: record.codes for record in run.records(generation)}
    frozen = frozen_codes(run.config, game)
    return [
        [None if one is None else from_codes(one, game.function_set(role)) for role, one in enumerate(team)]
        for team in line_ups(groups, codes, best_of, frozen, numbers)
    ]


def group_trees(run: Run, generation: int, group: int) -> list[Tree | None]:
    """Return the trees that played each other in a group, one for each role, None for roles without one.

    Raises:
        InputError: there is no such generation or group.
    """
    return _line_ups(run, generation, _groups(run, generation, group), [group])[0]


def seeds_of_group(run: Run, generation: int, group: int, game: int | None = None) -> NDArray[np.uint64]:
    """Return the seeds of the games of a group, or of one of them.

    Raises:
        InputError: there is no such generation, group or game.
    """
    groups = _groups(run, generation, group)
    seeds = groups.seeds(run.config.seed, generation, group)
    if game is None:
        return seeds
    if not 0 <= game < groups.games:
        raise InputError(f"each group of {run.path} played the games 0 to {groups.games - 1}, got {game}")
    return seeds[game : game + 1]


def tree_usage(run: Run, generation: int, robot: str, index: int) -> TreeUsage:
    """Play all games again that count for an individual, and count where its tree went.

    Args:
        run: with this generation.
        generation, robot, index: who; the index is that of individuals.parquet, not a rank.
    """
    game, number = run.game_of(generation), run.number_of(robot)
    groups = groups_of(run.config, game.roles, generation)
    own = groups.of(number)[index].tolist()
    leaf_steps: NDArray[np.int64] | None = None
    for group, trees in zip(own, _line_ups(run, generation, groups, own), strict=True):
        programs = programs_of(game, trees)
        counted = game.play(programs, groups.seeds(run.config.seed, generation, group)).leaf_steps[number]
        leaf_steps = counted if leaf_steps is None else leaf_steps + counted
    program = programs[number]
    assert leaf_steps is not None
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

    Raises:
        InputError: steps came to a leaf that cannot be reached, as the function set has it.
    """
    steps = np.zeros(smaller.nodes, np.int64)
    for leaf, answers in _paths(tree):
        if node_steps[leaf]:
            node = 0
            while smaller.second[node]:
                answer = answers.get(smaller.names[node])
                if answer is None:
                    raise InputError(
                        f"a game came to a leaf where {in_words([*answers.items()])}, which the situations of its"
                        " function set exclude; mend these situations"
                    )
                node = node + 1 if answer else smaller.second[node]
            steps[node] += node_steps[leaf]
    return _add_up(steps, smaller.second)


def without_unused(tree: Tree, steps: NDArray[np.int64]) -> tuple[Tree, NDArray[np.int64]]:
    """Return a tree without its unused branches, and the steps of what is left; all of it if nothing was counted.

    A question that was always answered alike gives way to the branch that was taken.
    """
    kept: list[int] = []
    stack = [0]
    while stack:
        node = stack.pop()
        while tree.second[node] and steps[node]:
            first, second = node + 1, tree.second[node]
            if steps[first] and steps[second]:
                break
            node = first if steps[first] else second
        kept.append(node)
        if tree.second[node]:
            stack += [tree.second[node], node + 1]
    return Tree(tuple(tree.names[node] for node in kept)), steps[kept]


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
