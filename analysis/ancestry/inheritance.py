"""What a tree inherited: each of its nodes, back through its ancestors to where it came into being."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.ancestry.breeding import Bred, breed_again
from coevo.errors import InputError
from coevo.evolution.population import Origin
from coevo.run import Run
from coevo.tree import FunctionSet, from_codes

__all__ = ["Ancestry", "Trace", "ancestors", "ancestry_of", "sources", "trace"]


@dataclass(frozen=True)
class Ancestry:
    """Where one individual came from.

    Attributes:
        robot, generation, index: who it is.
        ancestors: a row for each ancestor, the individual itself the last: ``generation, index, operator, parent_1,
            parent_2, fitness, nodes, depth`` as in individuals.parquet; ``root_line``, whether it handed down the place
            of the root (the chain of first parents); ``carried``, how many of the individual's nodes it had already:
            ``from_1`` and ``from_2`` came from its parents, ``arisen`` came into being in it; ``carried_used``, how
            many of those it carried were in use, and ``use``, their share of all passes of nodes, both NaN where
            this is not known.
        nodes: a row for each node of the individual's tree in prefix order: ``node, name, depth``; ``generation``,
            ``index`` and ``operator`` of the ancestor that it came into being in; ``steps``, how often it was passed.
    """

    robot: str
    generation: int
    index: int
    ancestors: pd.DataFrame
    nodes: pd.DataFrame

    @property
    def root_line(self) -> pd.DataFrame:
        """The ancestors that handed down the root's place, the first of all first."""
        return self.ancestors[self.ancestors["root_line"]]


