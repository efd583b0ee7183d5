"""Where each node of a tree came from: a breeding known by heart, and DEAP's own nodes as an independent witness."""

from __future__ import annotations

import copy
import re

import numpy as np
import pandas as pd
import pytest

from analysis.ancestry import ancestors
from analysis.ancestry.breeding import breed_again
from analysis.ancestry.inheritance import ancestry_of, sources, trace
from coevo.errors import InputError
from coevo.evolution.population import NEW, Individual, Origin, codes_of, first_population
from coevo.evolution.variation import breed, exchanged
from coevo.usage import tree_usage

_ = -1


OWN = [(1, 1), (1, 2), (1, 3)]


@pytest.mark.parametrize(
    ("origin", "nodes", "parent", "place"),
    [
        pytest.param(Origin("creation"), 3, [_, _, _], [_, _, _], id="created"),
        pytest.param(Origin("elite", 4), 3, [0, 0, 0], [0, 1, 2], id="copied"),
        pytest.param(
            Origin("mutation", 4, _, exchanged(3, (1, 2), [NEW] * 3)), 5, [0, _, _, _, 0], [0, _, _, _, 2], id="grown"
        ),
        pytest.param(Origin("mutation", 4, _, exchanged(5, (1, 4), [NEW])), 3, [0, _, 0], [0, _, 4], id="shrunk"),
        pytest.param(Origin("mutation", 4, _, exchanged(3, (0, 3), [NEW])), 1, [_], [_], id="all of it"),
        pytest.param(
            Origin("crossover", 4, 7, exchanged(5, (1, 4), [(1, 2)])), 3, [0, 1, 0], [0, 2, 4], id="a leaf came"
        ),
        pytest.param(
            Origin("crossover", 4, 4, exchanged(3, (2, 3), OWN)), 5, [0, 0, 1, 1, 1], [0, 1, 1, 2, 3], id="own branch"
        ),
    ],
)
def test_sources_of_the_nodes_of_a_child(origin, nodes, parent, place):
    assert [array.tolist() for array in sources(origin, nodes)] == [parent, place]


def test_the_nodes_of_a_known_tree_are_followed_to_their_origins(known):
    found = trace(known, 0)
    assert found.home.tolist() == [
        [0, 1, 1, 1, _, _, _],
        [0, 0, 0, 0, 1, 1, 1],
        [0, 0, 0, 0, 1, 1, 1],
        [0, 0, 0, 0, 0, 0, 0],
    ]
    assert found.place.tolist() == [
        [0, 1, 2, 3, _, _, _],
        [0, 1, 2, 3, 4, 5, 6],
        [0, 1, 2, 3, 2, 3, 4],
        [0, 1, 2, 3, 4, 5, 6],
    ]
    assert found.parent.tolist() == [
        [_, _, _, _, _, _, _],
        [0, 1, 1, 1, _, _, _],
        [0, 0, 0, 0, 0, 0, 0],
        [0, 0, 0, 0, 1, 1, 1],
    ]


def test_the_tables_of_a_known_ancestry(known, known_functions):
    steps = np.array([100, 60, 60, 0, 40, 0, 40])
    found = ancestry_of(known, "r0", 0, known_functions, node_steps=steps)
    assert found.generation == 3
    assert found.nodes["name"].tolist() == ["IF_a", "IF_a", "y", "y", "IF_b", "x", "y"]
    assert found.nodes["generation"].tolist() == [0, 0, 0, 0, 1, 1, 1]
    assert found.nodes["index"].tolist() == [0, 1, 1, 1, 1, 1, 1]
    assert found.nodes["operator"].tolist() == ["creation"] * 4 + ["mutation"] * 3
    assert found.nodes["steps"].tolist() == steps.tolist()
    columns = ["generation", "index", "operator", "root_line", "carried", "from_1", "from_2", "arisen", "carried_used"]
    assert found.ancestors[columns].to_numpy().tolist() == [
        [0, 0, "creation", True, 1, 0, 0, 1, 1],
        [0, 1, "creation", False, 3, 0, 0, 3, 2],
        [1, 0, "crossover", True, 4, 1, 3, 0, 3],
        [1, 1, "mutation", False, 3, 0, 0, 3, 2],
        [2, 0, "mutation", True, 4, 4, 0, 0, 3],
        [2, 1, "mutation", False, 3, 3, 0, 0, 2],
        [3, 0, "crossover", True, 7, 4, 3, 0, 5],
    ]
    assert found.ancestors["use"].to_numpy() == pytest.approx(np.array([100, 120, 220, 80, 220, 80, 300]) / 300)
    assert found.root_line["fitness"].tolist() == [9.0, 6.0, 4.0, 2.0]


def test_without_steps_nothing_is_said_of_use(known, known_functions):
    found = ancestry_of(known, "r0", 0, known_functions)
    assert found.ancestors[["carried_used", "use"]].isna().all(axis=None)
    assert found.nodes["steps"].isna().all()


def everyone(run):
    last = run.finished - 1
    return [(robot, index) for robot in run.evolving.values() for index in range(run.config.gp.population)], last


