"""Trees of questions over terminals: the function set, the genotype of DEAP, text, flat programs, simplification."""

from coevo.tree.functions import FunctionSet, Situations
from coevo.tree.program import Program, compile_program, from_codes, tree_codes
from coevo.tree.simplify import simplify
from coevo.tree.situations import object_situations
from coevo.tree.text import Tree, parse

__all__ = [
    "FunctionSet",
    "Program",
    "Situations",
    "Tree",
    "compile_program",
    "from_codes",
    "object_situations",
    "parse",
    "simplify",
    "tree_codes",
]
