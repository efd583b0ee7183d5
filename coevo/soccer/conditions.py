"""Conditions: what a robot can ask about what it sees, each declared once, as a name and an expression.

An expression is ``lost``, ``visible``, or comparisons of an object's features joined by ``and``, such as
``"area >= 400 and x >= 20 and x < 44"``. A side of a comparison may add features and multiply them by numbers. Limits
are taken in below and left out above, so that ranges that meet neither overlap nor leave a gap: only ``>=`` and ``<``
are read. Whatever compares holds only while its object is visible.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.config import CategorySettings, ConditionSettings
from coevo.errors import InputError, nearest_name
from coevo.soccer.camera import FEATURES
from coevo.vocabulary import PREFIX, THINGS

__all__ = [
    "AREA",
    "OBJECTS",
    "Condition",
    "ConditionTable",
    "Expression",
    "Term",
    "condition_table",
    "function_names",
    "read_expression",
    "soccer_conditions",
    "things_of",
]

# What can be asked about, and what each shows: the camera's rows, in their order.
OBJECTS: dict[str, tuple[str, ...]] = {
    "ball": ("x", "y", "radius", "area"),
    "own_goal": (
        *("x", "y", "upper_left_x", "upper_left_y", "upper_right_x", "upper_right_y"),
        *("lower_left_x", "lower_left_y", "lower_right_x", "lower_right_y", "area"),
    ),
    "opponent_goal": (
        *("x", "y", "upper_left_x", "upper_left_y", "upper_right_x", "upper_right_y"),
        *("lower_left_x", "lower_left_y", "lower_right_x", "lower_right_y", "area"),
    ),
    "robot": ("x", "y", "width", "height", "area"),
}
AREA = FEATURES  # the number of the area as a feature of its own: every object has one, each in another place
_OPERATORS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}


@dataclass(frozen=True)
class Condition:
    """A question about an object.

    Attributes:
        name: of the functions ``IF_object_is_name`` that it becomes.
        objects: what it can be asked about, of OBJECTS; ``robot`` stands for every other robot.
        expression: when it holds; see the module.
    """

    name: str
    objects: tuple[str, ...]
    expression: str


class Term(NamedTuple):
    """A comparison: it holds while ``low <= value < high``.

    feature: which feature the value is, AREA for the area, -1 for the sum of all features times ``weights`` (11,).
    """

    feature: int
    weights: tuple[float, ...]
    low: float
    high: float


class Expression(NamedTuple):
    """An expression that was read: terms that all have to hold while the object is visible, or that it is lost."""

    lost: bool
    terms: tuple[Term, ...]


class ConditionTable(NamedTuple):
    """All conditions of all robots for compiled code; functions in the order of ``function_names``.

    thing: (robots, C) int64, which of the camera's objects function c of a robot asks about.
    wants: (robots, C) int64, 0 if it holds while that is lost, 1 if it must be visible and the terms must hold.
    first, terms: (robots, C) int64, where its terms begin below, and how many there are.
    feature: (T,) int64, 0 to 10, AREA for the area, -1 for the sum of features times weights.
    weights: (T, 11) float64. low, high: (T,) float64; a term holds while low <= value < high.
    """

    thing: NDArray[np.int64]
    wants: NDArray[np.int64]
    first: NDArray[np.int64]
    terms: NDArray[np.int64]
    feature: NDArray[np.int64]
    weights: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


# --------------------------------------------------------------------------------------------------- declarations


def _standard(limits: CategorySettings) -> tuple[Condition, ...]:
    """Return the seven conditions of Table 6.1, each object's in the order of the table."""
    left, right = limits.left_below_px, limits.right_from_px
    everything = tuple(OBJECTS)
    sizes = (
        (("ball",), limits.ball_small_below_px, limits.ball_large_from_px),
        (("own_goal", "opponent_goal"), limits.goal_small_below_px, limits.goal_large_from_px),
        (("robot",), limits.robot_small_below_px, limits.robot_large_from_px),
    )
    # Where limits cross, what is left is not right, and what is small is not large.
    places = (
        Condition("left", everything, f"x < {left!r}"),
        Condition("middle", everything, f"x >= {left!r} and x < {right!r}"),
        Condition("right", everything, f"x >= {max(left, right)!r}"),
    )
    areas = tuple(
        condition
        for things, small, large in sizes
        for condition in (
            Condition("small", things, f"area < {small!r}"),
            Condition("medium", things, f"area >= {small!r} and area < {large!r}"),
            Condition("large", things, f"area >= {max(small, large)!r}"),
        )
    )
    return (*places, *areas, Condition("lost", everything, "lost"))


