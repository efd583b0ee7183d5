"""A population of trees for one robot: creation and variation by DEAP (Table 6.3)."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from deap import base, gp, tools
from numpy.typing import NDArray

from coevo.config import GPSettings
from coevo.game import Game, start_trees
from coevo.records import OPERATORS, Origins
from coevo.seeds import RunStream, global_random
from coevo.tree import FunctionSet, Tree, from_codes, tree_codes

__all__ = [
    "Individual",
    "Origin",
    "breed",
    "codes_of",
    "first_population",
    "individual_of",
    "origins_of",
    "parents_of",
    "random_teams",
]


class _Fitness(base.Fitness):  # type: ignore[misc]  # DEAP carries no types
    """Smaller fitness first, then smaller depth."""

    weights = (-1.0, -1.0)


class Origin(NamedTuple):
    """Where an individual came from.

    operator: one of ``coevo.records.OPERATORS``. Crossover and mutation replace nodes ``cut`` of the first parent: by
        nodes ``graft`` of the second, or by new ones. The others copy the first parent.
    parent_1, parent_2: index in the generation before, -1 for none.
    cut, graft: first node and the one after the last, in prefix order of the parent.
    """

    operator: str
    parent_1: int = -1
    parent_2: int = -1
    cut: tuple[int, int] | None = None
    graft: tuple[int, int] | None = None


_CREATED = Origin("creation")


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
    settings: GPSettings, functions: FunctionSet, *, seed: int, robot: int, start: Sequence[Tree] = ()
) -> list[Individual]:
    """Return the first population of one robot: given trees, and then ramped half and half.

    Args:
        settings: Table 6.3.
        functions: the robot's function set.
        seed, robot: identify the random stream.
        start: given trees; those that they take the places of are drawn all the same, so that the others stay as they
            are.
    """
    with global_random(seed, RunStream.CREATION, robot):
        drawn = [_created(settings, functions) for _ in range(settings.population)]
    given = [individual_of(tree_codes(tree, functions), functions) for tree in start]
    return [*given, *drawn[len(given) :]]


def _created(settings: GPSettings, functions: FunctionSet) -> Individual:
    low, high = settings.creation_depth_min, settings.creation_depth_max
    return Individual(gp.genHalfAndHalf(functions.primitives, low, high))


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
    start = start_trees(settings, game)
    first = {
        role: first_population(settings, of, seed=seed, robot=role, start=start.get(role, ()))[:teams]
        for role, of in functions.items()
    }
    size = min(teams, settings.population)
    return [
        [None if r not in first else from_codes(codes_of(first[r][i], functions[r]), functions[r]) for r in roles]
        for i in range(size)
    ]


def breed(
    parents: Sequence[Individual],
    settings: GPSettings,
    functions: FunctionSet,
    *,
    seed: int,
    generation: int,
    robot: int,
) -> list[Individual]:
    """Return the population of the next generation.

    The best survive as they are; the rest comes from parents chosen by tournament, by crossover (a child deeper
    than the limit is replaced by its parent), reproduction or mutation (a grown subtree). With ``variation = "random"``
    the rest is created as the first population was.

    Args:
        parents: the population with its fitness assigned: (fitness, depth).
        settings: Table 6.3.
        functions: the robot's function set.
        seed, generation, robot: identify the random stream; ``generation`` is that of the parents.

    Returns:
        The children, each with its ``origin``. A child that the limit replaced is a reproduction of the parent that
        replaced it, and so is one of a crossover that found no point to exchange at.
    """
    place = {id(parent): index for index, parent in enumerate(parents)}

    def copy(parent: Individual, operator: str) -> Individual:
        return Individual(parent, Origin(operator, place[id(parent)]))

    with global_random(seed, RunStream.VARIATION, generation, robot):
        limit = gp.staticLimit(key=lambda tree: tree.height, max_value=settings.crossover_depth_max)

        @limit
        def cross(one: Individual, two: Individual) -> tuple[Individual, Individual]:
            return gp.cxOnePointLeafBiased(one, two, termpb=settings.leaf_probability)  # type: ignore[no-any-return]

        def subtree(pset: gp.PrimitiveSet, type_: object) -> list[gp.Primitive | gp.Terminal]:
            return gp.genGrow(pset, 0, settings.mutation_depth_max, type_)  # type: ignore[no-any-return]

        def select() -> Individual:
            return copy(tools.selTournament(parents, 1, settings.tournament)[0], "reproduction")

        children = [copy(parent, "elite") for parent in tools.selBest(parents, settings.elite)]
        if settings.variation == "random":
            return [*children, *(_created(settings, functions) for _ in range(settings.population - len(children)))]
        while len(children) < settings.population:
            chance = random.random()
            if chance < settings.crossover:
                one, two = select(), select()
                pair = cross(one, two)
                if one.replaced is not None:  # where the limit replaces a child, the pair holds a copy of before
                    first, second = one.origin.parent_1, two.origin.parent_1
                    one.origin = Origin("crossover", first, second, one.replaced, two.replaced)
                    two.origin = Origin("crossover", second, first, two.replaced, one.replaced)
                children += [Individual(child, child.origin) for child in pair]
            elif chance < settings.crossover + settings.mutation:
                (mutant,) = gp.mutUniform(select(), subtree, functions.primitives)
                mutant.origin = Origin("mutation", mutant.origin.parent_1, cut=mutant.replaced)
                children.append(mutant)
            else:
                children.append(select())
        return children[: settings.population]
