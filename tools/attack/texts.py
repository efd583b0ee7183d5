"""Texts that Hypothesis makes: recipes, settings, trees; well-formed outside, anything inside."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, NamedTuple

import msgspec
from hypothesis import strategies as st

from behaviors.recipe import Recipe
from behaviors.recipe import read_recipe as skill_recipe
from coevo.config import RunSettings, check, check_experiment, override, to_toml
from coevo.errors import InputError
from coevo.game import check_playable
from coevo.recipes import read_recipe, recipe_names
from coevo.tree import parse, simplify

__all__ = ["Kind", "altered", "as_toml", "of_settings", "of_trees"]

_numbers = st.integers() | st.floats() | st.sampled_from((0, 1, -1, 2**31, 2**63, 2**64, 1e-300, 1e300, 0.5))
_plain = st.booleans() | _numbers | st.text(max_size=20)
_values = st.recursive(
    _plain, lambda of: st.lists(of, max_size=4) | st.dictionaries(st.text(max_size=8), of, max_size=4), max_leaves=12
)


class Kind(NamedTuple):
    """Inputs of one kind. strategy: that makes them. attempt: reads one; it may raise nothing but ``InputError``."""

    name: str
    strategy: st.SearchStrategy[Any]
    attempt: Callable[[Any], None]


def _spots(data: object, path: tuple[object, ...] = ()) -> Iterator[tuple[object, ...]]:
    """Yield the way to each value within plain data."""
    pairs = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in pairs:
        yield (*path, key)
        yield from _spots(value, (*path, key))


def altered(data: Any) -> st.SearchStrategy[Any]:
    """Return a strategy of plain data in which one to three values are others, lacking, or more."""
    spots, text = list(_spots(data)), json.dumps(data)
    leaf = st.tuples(st.sampled_from(spots), st.sampled_from(("set", "set", "set", "drop", "add")), _values)

    def change(changes: list[tuple[tuple[Any, ...], str, object]]) -> Any:
        copy = json.loads(text)
        for spot, how, value in changes:
            with suppress(LookupError, TypeError):  # what is above it has been changed
                at = copy
                for key in spot[:-1]:
                    at = at[key]
                if how == "drop":
                    del at[spot[-1]]
                elif how == "add":
                    at[f"{spot[-1]}x"] = value
                else:
                    at[spot[-1]] = value
        return copy

    return st.lists(leaf, min_size=1, max_size=3).map(change)


def as_toml(value: object) -> str:
    """Return plain data as a value of TOML, or nearly so."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(str(key))} = {as_toml(of)}" for key, of in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    return repr(value) if isinstance(value, float) else json.dumps(value)


def of_settings() -> list[Kind]:
    """Return recipes of evolution and of skills, and single settings."""
    recipes = {name: read_recipe(name, "evolution") for name in recipe_names("evolution")}
    experiment = msgspec.to_builtins(check_experiment(recipes["smoke"], "smoke"), builtin_types=())
    skill = msgspec.to_builtins(skill_recipe("shoot"))
    keys = st.sampled_from([".".join(map(str, spot)) for spot in _spots(experiment)]) | st.text(max_size=30)

    def evolution(data: Any) -> None:
        settings = check_experiment(data, "hypothesis")
        if isinstance(settings, RunSettings):
            check_playable(settings, ())
        written = tomllib.loads(to_toml(settings))
        assert check_experiment(written, "written") == settings, "settings are not read as they were written"

    def learning(data: Any) -> None:
        recipe = check(Recipe, data, "hypothesis")
        assert check(Recipe, tomllib.loads(to_toml(recipe)), "written") == recipe, "a recipe is not read as written"

    def assignment(given: tuple[str, object, str]) -> None:
        key, value, text = given
        for one in (f"{key}={as_toml(value)}", f"{key}={text}", text):
            with suppress(InputError):
                check_experiment(override(recipes["smoke"], [one]), "hypothesis")

    return [
        Kind("recipes (evolution)", altered(experiment), evolution),
        Kind("recipes (skill)", altered(skill), learning),
        Kind("--set", st.tuples(keys, _values, st.text(max_size=40)), assignment),
    ]


def of_trees() -> Kind:
    """Return texts made of the words of trees."""
    words = st.sampled_from(
        ("IF_ball_is_left", "IF_r1_is_lost", "shoot", "search", "(", ")", ", ", ",", " ", "IF_", "\n")
    )

    def attempt(pieces: list[str]) -> None:
        tree = parse("".join(pieces))
        assert parse(str(tree)) == tree, "a tree is not read as it was written"
        assert simplify(tree).nodes <= tree.nodes, "a simplified tree has grown"

    return Kind("trees", st.lists(words | st.text(max_size=3), max_size=30), attempt)
