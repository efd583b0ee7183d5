"""A population of trees for one robot: creation and variation by DEAP (Table 6.3)."""

from __future__ import annotations

import random
from collections.abc import Sequence

import numpy as np
from deap import base, gp, tools
from numpy.typing import NDArray

from coevo.config import GPSettings
from coevo.game import Game
from coevo.seeds import RunStream, global_random
from coevo.tree import FunctionSet, Tree, from_codes

__all__ = ["Individual", "breed", "codes_of", "first_population", "individual_of", "random_teams"]


class _Fitness(base.Fitness):  # type: ignore[misc]  # DEAP carries no types
    """Smaller fitness first, then smaller depth."""

    weights = (-1.0, -1.0)


class Individual(gp.PrimitiveTree):  # type: ignore[misc]  # DEAP carries no types
    """A tree of DEAP's nodes with its fitness and its depth (kept, as counting it anew is slow)."""

    def __init__(self, content: Sequence[gp.Primitive | gp.Terminal]) -> None:
        super().__init__(content)
        self.fitness = _Fitness()


def codes_of(individual: Individual, functions: FunctionSet) -> NDArray[np.uint8]:
    """Return the node codes of an individual in prefix order."""
    codes = functions.codes
    return np.array([codes[node.name] for node in individual], np.uint8)


def individual_of(codes: NDArray[np.uint8], functions: FunctionSet) -> Individual:
    """Return the individual of prefix codes."""
    nodes = functions.nodes
    return Individual([nodes[code] for code in codes.tolist()])


def first_population(settings: GPSettings, functions: FunctionSet, *, seed: int, robot: int) -> list[Individual]:
    """Return the first population of one robot: ramped half and half."""
    primitives, low, high = functions.primitives, settings.creation_depth_min, settings.creation_depth_max
    with global_random(seed, RunStream.CREATION, robot):
        return [Individual(gp.genHalfAndHalf(primitives, low, high)) for _ in range(settings.population)]


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
    first = {role: first_population(settings, of, seed=seed, robot=role)[:teams] for role, of in functions.items()}
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
    than the limit is replaced by its parent), reproduction or mutation (a grown subtree).

    Args:
        parents: the population with its fitness assigned: (fitness, depth).
        settings: Table 6.3.
        functions: the robot's function set.
        seed, generation, robot: identify the random stream; ``generation`` is that of the parents.
    """
    with global_random(seed, RunStream.VARIATION, generation, robot):
        limit = gp.staticLimit(key=lambda tree: tree.height, max_value=settings.crossover_depth_max)

        @limit
        def cross(one: Individual, two: Individual) -> tuple[Individual, Individual]:
            return gp.cxOnePointLeafBiased(one, two, termpb=settings.leaf_probability)  # type: ignore[no-any-return]

        def subtree(pset: gp.PrimitiveSet, type_: object) -> list[gp.Primitive | gp.Terminal]:
            return gp.genGrow(pset, 0, settings.mutation_depth_max, type_)  # type: ignore[no-any-return]

        def select() -> Individual:
            return tools.selTournament(parents, 1, settings.tournament)[0]  # type: ignore[no-any-return]

        children = [Individual(parent) for parent in tools.selBest(parents, settings.elite)]
        while len(children) < settings.population:
            chance = random.random()
            if chance < settings.crossover:
                pair = cross(Individual(select()), Individual(select()))
                children += [Individual(child) for child in pair]
            elif chance < settings.crossover + settings.mutation:
                (mutant,) = gp.mutUniform(Individual(select()), subtree, functions.primitives)
                children.append(mutant)
            else:
                children.append(Individual(select()))
        return children[: settings.population]
