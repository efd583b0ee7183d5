"""Trees of any size and how they were used, for tests of what large trees come to."""

from __future__ import annotations

import numpy as np
import pytest

from coevo.tree import Tree
from coevo.vocabulary import CATEGORIES, SKILLS

THINGS = ("ball", "own_goal", "opponent_goal", "r1", "r2")


def _grow(nodes, depth, seed=0):
    """Grow a random tree with exactly so many nodes and at most so deep: each question shares out those below it."""
    rng = np.random.default_rng(seed)
    names = []
    waiting = [(nodes // 2, depth)]  # how many questions a branch has, and how many levels are left for them
    while waiting:
        questions, levels = waiting.pop()
        if not questions:
            names.append(str(rng.choice(SKILLS)))
            continue
        names.append(f"IF_{rng.choice(THINGS)}_is_{rng.choice(CATEGORIES)}")
        most = 2 ** (levels - 1) - 1  # that a branch can hold
        least = max(0, questions - 1 - most)
        first = int(np.clip(round(rng.beta(0.5, 0.5) * (questions - 1)), least, min(most, questions - 1)))
        waiting += [(questions - 1 - first, levels - 1), (first, levels - 1)]
    return Tree(tuple(names))


def _walk(tree, steps, seed=0):
    """Walk down a tree so often, each question answered by a coin of its own, some of which have one side only."""
    rng = np.random.default_rng(seed)
    yes = rng.choice([0.0, 0.02, 0.3, 0.6, 0.97, 1.0], size=tree.nodes)
    passed = np.zeros(tree.nodes, np.int64)
    for _ in range(steps):
        at = 0
        passed[0] += 1
        while tree.second[at]:
            at = at + 1 if rng.random() < yes[at] else tree.second[at]
            passed[at] += 1
    return passed


@pytest.fixture(scope="session")
def grow():
    """Return a function that grows a random tree of some size and at most some depth."""
    return _grow


@pytest.fixture(scope="session")
def walk():
    """Return a function that gives (nodes,) how often each node of a tree was passed in some random walks."""
    return _walk


@pytest.fixture(scope="session")
def chain():
    """Return a function that gives a tree as deep as it has questions."""

    def build(depth):
        halves = [(f"IF_r{n % 3 + 1}_is_{CATEGORIES[n % 7]}", SKILLS[n % 4]) for n in range(depth)]
        return Tree((*(name for half in halves for name in half), "pass"))

    return build