def soccer_conditions(
    categories: CategorySettings, added: Mapping[str, ConditionSettings]
) -> tuple[tuple[Condition, ...], tuple[Condition, ...]]:
    """Return the conditions of Table 6.1, and those that settings add."""
    return _standard(categories), tuple(
        Condition(name, settings.objects, settings.expression) for name, settings in added.items()
    )


def things_of(robot: int, robots: int) -> tuple[str, ...]:
    """Return the names of what ``robot`` can ask about, in the order of the camera's objects."""
    return (*THINGS, *(f"r{other}" for other in range(robots) if other != robot))


def _kind(thing: str) -> str:
    return thing if thing in THINGS else "robot"


def _asked(things: Sequence[str], conditions: Iterable[Condition]) -> list[tuple[int, Condition]]:
    """Return what is asked about which of the things: thing by thing, condition by condition."""
    conditions = list(conditions)
    return [(n, c) for n, thing in enumerate(things) for c in conditions if _kind(thing) in c.objects]


def function_names(robot: int, robots: int, added: Iterable[Condition] = ()) -> tuple[str, ...]:
    """Return the functions of one of ``robots`` robots: those of Table 6.1, then those that settings add.

    There are 28 of Table 6.1 with two robots, 35 with three (6.4.1, 6.4.2).
    """
    things = things_of(robot, robots)
    asked = [*_asked(things, _standard(CategorySettings())), *_asked(things, added)]
    return tuple(f"{PREFIX}{things[n]}_is_{condition.name}" for n, condition in asked)


def condition_table(
    robots: int, categories: CategorySettings, added: Mapping[str, ConditionSettings]
) -> ConditionTable:
    """Return the conditions of all robots for compiled code.

    Raises:
        InputError: an expression cannot be read.
    """
    standard, more = soccer_conditions(categories, added)
    terms: list[Term] = []
    place: dict[tuple[str, Condition], tuple[int, int, int]] = {}
    for condition in (*standard, *more):
        for kind in condition.objects:
            read = read_expression(condition.expression, kind, f"conditions.{condition.name}")
            place[kind, condition] = int(not read.lost), len(terms), len(read.terms)
            terms += read.terms
    rows = []
    for robot in range(robots):
        things = things_of(robot, robots)
        asked = [*_asked(things, standard), *_asked(things, more)]
        rows.append([(n, *place[_kind(things[n]), condition]) for n, condition in asked])
    thing, wants, first, count = np.moveaxis(np.array(rows, np.int64).reshape(robots, -1, 4), 2, 0).copy()
    return ConditionTable(
        thing=thing,
        wants=wants,
        first=first,
        terms=count,
        feature=np.array([term.feature for term in terms], np.int64),
        weights=np.array([term.weights for term in terms], np.float64).reshape(-1, FEATURES),
        low=np.array([term.low for term in terms]),
        high=np.array([term.high for term in terms]),
    )


# -------------------------------------------------------------------------------------------------------- reading


class _UnreadableError(Exception):
    """A part of an expression that means nothing here; says what was expected."""


