"""Variation: how a population follows from the one before, by DEAP's operators (Table 6.3) and by smaller steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

from deap import gp, tools

from coevo.config import GPSettings
from coevo.evolution.population import NEW, Individual, Origin, Source, created
from coevo.game import DecisionTable
from coevo.seeds import RunStream, global_random, thread_random
from coevo.tree import FunctionSet, Tree
from coevo.tree.simplify import kept_nodes

__all__ = ["breed", "exchanged"]

_Node: TypeAlias = gp.Primitive | gp.Terminal


def breed(
    parents: Sequence[Individual],
    settings: GPSettings,
    functions: FunctionSet,
    *,
    seed: int,
    generation: int,
    robot: int,
    table: DecisionTable = (),
) -> list[Individual]:
    """Return the population of the next generation.

    The best survive as they are; the rest comes from parents chosen by tournament, by crossover (a child deeper
    than the limit is replaced by its parent), reproduction or mutation (a grown subtree), and then by small changes if
    settings ask for them. With ``variation = "random"`` the rest is created as the first population was.

    Args:
        parents: the population with its fitness assigned: (fitness, depth).
        settings: Table 6.3.
        functions: the robot's function set.
        seed, generation, robot: identify the random stream; ``generation`` is that of the parents.
        table: as of ``created``, for ``variation = "random"``.

    Returns:
        The children, each with its ``origin``. A child that the limit replaced is a reproduction of the parent that
        replaced it, and so is one of a crossover that exchanged nothing.
    """
    place = {id(parent): index for index, parent in enumerate(parents)}

    def copy(parent: Individual, operator: str) -> Individual:
        return Individual(parent, Origin(operator, place[id(parent)]))

    with global_random(seed, RunStream.VARIATION, generation, robot):
        children = [copy(parent, "elite") for parent in tools.selBest(parents, settings.elite)]
        if settings.variation == "random":
            return [
                *children,
                *(created(settings, functions, table) for _ in range(settings.population - len(children))),
            ]

        def select() -> Individual:
            return copy(tools.selTournament(parents, 1, settings.tournament)[0], "reproduction")

        cross = _cross_anywhere(settings) if settings.crossover_points == "any" else _cross_in_context
        while len(children) < settings.population:
            chance = thread_random.random()
            if chance < settings.crossover:
                family = cross(select(), select())
            elif chance < settings.crossover + settings.mutation:
                family = [_mutant(select(), settings, functions)]
            else:
                family = [select()]
            children += [_in_small(_simplified(child, settings, functions), settings, functions) for child in family]
        return children[: settings.population]


def exchanged(nodes: int, cut: tuple[int, int], came: Sequence[Source]) -> tuple[Source, ...]:
    """Return the sources of a child's nodes: those of its first parent, but for some that others took the place of.

    Args:
        nodes: of the first parent.
        cut: its first node that was taken out, and the one after the last.
        came: the sources of those in their place.
    """
    begin, end = cut
    return (*((0, k) for k in range(begin)), *came, *((0, k) for k in range(end, nodes)))


# -------------------------------------------------------------------------------------------------------- crossover


def _cross_anywhere(settings: GPSettings) -> Callable[[Individual, Individual], list[Individual]]:
    """Return the crossover that exchanges a branch of each parent, wherever these are."""
    limit = gp.staticLimit(key=lambda tree: tree.height, max_value=settings.crossover_depth_max)

    @limit
    def exchange(one: Individual, two: Individual) -> tuple[Individual, Individual]:
        return gp.cxOnePointLeafBiased(one, two, termpb=settings.leaf_probability)  # type: ignore[no-any-return]

    def cross(one: Individual, two: Individual) -> list[Individual]:
        sizes = len(one), len(two)
        pair = exchange(one, two)
        # A child that the limit replaces is a copy of one of them as they were before, with its origin.
        if one.replaced is not None and two.replaced is not None:
            cuts, parents = (one.replaced, two.replaced), (one.origin.parent_1, two.origin.parent_1)
            for child, mine, other in ((one, 0, 1), (two, 1, 0)):
                came = [(1, k) for k in range(*cuts[other])]
                sources = exchanged(sizes[mine], cuts[mine], came)
                child.origin = Origin("crossover", parents[mine], parents[other], sources)
        return [Individual(child, child.origin) for child in pair]

    return cross


def _cross_in_context(one: Individual, two: Individual) -> list[Individual]:
    """Exchange branches that are reached by the same answers to the same questions, each with a chance of a half.

    The trees are walked together from their roots as long as they ask the same; where they differ, in a condition or in
    what is chosen, what is below may change places. So it means in the child what it meant in its parent.
    """
    pair: tuple[list[tuple[int, int]], list[tuple[int, int]]] = ([], [])  # parent and place of each child's nodes
    trees, ends = (one, two), (_ends(one), _ends(two))
    waiting = [(0, 0)]
    while waiting:
        at = waiting.pop()
        first, second = one[at[0]], two[at[1]]
        if first.arity and first.name == second.name:
            for child in (0, 1):
                pair[child].append((child, at[child]))
            then = at[0] + 1, at[1] + 1
            waiting += [(ends[0][then[0]], ends[1][then[1]]), then]
            continue
        crosses = first.name != second.name and thread_random.random() < 0.5
        for child in (0, 1):
            giver = 1 - child if crosses else child
            pair[child].extend((giver, k) for k in range(at[giver], ends[giver][at[giver]]))
    return [_of_both(trees, places) for places in pair]


def _of_both(trees: tuple[Individual, Individual], places: Sequence[tuple[int, int]]) -> Individual:
    """Return a child from the parents' nodes: by (parent, place)."""
    nodes = [trees[parent][place] for parent, place in places]
    first = places[0][0]  # who gave the root
    if all(parent == first for parent, _ in places):
        return Individual(nodes, trees[first].origin)
    sources = tuple((0 if parent == first else 1, place) for parent, place in places)
    parents = trees[first].origin.parent_1, trees[1 - first].origin.parent_1
    return Individual(nodes, Origin("crossover", *parents, sources))


