"""Recipes that came with the installation: TOML files that are read by name, whatever folder one is in.

``coevo/presets`` holds the presets, and ``runs`` what the dissertation's experiments are repeated with: ``smoke`` is
``presets/smoke.toml``, and ``chapter3/schedule`` is ``runs/chapter3/schedule.toml``. In an installed wheel both lie in
``coevo/presets``. The recipes of the installed skills stand beside the skills; see ``behaviors.recipe``.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

from coevo.config import EvolutionSettings, FileSettings, check, check_experiment, file_kind, override, read_toml
from coevo.errors import InputError, nearest_name

__all__ = ["is_path", "read_experiment", "read_recipe", "read_settings", "recipe_names", "recipe_path"]

_S = TypeVar("_S", bound=FileSettings)
_LEFT = {"config.toml", "recipe.toml"}  # what a run and a learned skill have kept of theirs


def _folders() -> list[Path]:
    """Return the recipes of ``runs``, in a checkout, and the presets, which come last and win."""
    package = Path(str(files("coevo")))
    checkout = package.parent
    return [*([checkout / "runs"] if (checkout / "pyproject.toml").is_file() else []), package / "presets"]


def _found() -> dict[str, Path]:
    """Return all recipes by name; what runs have left in ``runs`` is none."""
    paths = {
        path.relative_to(folder).with_suffix("").as_posix(): path
        for folder in _folders()
        for path in sorted([*folder.glob("*.toml"), *folder.glob("*/*.toml")])
    }
    return {name: path for name, path in paths.items() if path.name not in _LEFT and not _is_record(path)}


def _is_record(path: Path) -> bool:
    """Tell whether a file is what a study has written about itself into its folder: that has its table, or will."""
    if path.name != "study.toml":
        return False
    try:
        return (path.parent / "table.csv").exists() or bool(read_toml(path).get("conditions"))
    except InputError:
        return False


def recipe_names(kind: str) -> list[str]:
    """Return the names of all recipes of a kind: "evolution", "skill", "schedule" or "study".

    Example:
        >>> from coevo.recipes import recipe_names
        >>> [name for name in recipe_names("evolution") if "/" not in name]
        ['smoke', 'stationary-opponent', 'three-learners', 'two-learners']
    """
    return sorted(name for name, path in _found().items() if _kind_of(path) == kind)


def _kind_of(path: Path) -> Any:
    """Return what a file says it is, None if it cannot be read."""
    try:
        return read_toml(path).get("kind")
    except InputError:
        return None


def is_path(name: str) -> bool:
    """Tell whether a recipe is given as the path of a file, and not by name."""
    return name.endswith(".toml")


def recipe_path(name: str, kind: str, *, also: Sequence[str] = ()) -> Path:
    """Return the file of a recipe.

    Args:
        name: of a recipe, or the path of a TOML file.
        kind: which is wanted: what is offered if there is no such name.
        also: names that are offered besides.

    Raises:
        InputError: there is no recipe of this name.
    """
    if is_path(name):
        return Path(name)
    found = _found()
    if name not in found:
        known = [*also, *recipe_names(kind)]
        raise InputError(
            f"there is no recipe {name!r}.{nearest_name(name, known)} Known: {', '.join(known)};"
            " a recipe of your own is a file that ends with .toml"
        )
    return found[name]


def read_recipe(name: str, kind: str) -> dict[str, Any]:
    """Read a recipe by name, or a TOML file by path, as plain data; see ``recipe_path``.

    Raises:
        InputError: there is no such recipe, or it is no TOML.
    """
    return read_toml(recipe_path(name, kind))


def read_settings(kind: type[_S], name: str, changes: Sequence[str] = ()) -> _S:
    """Read and check a recipe by name or path, with settings replaced by ``dotted.key=value``.

    Args:
        kind: its settings, such as ``coevo.config.RunSettings``.
        name: see ``recipe_path``.
        changes: see ``coevo.config.override``.

    Raises:
        InputError: there is no such recipe, it is of another kind, or it is wrong.

    Example:
        >>> from coevo.config import RunSettings
        >>> from coevo.recipes import read_settings
        >>> settings = read_settings(RunSettings, "three-learners", ["gp.population=40"])
        >>> settings.name, settings.gp.population, settings.gp.generations
        ('three-learners', 40, 60)
    """
    data = override(read_recipe(name, file_kind(kind)), changes)
    return check(kind, data, name if is_path(name) else f"the recipe {name}")


def read_experiment(name: str, changes: Sequence[str] = ()) -> EvolutionSettings:
    """Read and check an experiment of evolution as ``read_settings`` does: of soccer, or of a game of one's own.

    Example:
        >>> from coevo.recipes import read_experiment
        >>> [player.control for player in read_experiment("stationary-opponent").players]
        ['evolve', 'evolve', 'stationary']
    """
    data = override(read_recipe(name, "evolution"), changes)
    return check_experiment(data, name if is_path(name) else f"the recipe {name}")
