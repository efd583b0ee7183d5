"""Who descends from whom: as the run folder tells it, and by breeding again.

A generation follows from what was measured of the one before and a random stream of its own, so it can be bred again at
any time. That tells what no folder keeps: which nodes each operator replaced.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from coevo.errors import InputError
from coevo.evolution.population import Individual, Origin, codes_of, first_population, parents_of
from coevo.evolution.variation import breed
from coevo.game import creations
from coevo.run import Run

__all__ = ["Bred", "breed_again", "lineage"]

_COLUMNS = ["generation", "robot", "index", "operator", "parent_1", "parent_2", "fitness"]


@dataclass(frozen=True)
class Bred:
    """One generation of one role.

    codes: per individual its tree, (nodes,) uint8 in prefix order. origins: where each came from.
    fitness: (population,) float64. depth: (population,) int64.
    """

    codes: list[NDArray[np.uint8]]
    origins: list[Origin]
    fitness: NDArray[np.float64]
    depth: NDArray[np.int64]


def _check(run: Run, robot: str, generation: int, rows: pd.DataFrame, bred: list[Individual]) -> list[Origin]:
    """Return the origins of what was bred again, if it is what the folder holds."""
    functions = run.game.function_set(run.number_of(robot))
    origins = [individual.origin for individual in bred]
    same = len(rows) == len(bred) and all(
        np.array_equal(codes_of(individual, functions), tree)
        for individual, tree in zip(bred, rows["tree"], strict=True)
    )
    if same and "operator" in rows:
        told = zip(rows["operator"], rows["parent_1"], rows["parent_2"], strict=True)
        same = [tuple(one) for one in told] == [origin[:3] for origin in origins]
    if not same:
        raise InputError(
            f"{run.path}: breeding generation {generation} of {robot} again gives other individuals than it holds, so"
            " their ancestry cannot be told. It was bred by another version of coevo or DEAP (see environment.json), or"
            " its files were changed"
        )
    return origins


def breed_again(run: Run, robot: str, generation: int) -> list[Bred]:
    """Breed the generations of one role again, from the first to ``generation``, and compare them with the folder.

    Raises:
        InputError: the role or generation is not there, or what is bred is not what the folder holds.
    """
    number, found = run.number_of(run.record(generation, robot)["robot"].iloc[0]), list[Bred]()
    functions, settings = run.game.function_set(number), run.config
    creation = creations(settings.gp, run.game)[number]
    bred = first_population(settings.gp, functions, seed=settings.seed, robot=number, creation=creation)
    for earlier in range(generation + 1):
        rows = run.record(earlier, robot).sort_values("index")
        origins = _check(run, robot, earlier, rows, bred)
        codes = [np.asarray(tree, np.uint8) for tree in rows["tree"]]
        fitness, depth = rows["fitness"].to_numpy(np.float64), rows["depth"].to_numpy(np.int64)
        found.append(Bred(codes, origins, fitness, depth))
        if earlier < generation:
            parents = parents_of(codes, fitness, depth, functions)
            bred = breed(
                parents,
                settings.gp,
                functions,
                seed=settings.seed,
                generation=earlier,
                robot=number,
                table=creation.table,
            )
    return found


def lineage(run: Run) -> pd.DataFrame:
    """Return where every individual of a run came from, a row each.

    Returns:
        Columns ``generation, robot, index, operator, parent_1, parent_2, fitness``; the parents are indices in the
        generation before, -1 for none, and the first gave the root. Runs that were made before folders kept this are
        bred again.

    Raises:
        InputError: a run that has to be bred again does not come out as it is.
    """
    table = run.individuals
    if table.empty:
        return pd.DataFrame(columns=_COLUMNS)
    if "operator" in table:
        return table[_COLUMNS].astype({"operator": str})
    parts = []
    for robot in run.evolving.values():
        for generation, bred in enumerate(breed_again(run, robot, run.finished - 1)):
            part = pd.DataFrame([origin[:3] for origin in bred.origins], columns=_COLUMNS[3:6])
            part = part.assign(generation=generation, robot=robot, index=np.arange(len(part)), fitness=bred.fitness)
            parts.append(part[_COLUMNS])
    order = {robot: number for number, robot in enumerate(run.evolving.values())}
    whole = pd.concat(parts).sort_values(["generation", "robot"], key=lambda of: of.replace(order), kind="stable")
    whole = whole.astype({name: table[name].dtype for name in ("generation", "index", "robot")})
    return whole.astype({"parent_1": np.int32, "parent_2": np.int32}).reset_index(drop=True)