def sources(origin: Origin, nodes: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return from which parent and from which of its nodes each node of a child came.

    Args:
        origin: of the child.
        nodes: how many it has.

    Returns:
        Number of the parent, 0 or 1, and place in its tree, (nodes,) each; -1 for what is new.
    """
    parent, place = np.zeros(nodes, np.int64), np.arange(nodes)
    if origin.parent_1 < 0:
        return parent - 1, np.full(nodes, -1)
    if origin.sources is not None:
        parent, place = np.array(origin.sources, np.int64).T
    return parent, place


@dataclass(frozen=True)
class Trace:
    """Where each node of an individual was in each generation, (generations, nodes) each, -1 before it came into being.

    home, place: in whom, and at which place of its tree.
    parent: from which of its parents it came, 0 or 1; -1 also in the generation that it came into being in.
    """

    home: NDArray[np.int64]
    place: NDArray[np.int64]
    parent: NDArray[np.int64]


def trace(bred: Sequence[Bred], index: int) -> Trace:
    """Follow each node of an individual of the last generation back.

    Args:
        bred: generations of a role, from the first.
        index: of the individual in the last.
    """
    nodes = len(bred[-1].codes[index])
    home, place, parent = np.full((3, len(bred), nodes), -1)
    home[-1], place[-1] = index, np.arange(nodes)
    for generation in range(len(bred) - 1, 0, -1):
        now = bred[generation]
        for one in np.unique(home[generation][home[generation] >= 0]):
            origin, mine = now.origins[one], home[generation] == one
            which, at = sources(origin, len(now.codes[one]))
            parent[generation][mine] = which[place[generation][mine]]
            place[generation - 1][mine] = at[place[generation][mine]]
            home[generation - 1][mine] = np.array([*origin[1:3], -1])[parent[generation][mine]]
    return Trace(home, place, parent)


def _everyone(bred: Sequence[Bred], index: int) -> list[tuple[int, int]]:
    """Return generation and index of all ancestors and of the individual itself, the first generation first."""
    found: list[list[int]] = [[index]]
    for generation in range(len(bred) - 1, 0, -1):
        origins = [bred[generation].origins[one] for one in found[-1]]
        parents = {parent for origin in origins for parent in (origin.parent_1, origin.parent_2) if parent >= 0}
        found.append(sorted(parents))
    return [(generation, one) for generation, members in enumerate(reversed(found)) for one in members]


def ancestors(
    run: Run, robot: str, generation: int, index: int, *, node_steps: NDArray[np.int64] | None = None
) -> Ancestry:
    """Return where an individual came from, node by node.

    Args:
        run: with this generation.
        robot, generation, index: who; the index is that of individuals.parquet, not a rank.
        node_steps: (nodes,) how often each node of its tree was passed, as ``coevo.usage.tree_usage`` gives it; without
            it nothing is said of use.

    Raises:
        InputError: there is no such individual, or breeding again gives others than the run holds.

    Example:
        >>> from pathlib import Path
        >>> from analysis.ancestry import ancestors
        >>> from coevo.evolution import evolve
        >>> from coevo.evolution.evaluation import Evaluator
        >>> from coevo.recipes import read_experiment
        >>> from coevo.run import create_run
        >>> small = ["gp.population=4", "gp.generations=2", "gp.tournament=2", "evaluation.games=1"]
        >>> run = create_run(Path("runs/family"), read_experiment("smoke", small))
        >>> with Evaluator(run.config, workers=1, backend="threads") as evaluator:
        ...     evolve(run, evaluator, lambda _: None)
        >>> best = run.record(1, "r0").iloc[0]
        >>> found = ancestors(run, "r0", generation=1, index=int(best["index"]))
        >>> bool(found.ancestors["arisen"].sum() == len(found.nodes) == best["nodes"])
        True
    """
    size = len(run.record(generation, robot))
    if not 0 <= index < size:
        raise InputError(f"the index of an individual must be from 0 to {size - 1}, got {index}")
    functions = run.game.function_set(run.number_of(robot))
    return ancestry_of(breed_again(run, robot, generation), robot, index, functions, node_steps=node_steps)


def ancestry_of(
    bred: Sequence[Bred],
    robot: str,
    index: int,
    functions: FunctionSet,
    *,
    node_steps: NDArray[np.int64] | None = None,
) -> Ancestry:
    """Return where an individual of the last of these generations came from; see ``ancestors``."""
    found = trace(bred, index)
    home = found.home
    tree = from_codes(bred[-1].codes[index], functions)
    born = (home >= 0).argmax(axis=0)
    born_in = home[born, np.arange(len(tree))]
    steps = np.full(len(tree), np.nan) if node_steps is None else node_steps.astype(np.float64)
    nodes = pd.DataFrame(
        {
            "node": np.arange(len(tree)),
            "name": tree.names,
            "depth": tree.depths,
            "generation": born,
            "index": born_in,
            "operator": [bred[g].origins[i].operator for g, i in zip(born, born_in, strict=True)],
            "steps": steps,
        }
    )
    return Ancestry(robot, len(bred) - 1, index, _table(bred, index, found, steps), nodes)


def _table(bred: Sequence[Bred], index: int, found: Trace, steps: NDArray[np.float64]) -> pd.DataFrame:
    """Return the table of ancestors."""
    line = [index]
    for now in reversed(bred[1:]):
        line.append(now.origins[line[-1]].parent_1 if line[-1] >= 0 else -1)  # -1: made anew
    line.reverse()
    known, used = not np.isnan(steps).any(), steps > 0
    rows = []
    for generation, one in _everyone(bred, index):
        of, carried = bred[generation], found.home[generation] == one
        came = found.parent[generation][carried]
        rows.append(
            {
                "generation": generation,
                "index": one,
                **dict(zip(("operator", "parent_1", "parent_2"), of.origins[one][:3], strict=True)),
                "fitness": of.fitness[one],
                "nodes": len(of.codes[one]),
                "depth": of.depth[one],
                "root_line": line[generation] == one,
                "carried": int(carried.sum()),
                "from_1": int((came == 0).sum()),
                "from_2": int((came == 1).sum()),
                "arisen": int((came == -1).sum()),
                "carried_used": int((carried & used).sum()) if known else np.nan,
                "use": steps[carried].sum() / max(steps.sum(), 1.0) if known else np.nan,
            }
        )
    return pd.DataFrame(rows)
