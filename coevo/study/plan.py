"""What a study is: a file that names recipes, settings and seeds, and the runs that follow from it."""

from __future__ import annotations

import datetime as dt
import hashlib
import itertools
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from coevo.config import EvolutionSettings, FileSettings, assign, check, read_toml, without_effect
from coevo.errors import InputError, nearest_name
from coevo.plugins import search_folders
from coevo.recipes import is_path, recipe_path
from coevo.study.kinds import StudyKind
from coevo.study.registry import kind_named, kind_names

__all__ = ["RECIPES", "Condition", "Plan", "PlannedRun", "StudySettings", "by_dotted_key", "read_plan", "study_name"]

RECIPES = "recipes"  # the folder in a study's folder that holds recipes and modules of one's own
_MOST_RUNS = 100_000
_MOST_LETTERS = 100  # of a condition in the name of a folder
_Seed = Annotated[int, Meta(ge=0, le=2**63 - 1)]


class StudySettings(FileSettings, frozen=True, kw_only=True):
    """A study: every recipe with every arm, every combination of the varied settings and every seed is a run."""

    kind: Literal["study"] = "study"
    recipes: Annotated[tuple[str, ...], Meta(min_length=1)]  # names, or files beside the study file
    seeds: Annotated[int, Meta(ge=1, le=_MOST_RUNS)] | Annotated[tuple[_Seed, ...], Meta(min_length=1)] = 1  # 3: 0 1 2
    set: dict[str, Any] = msgspec.field(default_factory=dict)  # settings of all runs, by dotted key
    vary: dict[str, Any] = msgspec.field(default_factory=dict)  # lists of values, by dotted key
    # What is compared where that is no product: by name, settings by dotted key, which go before those of ``set``.
    arms: dict[str, dict[str, Any]] = msgspec.field(default_factory=dict)
    # Written into the study's folder: a digest of the settings of each condition. Where there is one it must be right.
    conditions: dict[str, str] = msgspec.field(default_factory=dict)


@dataclass(frozen=True)
class Condition:
    """Runs that differ in their seeds alone.

    Attributes:
        label: in the names of their folders.
        recipe: what the column ``recipe`` says: its name, without folders and ending where that is enough.
        kind: of the recipe.
        values: of the varied keys; before them that of "arm", if there are arms.
        data: settings as plain data, without a seed.
        folders: where code of one's own is looked for.
        own: the files of it that were found.
    """

    label: str
    recipe: str
    kind: str
    values: Mapping[str, Any]
    data: Mapping[str, Any]
    folders: tuple[Path, ...]
    own: tuple[Path, ...] = ()

    def settings(self, seed: int) -> FileSettings:
        """Return the settings of the run with a seed."""
        return kind_named(self.kind).settings({**self.data, "seed": seed}, self.label)


@dataclass(frozen=True)
class PlannedRun:
    """One run of a study.

    Attributes:
        condition: its recipe and settings.
        seed: its own.
    """

    condition: Condition
    seed: int

    @property
    def name(self) -> str:
        """The name of its folder."""
        return f"{self.condition.label}-seed{self.seed}"

    @property
    def settings(self) -> FileSettings:
        """Its settings."""
        return self.condition.settings(self.seed)

    @property
    def key(self) -> dict[str, Any]:
        """The cells of a table that say which run it is."""
        values = {key: _cell(value) for key, value in self.condition.values.items()}
        return {"recipe": self.condition.recipe, "seed": self.seed, **values, "run": self.name}


@dataclass(frozen=True)
class Plan:
    """A study that was read and checked.

    Attributes:
        record: the study, resolved, as it is written into its folder.
        conditions: in their order.
        seeds: of each.
        files: by the name of the recipe the file that a recipe was read from, if it was given as one.
    """

    record: StudySettings
    conditions: tuple[Condition, ...]
    seeds: tuple[int, ...]
    files: Mapping[str, Path]

    @property
    def runs(self) -> list[PlannedRun]:
        """All runs, condition by condition."""
        return [PlannedRun(condition, seed) for condition in self.conditions for seed in self.seeds]

    @property
    def own_files(self) -> list[Path]:
        """Modules of one's own that its runs need."""
        return list(dict.fromkeys(path for condition in self.conditions for path in condition.own))

    @property
    def without_effect(self) -> list[str]:
        """Lines about settings that are varied and change nothing, where that is so in any condition."""
        found: dict[str, str] = {}
        for condition in self.conditions:
            settings = condition.settings(self.seeds[0])
            if isinstance(settings, EvolutionSettings):
                for text in without_effect(settings, self.record.vary):
                    found.setdefault(text, condition.label)
        return [f"{label}: {text}" for text, label in found.items()]


def study_name(source: str) -> str:
    """Return what a study is called where nobody says otherwise: as its file, or the folder of a ``study.toml``."""
    path = recipe_path(source, "study").resolve()
    return f"{path.parent.name}-study" if path.stem == "study" else path.stem


