"""What the trees of soccer robots are made of, and the trees that settings give to robots for good."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from coevo.config import RunSettings
from coevo.errors import InputError
from coevo.skill import skill_description
from coevo.soccer.conditions import Condition, function_names, soccer_conditions, things_of
from coevo.tree import FunctionSet, Program, Tree, compile_program, object_situations, parse, tree_codes
from coevo.vocabulary import SKILLS

__all__ = ["function_set", "function_sets", "given_programs", "given_trees"]


def function_set(
    robot: int,
    robots: int,
    added: Iterable[Condition] = (),
    terminals: Sequence[str] = SKILLS,
    descriptions: Mapping[str, str] | None = None,
) -> FunctionSet:
    """Return the function set of one of ``robots`` robots: 28 functions with two, 35 with three (6.4.1, 6.4.2).

    Args:
        robot, robots: who asks, and how many there are.
        added: conditions beside those of Table 6.1; their functions come after all of these.
        terminals: names of the skills.
        descriptions: what the skills do, in words.
    """
    situations = tuple(object_situations(thing) for thing in things_of(robot, robots))
    return FunctionSet(function_names(robot, robots, added), tuple(terminals), situations, descriptions or {})


def function_sets(settings: RunSettings) -> tuple[FunctionSet, ...]:
    """Return what the trees of each robot of an experiment are made of."""
    _, added = soccer_conditions(settings.categories, settings.conditions)
    robots, terminals = len(settings.players), settings.terminals
    said = {name: words for name, source in terminals.items() if (words := skill_description(source))}
    return tuple(function_set(robot, robots, added, tuple(terminals), said) for robot in range(robots))


def given_trees(settings: RunSettings) -> list[Tree | None]:
    """Return for each robot the tree that its settings give it, None where they do not.

    Raises:
        InputError: a tree cannot be read, or asks or chooses what its robot does not know.
    """
    found: list[Tree | None] = [None] * len(settings.players)
    if all(player.control != "tree" for player in settings.players):
        return found  # what follows reads skills
    for number, (player, functions) in enumerate(zip(settings.players, function_sets(settings), strict=True)):
        try:
            found[number] = parse(player.tree, functions) if player.control == "tree" else None
        except InputError as error:
            raise InputError(f"players.{number}.{error}") from None
    return found


def given_programs(settings: RunSettings) -> list[Program | None]:
    """Return ``given_trees`` as flat programs."""
    trees = given_trees(settings)
    if not any(trees):
        return [None] * len(trees)
    return [
        None if tree is None else compile_program(tree_codes(tree, functions), functions)
        for tree, functions in zip(trees, function_sets(settings), strict=True)
    ]
