"""Trees as text, against a recursive writer; and texts that are no trees."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from coevo.errors import InputError
from coevo.tree import FunctionSet, Tree, parse
from coevo.vocabulary import SKILLS

trees = st.from_type(Tree)
CHAIN = 3000


def written(node):
    return node if isinstance(node, str) else f"{node[0]}({written(node[1])}, {written(node[2])})"


def depth_of(node):
    return 0 if isinstance(node, str) else 1 + max(depth_of(node[1]), depth_of(node[2]))


def nodes_of(node):
    return 1 if isinstance(node, str) else 1 + nodes_of(node[1]) + nodes_of(node[2])


def in_prefix_order(node, depth=0):
    """Yield the subtree and the depth of every node."""
    yield node, depth
    if not isinstance(node, str):
        yield from in_prefix_order(node[1], depth + 1)
        yield from in_prefix_order(node[2], depth + 1)


@given(tree=trees)
def test_text_is_that_of_a_recursive_writer_and_reads_back(tree, nested):
    text = str(tree)
    assert text == written(nested(tree))
    assert parse(text) == tree


@given(tree=trees)
def test_depth_and_nodes_are_the_recursive_ones(tree, nested):
    root = nested(tree)
    assert tree.depth == depth_of(root)
    assert tree.nodes == len(tree) == nodes_of(root)
    assert tree.depths == tuple(depth for _, depth in in_prefix_order(root))


@given(tree=trees)
def test_second_branches_begin_after_the_first(tree, nested):
    expected = [
        0 if isinstance(node, str) else position + 1 + nodes_of(node[1])
        for position, (node, _) in enumerate(in_prefix_order(nested(tree)))
    ]
    assert list(tree.second) == expected


@given(tree=trees)
def test_objects_are_those_that_conditions_name(tree):
    mentioned = {thing for thing in ("ball", "own_goal", "opponent_goal", "r1", "r2") if f"IF_{thing}_is" in str(tree)}
    assert tree.objects() == mentioned


def test_the_example_of_the_documentation():
    tree = parse("IF_ball_is_left(shoot, IF_ball_is_lost(search, avoid))")
    assert tree.names == ("IF_ball_is_left", "shoot", "IF_ball_is_lost", "search", "avoid")
    assert (tree.depth, tree.nodes, tree.depths) == (2, 5, (0, 1, 1, 2, 2))


@pytest.mark.parametrize("skill", SKILLS)
def test_a_single_skill_is_a_tree_of_depth_0(skill):
    tree = parse(skill)
    assert (str(tree), tree.depth, tree.nodes, tree.objects()) == (skill, 0, 1, set())


@given(tree=trees, spaces=st.lists(st.sampled_from(["", " ", "\n", "\t  "]), min_size=1, max_size=5))
def test_white_space_between_words_means_nothing(tree, spaces):
    text = str(tree).replace(" ", "")
    for number, mark in enumerate("(),"):
        space = spaces[number % len(spaces)]
        text = text.replace(mark, f"{space}{mark}{space}")
    assert parse(spaces[0] + text + spaces[-1]) == tree


def test_trees_deeper_than_pythons_stack_are_read_and_written():
    text = "IF_ball_is_left(" * CHAIN + "shoot" + ", pass)" * CHAIN
    tree = parse(text)
    assert tree.depth == CHAIN
    assert str(tree) == text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param("", "the text ends where a node was expected", id="empty"),
        pytest.param("  ", "the text ends where a node was expected", id="blank"),
        pytest.param("IF_ball_is_left", r"the text ends where '\(' was expected", id="no branches"),
        pytest.param("IF_ball_is_left(", "the text ends where a node was expected", id="opened"),
        pytest.param("IF_ball_is_left(shoot", "the text ends where ',' was expected", id="one branch"),
        pytest.param("IF_ball_is_left(shoot, pass", r"the text ends where '\)' was expected", id="not closed"),
        pytest.param("IF_ball_is_left(shoot)", r"expected ',' at character 22, got '\)'", id="one branch, closed"),
        pytest.param("IF_ball_is_left(shoot, pass, avoid)", r"expected '\)' at character 28, got ','", id="three"),
        pytest.param("IF_ball_is_left shoot, pass", r"expected '\(' at character 17, got 'shoot'", id="no bracket"),
        pytest.param("shoot(pass, avoid)", r"expected the end .*character \d+, got '\('", id="skill with branches"),
        pytest.param("shoot pass", r"expected the end .*character \d+, got 'pass'", id="two trees"),
        pytest.param("(shoot)", r"expected IF_... or a terminal .*at character 1, got '\('", id="bracket first"),
        pytest.param("IF_ball_is_left(, pass)", r"expected IF_.* at character 17, got ','", id="branch left out"),
        pytest.param("shot", "unknown name 'shot' at character 1. Did you mean 'shoot'?", id="skill misspelt"),
        pytest.param(
            "IF_ball_is_left(shoot, IF_ball_is_lst(search, avoid))",
            "unknown name 'IF_ball_is_lst' at character 24. Did you mean 'IF_ball_is_lost'?",
            id="category misspelt",
        ),
        pytest.param(
            "IF_bal_is_left(shoot, pass)", "'IF_bal_is_left' at character 1. Did you mean 'IF_ball_is", id="object"
        ),
        pytest.param("if_ball_is_left(shoot, pass)", "Did you mean 'IF_ball_is_left'?", id="small letters"),
        pytest.param("shoot;", "unexpected ';' at character 6", id="semicolon"),
        pytest.param("IF_ball_is_left(shoot,7)", "unexpected '7' at character 23", id="number"),
        pytest.param(
            "IF_ball_is_left(shoot, 7)",
            "unexpected '7' at character 24",
            id="number after a space",
        ),
    ],
)
def test_a_broken_text_says_what_was_expected_and_where(text, message):
    with pytest.raises(InputError, match=message) as caught:
        parse(text)
    assert str(caught.value).startswith("tree: ")
    assert "\n" not in str(caught.value)


@given(tree=trees, data=st.data())
def test_no_beginning_of_a_tree_is_a_tree_but_its_first_word(tree, data):
    text = str(tree)
    cut = data.draw(st.integers(0, len(text) - 1))
    with pytest.raises(InputError):
        parse(text[:cut])


words = st.sampled_from([*"(), \n;7é", *SKILLS, "IF_ball_is_left", "IF_r1_is_lost", "IF_"])


@given(text=st.lists(words, max_size=12).map("".join))
@example("shoot\x00")
def test_any_text_is_a_tree_or_an_input_error(text):
    try:
        tree = parse(text)
    except InputError as error:
        assert str(error).startswith("tree: ")  # noqa: PT017 - the other way is no error at all
    else:
        assert parse(str(tree)) == tree


def test_a_text_is_checked_against_the_names_that_are_given():
    functions = FunctionSet(("IF_dark",), ("go", "stay"))
    tree = parse("IF_dark(go, IF_dark(stay, go))", functions)
    assert parse(str(tree), functions) == tree
    with pytest.raises(InputError, match=r"unknown name 'IF_drak' at character 1\. Did you mean 'IF_dark'\?"):
        parse("IF_drak(go, stay)", functions)
    with pytest.raises(InputError, match=r"a terminal \(go, stay\) at character 1"):
        parse("(go)", functions)
    with pytest.raises(InputError, match="unknown name 'shoot'"):
        parse("shoot", functions)
