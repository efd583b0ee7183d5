"""coevo inspect: trees with how often each branch was used."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

import pytest

from coevo.portrait import portrait
from coevo.tree import parse, simplify
from coevo.tree.fold import fold_tree
from coevo.usage import used_tree


@pytest.mark.parametrize(("robot", "generation", "rank"), [("r0", 2, 0), ("r1", 0, 3), ("r2", 1, 5)])
def test_inspect_tells_what_the_run_holds(robot, generation, rank, coevo, small_run, one_object):
    arguments = ["--robot", robot, "--generation", generation, "--rank", rank]
    data = one_object(coevo("inspect", small_run.path, *arguments, "--json"))
    tree, row = small_run.tree(robot, generation, rank), small_run.record(generation, robot).iloc[rank]
    smaller = simplify(tree)
    expected = {
        "robot": robot,
        "generation": generation,
        "rank": rank,
        "tree": str(tree),
        "depth": tree.depth,
        "nodes": tree.nodes,
        "fitness": row["fitness"],
        "simplified": {"tree": str(smaller), "depth": smaller.depth, "nodes": smaller.nodes},
    }
    assert {name: data[name] for name in expected} == expected
    assert parse(data["tree"]) == tree
    assert set(data["skill_use"]) == {"shoot", "pass", "avoid", "search"}
    assert sum(data["skill_use"].values()) == pytest.approx(1.0)
    assert data["steps"] == row["steps"]  # its games are played again


def test_skills_are_used_as_often_as_the_leaves_are_passed(coevo, small_run, one_object):
    data = one_object(coevo("inspect", small_run.path, "--json"))
    tree = parse(data["tree"])
    for skill, share in data["skill_use"].items():
        passed = sum(steps for name, steps in zip(tree.names, data["node_steps"], strict=True) if name == skill)
        assert share == pytest.approx(passed / data["steps"])
    for node, second in enumerate(tree.second):
        if second:
            assert data["node_steps"][node] == data["node_steps"][node + 1] + data["node_steps"][second]


def test_inspect_shows_the_best_of_the_last_generation_by_default(coevo, small_run, one_object):
    data = one_object(coevo("inspect", small_run.path, "--format", "json"))
    assert (data["robot"], data["generation"], data["rank"]) == ("r0", 2, 0)


@pytest.mark.parametrize("simplified", [False, True])
def test_inspect_draws_every_node_if_told_to(simplified, coevo, small_run):
    tree = small_run.tree("r1", 2)
    shown = simplify(tree) if simplified else tree
    arguments = ["--robot", "r1", "--all", *(["--simplified"] if simplified else [])]
    text = coevo("inspect", small_run.path, *arguments).out
    assert f"the tree: depth {tree.depth}, nodes {tree.nodes}" in text
    lines = text.partition("simplified: depth")[2]
    assert len(re.findall(r"^ *[<>]?[\d.]+%  ", lines, re.MULTILINE)) == shown.nodes
    dot = coevo("inspect", small_run.path, *arguments, "--format", "dot").out
    assert dot.startswith("digraph")
    assert len(re.findall(r"^  n\d+ \[", dot, re.MULTILINE)) == shown.nodes
    assert len(boxes_of(coevo("inspect", small_run.path, *arguments, "--format", "svg").out)) == shown.nodes


def boxes_of(svg):
    """Return the kinds of the boxes in a picture."""
    rects = ET.fromstring(svg).iter("{http://www.w3.org/2000/svg}rect")  # noqa: S314 - our own
    return [rect.get("class") for rect in rects if rect.get("class") != "paper"]


def test_inspect_folds_what_was_hardly_used(coevo, small_run, refused):
    arguments = ["inspect", small_run.path, "--robot", "r1", "--generation", 0, "--rank", 1, "--format", "svg"]
    whole, usual, most = (boxes_of(coevo(*arguments, *more).out) for more in (["--all"], [], ["--fold", "0.9"]))
    used = used_tree(small_run, "r1", 0, 1)
    for share, boxes in ((None, whole), (0.005, usual), (0.9, most)):
        assert boxes.count("question") == sum(
            part.kind == "question" for part in fold_tree(used.tree, used.usage.node_steps, share)
        )
    assert len(whole) > len(usual) >= len(most)
    refused(coevo("inspect", small_run.path, "--all", "--fold", "0.1"), "--all folds nothing")


def test_inspect_begins_with_what_the_robot_does(coevo, small_run):
    used = used_tree(small_run, "r2")
    text = coevo("inspect", small_run.path, "--robot", "r2").out
    head, said = text.split("\n\n", 1)
    assert head == f"r2, generation 2, rank 0: fitness {used.fitness:.4f}"
    assert said.startswith("r2 plays ")
    assert portrait(used, f"coevo play {small_run.path} --generation 2 --games 1000") in said
    (best,) = [name for name, share in used.usage.skill_use.items() if share == max(used.usage.skill_use.values())]
    assert f"\n{best} {used.usage.skill_use[best]:.1%}: " in said  # what the skill does, from its card


def test_rules_of_inspect_say_how_each_terminal_was_used(coevo, small_run, one_object):
    data = one_object(coevo("inspect", small_run.path, "--robot", "r1", "--generation", 0, "--json"))
    for rules in (data["rules"], data["rules_in_use"]):
        assert {frozenset(rule) for rule in rules} == {frozenset({"when", "terminal", "share"})}
        for name, share in data["skill_use"].items():
            assert sum(rule["share"] for rule in rules if rule["terminal"] == name) == pytest.approx(share)
    assert len(data["rules"]) == (data["simplified"]["nodes"] + 1) // 2
    assert all(rule["share"] > 0.0 for rule in data["rules_in_use"])
    assert data["never_used"] == data["node_steps"].count(0)
    rows = small_run.record(0, "r1")["fitness"]
    assert data["generation_fitness"] == pytest.approx(
        {"individuals": 6, "best": rows.min(), "mean": rows.mean(), "worst": rows.max()}
    )
    assert set(data["descriptions"]) == {"shoot", "pass", "avoid", "search"}