def read_plan(source: str, seeds: int | None = None) -> Plan:
    """Read a study file, and check the settings of every run.

    Args:
        source: a TOML file, or the name of a study that came with the installation.
        seeds: how many, instead of those of the file.

    Raises:
        InputError: the file or a recipe is wrong, or a run could not be made.

    Example:
        >>> from pathlib import Path
        >>> from coevo.study.plan import read_plan
        >>> text = 'recipes = ["smoke"]\\nseeds = 2\\n[vary]\\n"fitness.kind" = ["fixed", "varying"]\\n'
        >>> _ = Path("mine.toml").write_text(text)
        >>> [run.name for run in read_plan("mine.toml").runs]
        ['smoke-fixed-seed0', 'smoke-fixed-seed1', 'smoke-varying-seed0', 'smoke-varying-seed1']
    """
    path = recipe_path(source, "study")
    settings = check(StudySettings, read_toml(path), source)
    chosen = _seeds(settings.seeds if seeds is None else seeds, source)
    fixed, varied = by_dotted_key(settings.set), by_dotted_key(settings.vary)
    arms = {name: by_dotted_key(table) for name, table in settings.arms.items()}
    _check_keys(fixed, varied, arms, source)
    read = [_read_recipe(name, path.parent, source) for name in settings.recipes]
    names = _short_names([name for name, *_ in read])
    count = len(read) * len(chosen)
    for values in [arms or [None], *varied.values()]:
        count *= len(values)
    if count > _MOST_RUNS:
        raise InputError(f"{source}: expected at most {_MOST_RUNS} runs, got {count}; make several studies of it")
    made: list[Condition] = []
    digests: dict[str, str] = {}
    for name, (given, kind, data, folders) in zip(names, read, strict=True):
        for values in _combinations({"arm": list(arms), **varied} if arms else varied):
            label = _label(name, values, digests)
            told = " ".join([given, *(f"{key}={_cell(value)}" for key, value in values.items())])
            changes = fixed | arms.get(values.get("arm", ""), {}) | {key: values[key] for key in varied}
            condition = Condition(label, name, kind, values, assign(data, changes, f"{source}: {told}"), folders)
            checked, digest = _checked(condition, chosen, f"{source}: {told}")
            made.append(checked)
            digests[label] = digest
    _check_own(made, source)
    if settings.conditions not in ({}, digests):
        wrong = next(label for label in {**digests, **settings.conditions} if _differ(label, settings, digests))
        raise InputError(
            f"{source}: the settings of {wrong} are not those that were recorded; take the table [conditions] out to"
            " run them as they are now"
        )
    files = {name: found for name, given in zip(names, settings.recipes, strict=True) if (found := _file(given, path))}
    recipes = tuple(
        f"{RECIPES}/{name}.toml" if name in files else given
        for name, given in zip(names, settings.recipes, strict=True)
    )
    record = StudySettings(recipes=recipes, seeds=chosen, set=fixed, vary=varied, arms=arms, conditions=digests)
    return Plan(record, tuple(made), chosen, files)


def _differ(label: str, settings: StudySettings, digests: Mapping[str, str]) -> bool:
    return settings.conditions.get(label) != digests.get(label)


def _file(given: str, study: Path) -> Path | None:
    return study.parent / given if is_path(given) else None


def _seeds(given: int | Sequence[int], source: str) -> tuple[int, ...]:
    if isinstance(given, int):
        return tuple(range(given))
    _check_distinct("seeds", given, source)
    return tuple(given)


def _check_distinct(what: str, values: Sequence[Any], source: str) -> None:
    told = [json.dumps(value, sort_keys=True, default=str) for value in values]
    twice = next((value for value in told if told.count(value) > 1), None)
    if twice is not None:
        raise InputError(f"{source}: {what}: expected each value once, got {twice} twice")