def test_nodes_keep_their_names_all_the_way(busy_run):
    """Independent of who is told apart from whom: a node is the same condition or skill in every ancestor."""
    for robot in busy_run.evolving.values():
        bred = breed_again(busy_run, robot, busy_run.finished - 1)
        for index in range(len(bred[-1].codes)):
            found = trace(bred, index)
            there = found.home >= 0
            assert (there[1:] | ~there[:-1]).all()  # nothing that was there goes away on the way to the tree
            for generation, node in np.argwhere(there):
                ancestor = bred[generation].codes[found.home[generation, node]]
                assert ancestor[found.place[generation, node]] == bred[-1].codes[index][node]


def test_nodes_are_where_deap_moved_them(busy_run):
    """Breed with nodes that are objects of their own: DEAP moves them from tree to tree, and their past goes along."""
    settings = busy_run.config
    for role, robot in busy_run.evolving.items():
        functions = busy_run.game.function_set(role)
        population = first_population(settings.gp, functions, seed=settings.seed, robot=role)
        pasts = {}  # by a node's object, in whom it was in each generation since it came into being
        for generation in range(busy_run.finished):
            # New objects in each tree: two children may share those of their parent.
            own = [Individual([copy.copy(node) for node in member]) for member in population]
            pasts = {
                id(node): [*pasts.get(id(before), []), index]
                for index, (mine, member) in enumerate(zip(own, population, strict=True))
                for node, before in zip(mine, member, strict=True)
            }
            rows = busy_run.record(generation, robot).sort_values("index")
            assert [codes_of(one, functions).tolist() for one in own] == [tree.tolist() for tree in rows["tree"]]
            for parent, fitness, depth in zip(own, rows["fitness"], rows["depth"], strict=True):
                parent.fitness.values = (fitness, float(depth))
            kept = own  # its objects have to live for their names to stay theirs
            population = breed(own, settings.gp, functions, seed=settings.seed, generation=generation, robot=role)
        bred = breed_again(busy_run, robot, busy_run.finished - 1)
        for index, member in enumerate(kept):
            home = trace(bred, index).home.T.tolist()
            assert [pasts[id(node)] for node in member] == [[who for who in of if who >= 0] for of in home]


def test_the_numbers_of_a_family_add_up(busy_run):
    members, last = everyone(busy_run)
    operators = set()
    for robot, index in members[::4]:
        found = ancestors(busy_run, robot, last, index)
        table, nodes = found.ancestors, found.nodes
        assert (table["carried"] == table[["from_1", "from_2", "arisen"]].sum(axis=1)).all()
        assert table["arisen"].sum() == table["carried"].iloc[-1] == len(nodes)
        assert table.groupby("generation")["root_line"].sum().eq(1).all()
        for generation, rows in table.groupby("generation"):
            assert rows["carried"].sum() == (nodes["generation"] <= generation).sum()
        arisen = nodes.groupby(["generation", "index"]).size()
        assert table.set_index(["generation", "index"])["arisen"].loc[arisen.index].tolist() == arisen.tolist()
        operators |= set(nodes["operator"])
        assert (nodes["generation"].eq(0) == nodes["operator"].eq("creation")).all()
        assert table["carried"].eq(table["nodes"]).loc[len(table) - 1]
    assert operators == {"creation", "mutation", "crossover"}  # the last by small changes


def test_all_ancestors_are_there(busy_run):
    """By the run's own columns, from child to parents."""
    last = busy_run.finished - 1
    table = busy_run.individuals
    for robot in busy_run.evolving.values():
        of_robot = table[table["robot"] == robot].set_index(["generation", "index"])
        expected, members = set(), {(last, 3)}
        while members:
            expected |= members
            rows = of_robot.loc[sorted(members)]
            parents = pd.concat([rows["parent_1"], rows["parent_2"]])
            members = {(g - 1, parent) for (g, _), parent in parents.items() if parent >= 0}
        found = ancestors(busy_run, robot, last, 3).ancestors
        assert list(zip(found["generation"], found["index"], strict=True)) == sorted(expected)
        told = of_robot.loc[list(zip(found["generation"], found["index"], strict=True))]
        for column in ("operator", "parent_1", "parent_2", "fitness", "nodes", "depth"):
            assert found[column].tolist() == told[column].tolist()


def test_use_is_weighed_by_steps(busy_run):
    last = busy_run.finished - 1
    best = busy_run.record(last, "r0").iloc[0]
    usage = tree_usage(busy_run, last, "r0", int(best["index"]))
    found = ancestors(busy_run, "r0", last, int(best["index"]), node_steps=usage.node_steps)
    assert found.ancestors["use"].iloc[-1] == pytest.approx(1.0)
    assert found.ancestors["carried_used"].iloc[-1] == (usage.node_steps > 0).sum()
    first = found.nodes["generation"] == 0
    share = usage.node_steps[first].sum() / usage.node_steps.sum()
    assert found.ancestors.loc[found.ancestors["generation"] == 0, "use"].sum() == pytest.approx(share)


@pytest.mark.parametrize(
    ("robot", "generation", "index", "message"),
    [
        ("r9", 0, 0, "'r9' does not evolve in this run"),
        ("r0", 99, 0, "has no generation 99"),
        ("r0", 1, 10, "the index of an individual must be from 0 to 9, got 10"),
        ("r0", 1, -1, "the index of an individual must be from 0 to 9, got -1"),
    ],
)
def test_who_is_not_there_is_told(robot, generation, index, message, busy_run):
    with pytest.raises(InputError, match=re.escape(message)):
        ancestors(busy_run, robot, generation, index)
