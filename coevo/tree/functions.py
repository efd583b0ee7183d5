"""The function set of Table 6.1, for each robot: IF_a_is_b over what it can see, and the skills as terminals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from deap import gp

__all__ = ["CATEGORIES", "SKILLS", "FunctionSet", "function_set"]

CATEGORIES = ("left", "middle", "right", "small", "medium", "large", "lost")
SKILLS = ("shoot", "pass", "avoid", "search")
_MAX_OBJECTS = 9  # seven categories each must fit a 64-bit word


@dataclass(frozen=True)
class FunctionSet:
    """What one robot's trees are made of.

    A node's code is the number of its function (object by object, category by category) or, after all
    functions, of its skill.
    """

    objects: tuple[str, ...]

    @cached_property
    def functions(self) -> tuple[str, ...]:
        """Names IF_object_is_category in the order of their codes."""
        return tuple(f"IF_{thing}_is_{category}" for thing in self.objects for category in CATEGORIES)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of functions, then of skills: a node's name by its code."""
        return self.functions + SKILLS

    @cached_property
    def codes(self) -> dict[str, int]:
        """A node's code by its name."""
        return {name: code for code, name in enumerate(self.names)}

    @cached_property
    def primitives(self) -> gp.PrimitiveSet:
        """The same as DEAP's primitive set, for its generators and operators."""
        primitives = gp.PrimitiveSet("tree", 0)
        for name in self.functions:
            primitives.addPrimitive(_if, 2, name=name)
        for name in SKILLS:
            primitives.addTerminal(name, name=name)
        return primitives

    @cached_property
    def nodes(self) -> tuple[gp.Primitive | gp.Terminal, ...]:
        """DEAP's nodes by code."""
        mapping = self.primitives.mapping
        return tuple(mapping[name] for name in self.names)


def _if(_first: object, _second: object) -> None:  # pragma: no cover - DEAP wants a callable; programs run compiled
    """Stand for IF_a_is_b in DEAP's primitive set; never called."""


def function_set(robot: int, robots: int) -> FunctionSet:
    """Return the function set of one of ``robots`` robots: 28 functions with two, 35 with three (6.4.1, 6.4.2)."""
    others = tuple(f"r{other}" for other in range(robots) if other != robot)
    objects = ("ball", "own_goal", "opponent_goal", *others)
    if len(objects) > _MAX_OBJECTS:
        raise ValueError(f"expected at most {_MAX_OBJECTS - 2} robots, got {robots}")
    return FunctionSet(objects)
