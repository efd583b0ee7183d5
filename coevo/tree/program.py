"""Trees as flat programs that a game walks from the root to one leaf."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import entry
from coevo.errors import InputError, nearest_name
from coevo.tree.functions import FunctionSet
from coevo.tree.text import Tree

__all__ = ["Program", "compile_program", "from_codes", "measure", "tree_codes"]


class Program(NamedTuple):
    """A tree in prefix order.

    codes: (nodes,) int16, the number of the function, from 0, or -1 - k for terminal k: a program does not depend on
        how many functions there are.
    second: (nodes,) int32, where the second branch begins; the first begins at the next node.
    """

    codes: NDArray[np.int16]
    second: NDArray[np.int32]


@entry
def _link(
    codes: NDArray[np.uint8], functions: int, names: int, program: NDArray[np.int16], second: NDArray[np.int32]
) -> int:
    """Fill program and second branches from prefix codes; return the depth, or -1 if they are no tree."""
    nodes = codes.shape[0]
    waiting = np.empty(nodes + 1, np.int32)
    depth, deepest = 0, 0
    for i in range(nodes):
        if i > 0 and depth == 0:
            return -1
        code = int(codes[i])
        second[i] = 0
        if code < functions:
            program[i] = code
            waiting[depth] = i
            depth += 1
            continue
        if code >= names:
            return -1
        program[i] = functions - 1 - code
        deepest = max(deepest, depth)
        while depth > 0 and second[waiting[depth - 1]] > 0:
            depth -= 1
        if depth > 0:
            second[waiting[depth - 1]] = i + 1
        elif i < nodes - 1:
            return -1
    if depth > 0 or nodes == 0:
        return -1
    return deepest


def compile_program(codes: NDArray[np.uint8], functions: FunctionSet) -> Program:
    """Return the flat program of a tree given as (nodes,) codes in prefix order.

    Example:
        >>> from coevo.tree import FunctionSet, compile_program, parse, tree_codes
        >>> functions = FunctionSet(("IF_dark",), ("yes", "no"))
        >>> program = compile_program(tree_codes(parse("IF_dark(yes, no)", functions), functions), functions)
        >>> program.codes.tolist(), program.second.tolist()
        ([0, -1, -2], [2, 0, 0])
    """
    return measure(codes, functions)[0]


def measure(codes: NDArray[np.uint8], functions: FunctionSet) -> tuple[Program, int]:
    """Return the flat program and the depth of a tree given as (nodes,) codes in prefix order.

    Raises:
        InputError: the codes are no tree.
    """
    program, second = np.empty(len(codes), np.int16), np.empty(len(codes), np.int32)
    count, names = len(functions.functions), len(functions.names)
    depth = _link(np.ascontiguousarray(codes, np.uint8), count, names, program, second)
    if depth < 0:
        raise InputError(f"a stored tree of {len(codes)} nodes is damaged: its codes do not make a tree")
    return Program(program, second), int(depth)


def tree_codes(tree: Tree, functions: FunctionSet) -> NDArray[np.uint8]:
    """Return the node codes of a tree in prefix order.

    Raises:
        InputError: the tree holds a name that is not in the function set.
    """
    try:
        return np.array([functions.codes[name] for name in tree.names], np.uint8)
    except KeyError as error:
        name = str(error.args[0])
        raise InputError(
            f"tree: {name} is not in this role's function set.{nearest_name(name, functions.names)}"
            f" Its terminals are {', '.join(functions.terminals)}"
        ) from None


def from_codes(codes: Sequence[int] | NDArray[np.uint8], functions: FunctionSet) -> Tree:
    """Return the tree of prefix codes."""
    given = np.asarray(codes)
    if given.size and (given.min() < 0 or given.max() > 255):
        raise InputError("a stored tree is damaged: its codes do not make a tree")
    measure(given.astype(np.uint8), functions)
    return Tree(tuple(functions.names[int(code)] for code in codes))
