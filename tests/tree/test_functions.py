"""The function set of Table 6.1 against the table itself and the counts of section 6.4."""

from __future__ import annotations

import pytest

from coevo.tree import CATEGORIES, SKILLS, function_set

GOALS_AND_BALL = ("ball", "own_goal", "opponent_goal")


@pytest.mark.parametrize(("robots", "functions"), [(2, 28), (3, 35)])
def test_two_robots_have_28_functions_and_three_have_35(robots, functions):
    for robot in range(robots):
        names = function_set(robot, robots).functions
        assert len(names) == len(set(names)) == functions


def test_categories_and_terminals_are_those_of_table_6_1():
    assert CATEGORIES == ("left", "middle", "right", "small", "medium", "large", "lost")
    assert SKILLS == ("shoot", "pass", "avoid", "search")


@pytest.mark.parametrize("robot", [0, 1, 2])
def test_a_robot_asks_about_everything_but_itself(robot):
    others = tuple(f"r{i}" for i in range(3) if i != robot)
    functions = function_set(robot, 3)
    assert functions.objects == GOALS_AND_BALL + others
    expected = {f"IF_{a}_is_{b}" for a in GOALS_AND_BALL + others for b in CATEGORIES}
    assert set(functions.functions) == expected


def test_codes_number_the_names_object_by_object_then_skills():
    functions = function_set(1, 2)
    assert [functions.codes[name] for name in functions.names] == list(range(32))
    assert functions.codes["IF_own_goal_is_left"] == len(CATEGORIES)
    assert functions.names[-len(SKILLS) :] == SKILLS


def test_deap_gets_functions_of_two_branches_and_four_terminals():
    functions = function_set(0, 3)
    primitives = functions.primitives
    (branching,) = primitives.primitives.values()
    (terminals,) = primitives.terminals.values()
    assert [node.name for node in branching] == list(functions.functions)
    assert {node.arity for node in branching} == {2}
    assert [node.name for node in terminals] == list(SKILLS)
    assert [node.name for node in functions.nodes] == list(functions.names)


def test_more_objects_than_a_word_of_predicates_holds_are_refused():
    assert len(function_set(0, 7).functions) == 63  # bits
    with pytest.raises(ValueError, match="at most 7 robots, got 8"):
        function_set(0, 8)