def by_dotted_key(table: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Return values by dotted keys: a key without quotes in TOML makes tables of its parts."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, Mapping) and value:
            found |= by_dotted_key(value, f"{above}{key}.")
        else:
            found[f"{above}{key}"] = value
    return found


def _check_keys(
    fixed: Mapping[str, Any], varied: Mapping[str, Any], arms: Mapping[str, Mapping[str, Any]], source: str
) -> None:
    named = [(f"arms.{name}", keys) for name, keys in arms.items()]
    for table, keys in (("set", fixed), ("vary", varied), *named):
        for key, word in (("seed", "seeds"), ("kind", "recipes")):
            if key in keys:
                raise InputError(f"{source}: {table}.{key}: a study says this by '{word}'; leave it out here")
    for key, values in varied.items():
        if not isinstance(values, list) or not values:
            raise InputError(f"{source}: vary.{key}: expected a list of values, such as [1, 2], got {values!r}")
        for value in values:
            _check_no_date(value, f"{source}: vary.{key}")
        _check_distinct(f"vary.{key}", values, source)
        for table, keys in (("set", fixed), *named):
            if key in keys:
                raise InputError(f"{source}: {key} stands in [{table}] and in [vary]; leave it out of one of them")


def _check_no_date(value: Any, where: str) -> None:
    """Refuse what TOML has and no setting is, before it comes into names and tables."""
    if isinstance(value, dt.date | dt.time):
        raise InputError(f"{where}: expected values that a setting can have, got {value.isoformat()}, a date or time")
    if isinstance(value, Mapping | list):
        for part in value.values() if isinstance(value, Mapping) else value:
            _check_no_date(part, where)


def _combinations(varied: Mapping[str, Sequence[Any]]) -> Iterator[dict[str, Any]]:
    for values in itertools.product(*varied.values()):
        yield dict(zip(varied, values, strict=True))


def _read_recipe(name: str, folder: Path, source: str) -> tuple[str, str, dict[str, Any], tuple[Path, ...]]:
    """Return a recipe as it was given, its kind, its plain data, and where code of one's own is looked for."""
    if is_path(name):
        data = read_toml(folder / name)
        kind = data.get("kind", "evolution")
        try:
            if not isinstance(kind, str):
                raise InputError(f"kind: expected text, such as 'evolution', got {kind!r}")
            kind_named(kind)
        except InputError as error:
            raise InputError(f"{source}: {name}: {error}") from None
        return name, kind, data, search_folders((folder / name).parent)
    known: dict[str, tuple[str, Path]] = {}
    for kind in kind_names():
        known = {**{one: (kind, path) for one, path in kind_named(kind).recipes().items()}, **known}
    if name not in known:
        raise InputError(
            f"{source}: there is no recipe {name!r}.{nearest_name(name, known)} Known: {', '.join(sorted(known))};"
            " a recipe of your own is a file beside the study that ends with .toml"
        )
    kind, path = known[name]
    return name, kind, read_toml(path), search_folders(Path())


def _checked(condition: Condition, seeds: Sequence[int], source: str) -> tuple[Condition, str]:
    """Check the settings of a condition's runs; return it with the files of its own, and the digest of all of it."""
    kind: StudyKind = kind_named(condition.kind)
    settings = kind.settings({**condition.data, "seed": seeds[0]}, source)
    try:
        own = kind.check(settings, condition.folders)
    except InputError as error:
        raise type(error)(f"{source}: {error}") from None
    digest = hashlib.sha256(msgspec.json.encode(msgspec.structs.replace(settings, seed=0)))
    for path in own:
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    whole = Condition(**{**vars(condition), "own": tuple(own)})
    return whole, digest.hexdigest()


def _check_own(conditions: Sequence[Condition], source: str) -> None:
    """Refuse modules of one's own of one name that differ: all lie in one folder of the study."""
    found: dict[str, Path] = {}
    for path in dict.fromkeys(path for condition in conditions for path in condition.own):
        first = found.setdefault(path.name, path)
        if path.read_bytes() != first.read_bytes():
            raise InputError(
                f"{source}: {first} and {path} differ, but a study has one folder for modules of its own, with one"
                f" {path.name}; rename one of them"
            )


# ------------------------------------------------------------------------------------------------------- names


def _short_names(given: Sequence[str]) -> list[str]:
    """Return names of recipes without folders and ending, with folders where they would be equal.

    Raises:
        InputError: a recipe is named twice.
    """
    _check_distinct("recipes", given, "the study")
    plain = [name.removesuffix(".toml") for name in given]
    short = [name.rpartition("/")[2] for name in plain]
    names = [
        one if [name.lower() for name in short].count(one.lower()) == 1 else whole
        for one, whole in zip(short, plain, strict=True)
    ]
    names = [_slug(name) for name in names]
    _check_distinct("recipes", [name.lower() for name in names], "the study")
    return names


def _slug(text: str) -> str:
    """Return text as a part of the name of a folder."""
    return re.sub(r"[^A-Za-z0-9._+=]+", "-", text).strip("-.") or "none"


def _label(recipe: str, values: Mapping[str, Any], taken: Mapping[str, str]) -> str:
    parts = [recipe]
    for key, value in values.items():
        text = value if isinstance(value, str) else f"{key.rpartition('.')[2]}{_cell(value)}"
        parts.append(_slug(text))
    whole = "-".join(parts)
    base = label = whole[:_MOST_LETTERS].rstrip("-.")
    number = 1
    while label.lower() in {other.lower() for other in taken}:
        number += 1
        label = f"{base}-{number}"
    return label


def _cell(value: Any) -> Any:
    """Return a value of a setting as a table has it."""
    return value if isinstance(value, str | float) or type(value) is int else json.dumps(value, separators=(",", ":"))
