"""A population of trees for one robot, and how the first is created by DEAP (Table 6.3)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from deap import base, gp
from deap.tools import crossover, mutation, selection
from numpy.typing import NDArray

from coevo.config import GPSettings
from coevo.game import Creation, DecisionTable, Game, creations
from coevo.records import OPERATORS, Origins
from coevo.seeds import RunStream, global_random, thread_random
from coevo.tree import FunctionSet, Tree, from_codes, tree_codes

__all__ = [
    "NEW",
    "Individual",
    "Origin",
    "Source",
    "codes_of",
    "created",
    "first_population",
    "individual_of",
    "origins_of",
    "parents_of",
    "random_teams",
]

for _module in (gp, crossover, mutation, selection):
    _module.random = thread_random  # DEAP draws from Python's global generator, which belongs to all threads


class _Fitness(base.Fitness):  # type: ignore[misc]  # DEAP carries no types
    """Smaller fitness first, then smaller depth."""

    weights = (-1.0, -1.0)


Source = tuple[int, int]
NEW: Source = (-1, -1)


class Origin(NamedTuple):
    """Where an individual came from.

    operator: one of ``coevo.records.OPERATORS``.
    parent_1, parent_2: index in the generation before, -1 for none. The first gave the root.
    sources: for each node, in prefix order, the parent that it came from, 0 for the first and 1 for the second, and its
        place in that; (-1, -1) if it is new. None if all are those of the first parent, or all new where there is none.
    """

    operator: str
    parent_1: int = -1
    parent_2: int = -1
    sources: tuple[Source, ...] | None = None


_CREATED = Origin("creation")
_DRAWN = Creation()


class Individual(gp.PrimitiveTree):  # type: ignore[misc]  # DEAP carries no types
    """A tree of DEAP's nodes with its fitness, and where it came from.

    replaced: the nodes that DEAP's operator replaced, as it told the list; None if it left the tree alone.
    """

    def __init__(self, content: Sequence[gp.Primitive | gp.Terminal], origin: Origin = _CREATED) -> None:
        super().__init__(content)
        self.fitness = _Fitness()
        self.origin = origin
        self.replaced: tuple[int, int] | None = None

    def __setitem__(self, key: slice, nodes: Sequence[gp.Primitive | gp.Terminal]) -> None:
        super().__setitem__(key, nodes)
        self.replaced = key.start, key.stop


def codes_of(individual: Individual, functions: FunctionSet) -> NDArray[np.uint8]:
    """Return the node codes of an individual in prefix order."""
    codes = functions.codes
    return np.array([codes[node.name] for node in individual], np.uint8)


def individual_of(codes: NDArray[np.uint8], functions: FunctionSet) -> Individual:
    """Return the individual of prefix codes."""
    nodes = functions.nodes
    return Individual([nodes[code] for code in codes.tolist()])


def origins_of(individuals: Sequence[Individual]) -> Origins:
    """Return where the individuals of a population came from, as a run folder keeps it."""
    origins = [individual.origin for individual in individuals]
    return Origins(
        np.array([OPERATORS.index(origin.operator) for origin in origins], np.uint8),
        np.array([(origin.parent_1, origin.parent_2) for origin in origins], np.int32),
    )


def parents_of(
    codes: Sequence[NDArray[np.uint8]],
    fitness: NDArray[np.float64],
    depth: NDArray[np.int64],
    functions: FunctionSet,
) -> list[Individual]:
    """Return a population that can be bred from: its trees with (population,) fitness and depth assigned."""
    parents = [individual_of(tree, functions) for tree in codes]
    for parent, values in zip(parents, zip(fitness.tolist(), depth.tolist(), strict=True), strict=True):
        parent.fitness.values = (values[0], float(values[1]))
    return parents


def first_population(
    settings: GPSettings,
    functions: FunctionSet,
    *,
    seed: int,
    robot: int,
    creation: Creation = _DRAWN,
) -> list[Individual]:
    """Return the first population of one robot: given trees, and then new ones.

    Args:
        settings: Table 6.3.
        functions: the robot's function set.
        seed, robot: identify the random stream.
        creation: given trees, and the table of the others; those that given trees take the places of are drawn all the
            same, so that the others stay as they are.
    """
    with global_random(seed, RunStream.CREATION, robot):
        drawn = [created(settings, functions, creation.table) for _ in range(settings.population)]
    given = [individual_of(tree_codes(tree, functions), functions) for tree in creation.start]
    return [*given, *drawn[len(given) :]]


def created(settings: GPSettings, functions: FunctionSet, table: DecisionTable = ()) -> Individual:
    """Return a new individual, drawn from this thread's stream: ramped half and half (Koza 1992), or a decision table.

    Args:
        settings: Table 6.3.
        functions: the robot's function set.
        table: lists of questions. Of each list the first that holds decides, or that none does, and then the next list
            is asked; the leaves, one for each way to answer, are drawn. Without it the tree is drawn as a whole.
    """
    if table:
        return Individual(_asked(table, functions))
    low, high = settings.creation_depth_min, settings.creation_depth_max
    return Individual(gp.genHalfAndHalf(functions.primitives, low, high))


def _asked(table: DecisionTable, functions: FunctionSet) -> list[gp.Primitive | gp.Terminal]:
    """Return the nodes of a decision table in prefix order, with leaves at random."""
    if not table:
        return [functions.primitives.mapping[thread_random.choice(functions.terminals)]]
    questions, rest = table[0], table[1:]
    nodes = [node for name in questions for node in (functions.primitives.mapping[name], *_asked(rest, functions))]
    return [*nodes, *_asked(rest, functions)]


def random_teams(game: Game, settings: GPSettings, *, seed: int, teams: int) -> list[list[Tree | None]]:
    """Return teams of what a run of this seed begins with: for each role that evolves a tree, None for the others.

    Args:
        game: says who plays and what trees are made of.
        settings: Table 6.3; a population has ``settings.population`` individuals.
        seed: of the run.
        teams: how many, and no more than a population has.
    """
    roles = range(len(game.roles))
    functions = {role: game.function_set(role) for role in roles if game.roles[role].evolves}
    first = {
        role: first_population(settings, functions[role], seed=seed, robot=role, creation=creation)[:teams]
        for role, creation in creations(settings, game).items()
    }
    size = min(teams, settings.population)
    return [
        [None if r not in first else from_codes(codes_of(first[r][i], functions[r]), functions[r]) for r in roles]
        for i in range(size)
    ]