def _ends(tree: Sequence[_Node]) -> list[int]:
    """Return for each node the place after the last of its branch."""
    ends = [0] * len(tree)
    for at in range(len(tree) - 1, -1, -1):
        end = at + 1
        for _ in range(tree[at].arity):
            end = ends[end]
        ends[at] = end
    return ends


# --------------------------------------------------------------------------------------------------------- mutation


def _mutant(parent: Individual, settings: GPSettings, functions: FunctionSet) -> Individual:
    """Return a copy in which a grown branch has taken the place of one."""

    def subtree(pset: gp.PrimitiveSet, type_: object) -> list[_Node]:
        return gp.genGrow(pset, 0, settings.mutation_depth_max, type_)  # type: ignore[no-any-return]

    nodes = len(parent)
    (mutant,) = gp.mutUniform(parent, subtree, functions.primitives)
    begin, end = mutant.replaced
    sources = exchanged(nodes, (begin, end), [NEW] * (len(mutant) - nodes + end - begin))
    return Individual(mutant, Origin("mutation", mutant.origin.parent_1, sources=sources))


def _simplified(child: Individual, settings: GPSettings, functions: FunctionSet) -> Individual:
    """Return a child without what can make no difference to what it does."""
    if not settings.simplify:
        return child
    kept = kept_nodes(Tree(tuple(node.name for node in child)), functions)
    if len(kept) == len(child):
        return child
    sources = child.origin.sources or tuple((0, k) for k in range(len(child)))
    origin = child.origin._replace(sources=tuple(sources[node] for node in kept))
    return Individual([child[node] for node in kept], origin)


def _in_small(child: Individual, settings: GPSettings, functions: FunctionSet) -> Individual:
    """Return a child after its small changes: leaves that choose anew, questions put above branches, others asked."""
    rates = settings.changed_leaves, settings.inserted_conditions, settings.changed_conditions
    if not any(rates):
        return child
    leaves, insertions, conditions = (_poisson(rate) for rate in rates)
    terminals = [functions.nodes[code] for code in range(len(functions.functions), len(functions.names))]
    questions = [functions.nodes[code] for code in range(len(functions.functions))]
    changed = _Changed(child, settings)
    for _ in range(leaves):
        changed.replace(changed.place(), terminals)
    for _ in range(insertions):
        changed.insert(changed.place(settings.walk_stop), questions, terminals)
    for _ in range(conditions):
        asked = [at for at, node in enumerate(changed.nodes) if node.arity]
        if asked:
            changed.replace(thread_random.choice(asked), questions)
    nodes, sources = changed.nodes, changed.sources
    if NEW not in sources:
        return child
    origin = child.origin
    operator = "mutation" if origin.operator == "reproduction" else origin.operator
    return Individual(nodes, origin._replace(operator=operator, sources=tuple(sources)))


class _Changed:
    """The nodes of a child, and where each came from, while it is changed in small."""

    def __init__(self, child: Individual, settings: GPSettings) -> None:
        self.nodes: list[_Node] = list(child)
        self.sources = list(child.origin.sources or ((0, k) for k in range(len(self.nodes))))
        self._settings = settings

    def place(self, stop: float = 0.0) -> int:
        """Return where to change something: at any leaf, or where a walk from the root ends."""
        share = self._settings.walked_changes
        if share and thread_random.random() < share:
            return _walked(self.nodes, stop)
        return int(thread_random.choice([at for at, node in enumerate(self.nodes) if not node.arity]))

    def replace(self, at: int, by: Sequence[_Node]) -> None:
        node = thread_random.choice(by)
        if node.name != self.nodes[at].name:
            self.nodes[at], self.sources[at] = node, NEW

    def insert(self, at: int, questions: Sequence[_Node], terminals: Sequence[_Node]) -> None:
        """Put a question above a branch, with a leaf as the other branch, if the limit of depth allows it."""
        question, leaf = thread_random.choice(questions), thread_random.choice(terminals)
        comes_first = thread_random.random() < 0.5
        end = _ends(self.nodes)[at]
        if max(_depths(self.nodes)[at:end]) < self._settings.crossover_depth_max:
            own = list(zip(self.nodes[at:end], self.sources[at:end], strict=True))
            branches = [*own, (leaf, NEW)] if comes_first else [(leaf, NEW), *own]
            self.nodes[at:end] = [question, *(node for node, _ in branches)]
            self.sources[at:end] = [NEW, *(source for _, source in branches)]


def _walked(nodes: Sequence[_Node], stop: float) -> int:
    """Return where a walk from the root ends that takes either branch with equal chance: at a leaf, or before it.

    Most leaves of a tree are deep, and seldom or never reached; so a leaf is found about as often as it is used.
    """
    at = 0
    ends = _ends(nodes)
    while nodes[at].arity and not (stop and thread_random.random() < stop):
        at = at + 1 if thread_random.random() < 0.5 else ends[at + 1]
    return at


def _depths(nodes: Sequence[_Node]) -> list[int]:
    """Return for each node how many are above it."""
    depths, waiting = [], [0]
    for node in nodes:
        depth = waiting.pop()
        depths.append(depth)
        waiting += [depth + 1] * node.arity
    return depths


def _poisson(mean: float) -> int:
    """Return a number drawn from the Poisson distribution (Knuth's way: good for means that are small)."""
    if not mean:
        return 0
    number, product, least = 0, thread_random.random(), math.exp(-mean)
    while product > least:
        product *= thread_random.random()
        number += 1
    return number
