"""Function sets of any names, for DEAP and as codes; what cannot be one."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coevo.tree import FunctionSet

names = st.from_regex(r"[a-z]\w{0,8}", fullmatch=True).filter(str.isascii)
sets = st.builds(
    lambda asked, terminals: FunctionSet(tuple(f"IF_{name}" for name in asked), tuple(terminals)),
    st.lists(names, min_size=1, max_size=40, unique=True),
    st.lists(names, min_size=1, max_size=40, unique=True),
)


@given(functions=sets)
def test_codes_number_the_functions_then_the_terminals(functions):
    assert [functions.codes[name] for name in functions.names] == list(range(len(functions.names)))
    assert functions.names == functions.functions + functions.terminals


@given(functions=sets)
def test_deap_gets_functions_of_two_branches_and_the_terminals(functions):
    primitives = functions.primitives
    (branching,) = primitives.primitives.values()
    (terminals,) = primitives.terminals.values()
    assert [node.name for node in branching] == list(functions.functions)
    assert {node.arity for node in branching} == {2}
    assert [node.name for node in terminals] == list(functions.terminals)
    assert [node.name for node in functions.nodes] == list(functions.names)


@pytest.mark.parametrize(
    ("functions", "terminals", "message"),
    [
        pytest.param((), ("stay",), "at least one function", id="nothing to ask"),
        pytest.param(("IF_dark",), (), "one terminal", id="nothing to do"),
        pytest.param(("dark",), ("stay",), "got 'dark'", id="a function without the prefix"),
        pytest.param(("IF_dark",), ("IF_stay",), "got 'IF_stay'", id="a terminal with it"),
        pytest.param(("IF_dark",), ("go on",), "got 'go on'", id="a space"),
        pytest.param(("IF_dark",), ("été",), "got 'été'", id="an accent"),
        pytest.param(("IF_dark", "IF_dark"), ("stay",), "once", id="twice"),
        pytest.param(("IF_dark",), tuple(f"t{n}" for n in range(255)), "at most 255 .* got 256", id="too many"),
    ],
)
def test_what_cannot_be_a_function_set_is_refused(functions, terminals, message):
    with pytest.raises(ValueError, match=message):
        FunctionSet(functions, terminals)


def test_255_names_are_a_function_set():
    assert len(FunctionSet(("IF_dark",), tuple(f"t{n}" for n in range(254))).names) == 255


def test_descriptions_are_of_terminals_and_change_nothing_else():
    said = FunctionSet(("IF_dark",), ("go", "stay"), (), {"go": "drives on"})
    assert said.descriptions == {"go": "drives on"}
    silent = FunctionSet(("IF_dark",), ("go", "stay"))
    assert (said, hash(said)) == (silent, hash(silent))
    with pytest.raises(ValueError, match="'walk' is no terminal; they are go, stay"):
        FunctionSet(("IF_dark",), ("go", "stay"), (), {"walk": "goes on foot"})