def read_expression(text: str, thing: str, where: str) -> Expression:
    """Read when a condition holds.

    Args:
        text: the expression.
        thing: what it is asked about, of OBJECTS: its features are the names in it.
        where: the setting that it comes from, for messages.

    Raises:
        InputError: it cannot be read; says which part, and what can.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InputError(f"{where}: cannot read {text!r}; write comparisons such as 'x >= 20 and x < 44'") from None
    if isinstance(tree, ast.Name) and tree.id in ("lost", "visible"):
        return Expression(tree.id == "lost", ())
    parts = tree.values if isinstance(tree, ast.BoolOp) and isinstance(tree.op, ast.And) else [tree]
    try:
        return Expression(False, tuple(_term(part, thing) for part in parts))
    except _UnreadableError as error:
        raise InputError(f"{where}: cannot read {text!r}: {error}") from None
    except (RecursionError, OverflowError):
        raise InputError(f"{where}: cannot read an expression as long as {text[:40]!r}...") from None


def _term(node: ast.expr, thing: str) -> Term:
    if not isinstance(node, ast.Compare):
        raise _UnreadableError(
            f"expected comparisons joined by 'and', or 'lost' or 'visible' alone, got {ast.unparse(node)!r}"
        )
    if len(node.ops) > 1:
        raise _UnreadableError(f"write {ast.unparse(node)!r} as two comparisons joined by 'and'")
    sign = _OPERATORS.get(type(node.ops[0]), "")
    if sign not in ("<", ">="):
        remedy = {"<=": "<", ">": ">="}.get(sign)
        raise _UnreadableError(
            f"a limit is taken in below and left out above, so only '>=' and '<' are read; got {ast.unparse(node)!r}"
            + (f", write {remedy!r}" if remedy else "")
        )
    left, right = _linear(node.left, thing), _linear(node.comparators[0], thing)
    weights = left[0] - right[0] + 0.0  # no minus zeros
    limit = right[1] - left[1]
    if not weights.any():
        raise _UnreadableError(f"there is no feature in {ast.unparse(node)!r}")
    if not np.isfinite(weights).all() or not math.isfinite(limit):
        raise _UnreadableError(f"expected finite numbers in {ast.unparse(node)!r}")
    feature = -1
    (used,) = np.nonzero(weights)
    if len(used) == 1 and weights[used[0]] == 1.0:
        feature = AREA if OBJECTS[thing][used[0]] == "area" else int(used[0])
    low, high = (-math.inf, limit) if sign == "<" else (limit, math.inf)
    return Term(feature, tuple(weights.tolist()), low, high)


def _linear(node: ast.expr, thing: str) -> tuple[NDArray[np.float64], float]:
    """Return the weights (11,) of the features, and the constant, of a sum of features times numbers."""
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return np.zeros(FEATURES), float(number)
        case ast.Name(id=name):
            features = OBJECTS[thing]
            if name not in features:
                raise _UnreadableError(
                    f"the {thing.replace('_', ' ')} has no {name!r}.{nearest_name(name, features)}"
                    f" It has {', '.join(features)}"
                )
            return np.eye(FEATURES)[features.index(name)], 0.0
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as op, operand=operand):
            weights, constant = _linear(operand, thing)
            return (-weights, -constant) if isinstance(op, ast.USub) else (weights, constant)
        case ast.BinOp(left=one, op=ast.Add() | ast.Sub() as op, right=two):
            (weights, constant), (more, other) = _linear(one, thing), _linear(two, thing)
            return (weights + more, constant + other) if isinstance(op, ast.Add) else (weights - more, constant - other)
        case ast.BinOp(left=one, op=ast.Mult(), right=two):
            (weights, constant), (more, other) = _linear(one, thing), _linear(two, thing)
            if not (weights.any() and more.any()):
                return weights * other + more * constant, constant * other
        case ast.BinOp(left=one, op=ast.Div(), right=two):
            (weights, constant), (more, other) = _linear(one, thing), _linear(two, thing)
            if not more.any() and other != 0.0:
                return weights / other, constant / other
    raise _UnreadableError(f"expected features added up, each times a number, got {ast.unparse(node)!r}")
