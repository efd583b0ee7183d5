"""Trees of IF_a_is_b over skills: the function set, the genotype of DEAP, text, flat programs, simplification."""

from coevo.tree.functions import CATEGORIES, SKILLS, FunctionSet, function_set
from coevo.tree.program import Program, compile_program, from_codes, tree_codes
from coevo.tree.simplify import simplify
from coevo.tree.text import Tree, parse

__all__ = [
    "CATEGORIES",
    "SKILLS",
    "FunctionSet",
    "Program",
    "Tree",
    "compile_program",
    "from_codes",
    "function_set",
    "parse",
    "simplify",
    "tree_codes",
]
