"""Flat programs against a naive recursive interpreter; codes that are no trees."""

from __future__ import annotations

import numpy as np
import pytest
from deap import gp
from hypothesis import given
from hypothesis import strategies as st

from coevo.errors import InputError
from coevo.game import function_set
from coevo.tree import Tree, compile_program, from_codes, parse, tree_codes
from coevo.tree.program import measure

trees = st.from_type(Tree)
functions = function_set(0, 3)


def decide(node, true):
    """Return the skill that nested tuples choose where the conditions ``true`` hold, by plain recursion."""
    while not isinstance(node, str):
        node = node[1] if node[0] in true else node[2]
    return node


def walk(program, true):
    """Return the skill that a flat program chooses, as its documentation says."""
    at = 0
    while program.codes[at] >= 0:
        at = at + 1 if functions.names[program.codes[at]] in true else program.second[at]
    return functions.terminals[-1 - program.codes[at]]


@given(tree=trees, data=st.data())
def test_a_program_chooses_what_a_recursive_interpreter_does(tree, data, nested, situations):
    program = compile_program(tree_codes(tree, functions), functions)
    root = nested(tree)
    some = list(situations(data.draw(st.permutations(sorted(tree.objects())))[:3]))
    for true in some:
        assert walk(program, true) == decide(root, true)


@given(tree=trees)
def test_codes_read_back_and_measure_as_deap_does(tree):
    codes = tree_codes(tree, functions)
    assert from_codes(codes, functions) == from_codes(codes.tolist(), functions) == tree
    program, depth = measure(codes, functions)
    of_deap = gp.PrimitiveTree([functions.nodes[code] for code in codes])
    assert depth == tree.depth == of_deap.height
    assert len(program.codes) == tree.nodes == len(of_deap)
    assert program.second.tolist() == list(tree.second)


@given(tree=trees, extra=st.sampled_from(range(39)))
def test_codes_with_one_too_few_or_too_many_are_refused(tree, extra):
    codes = tree_codes(tree, functions)
    for broken in (codes[:-1], np.append(codes, np.uint8(extra))):
        with pytest.raises(InputError, match=f"a stored tree of {len(broken)} nodes is damaged"):
            measure(broken, functions)


@given(codes=st.lists(st.integers(0, 41), max_size=12))
def test_codes_are_a_tree_or_damaged(codes):
    """A sequence of arities is a prefix tree if and only if its walk of arity - 1 first reaches -1 at the end."""
    walked = np.cumsum([1 if code < 35 else -1 for code in codes])
    is_tree = bool(codes) and max(codes) < 39 and walked[-1] == -1 and bool((walked[:-1] >= 0).all())
    if is_tree:
        assert tree_codes(from_codes(codes, functions), functions).tolist() == codes
    else:
        with pytest.raises(InputError, match="is damaged"):
            from_codes(codes, functions)


def test_programs_do_not_depend_on_how_many_functions_there_are():
    small, large = function_set(0, 2), function_set(0, 3)
    tree = parse("IF_r1_is_large(IF_ball_is_lost(search, avoid), IF_own_goal_is_small(shoot, pass))")
    one, two = (compile_program(tree_codes(tree, of), of) for of in (small, large))
    assert np.array_equal(one.codes, two.codes)
    assert np.array_equal(one.second, two.second)
    assert set(one.codes[one.second == 0]) == {-1, -2, -3, -4}


def test_a_tree_that_asks_about_what_a_robot_does_not_see_is_refused():
    tree = parse("IF_r2_is_left(shoot, pass)")
    with pytest.raises(InputError, match="IF_r2_is_left is not in this role's function set") as caught:
        tree_codes(tree, function_set(0, 2))
    assert "Did you mean 'IF_r1_is_left'? Its terminals are shoot, pass, avoid, search" in str(caught.value)
