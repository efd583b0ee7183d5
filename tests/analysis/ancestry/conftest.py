"""A breeding that is known by heart, and a run in which every operator was at work."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.ancestry.breeding import Bred
from coevo.evolution.population import NEW, Origin
from coevo.evolution.variation import exchanged
from coevo.run import create_run
from coevo.tree import FunctionSet, parse, tree_codes

FUNCTIONS = FunctionSet(("IF_a", "IF_b"), ("x", "y"))


def _bred(*members):
    """Return a generation of (text, origin, fitness)."""
    trees = [parse(text, FUNCTIONS) for text, _, _ in members]
    codes = [tree_codes(tree, FUNCTIONS) for tree in trees]
    fitness = np.array([value for _, _, value in members], np.float64)
    depth = np.array([tree.depth for tree in trees])
    return Bred(codes, [origin for _, origin, _ in members], fitness, depth)


@pytest.fixture(scope="session")
def known_functions():
    return FUNCTIONS


@pytest.fixture(scope="session")
def known():
    """Return four generations, of which the last's individual 0 is what the tests ask about.

    Its root is that of individual 0 at first, its first branch was bred into it from individual 1, its second one is
    that of a mutation in another line. What a mutation put into its own root line was lost again.
    """
    created = Origin("creation")
    return [
        _bred(
            ("IF_a(x, y)", created, 9.0),
            ("IF_b(IF_a(y, y), x)", created, 8.0),
            ("y", created, 7.0),  # nobody's ancestor
        ),
        _bred(
            ("IF_a(IF_a(y, y), y)", Origin("crossover", 0, 1, exchanged(3, (1, 2), [(1, 1), (1, 2), (1, 3)])), 6.0),
            ("IF_b(IF_a(y, y), IF_b(x, y))", Origin("mutation", 1, -1, exchanged(5, (4, 5), [NEW] * 3)), 5.0),
            ("IF_b(IF_a(y, y), x)", Origin("elite", 1), 8.0),
        ),
        _bred(
            ("IF_a(IF_a(y, y), x)", Origin("mutation", 0, -1, exchanged(5, (4, 5), [NEW])), 4.0),
            ("IF_b(x, IF_b(x, y))", Origin("mutation", 1, -1, exchanged(7, (1, 4), [NEW])), 3.0),
            ("IF_b(IF_a(y, y), x)", Origin("reproduction", 2), 8.0),
        ),
        _bred(
            (
                "IF_a(IF_a(y, y), IF_b(x, y))",
                Origin("crossover", 0, 1, exchanged(5, (4, 5), [(1, 2), (1, 3), (1, 4)])),
                2.0,
            ),
            ("IF_b(x, x)", Origin("crossover", 1, 0, exchanged(5, (2, 5), [(1, 4)])), 1.0),
        ),
    ]


@pytest.fixture(scope="session")
def changed_in_small():
    """Return two generations; the second is a child of a crossover with one node that neither parent had."""
    created = Origin("creation")
    return [
        _bred(("IF_a(x, y)", created, 9.0), ("IF_b(y, x)", created, 8.0)),
        _bred(("IF_a(x, x)", Origin("crossover", 0, 1, ((0, 0), NEW, (1, 2))), 7.0)),
    ]


@pytest.fixture(scope="session")
def busy_run(small_settings, go_on, tmp_path_factory):
    """Return a run of seven generations, small trees, every operator and small changes: only to be read."""
    shares = ("gp.crossover=0.55", "gp.mutation=0.3", "gp.reproduction=0.15", "gp.crossover_depth_max=5")
    shares += ("gp.inserted_conditions=0.3", "gp.changed_leaves=0.3")
    settings = small_settings(*shares, "gp.population=10", "gp.generations=7", "seed=11")
    return go_on(create_run(tmp_path_factory.mktemp("busy") / "run", settings))
