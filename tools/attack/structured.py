"""Inputs that Hypothesis makes: well-formed outside, anything inside, with digests that are right."""

from __future__ import annotations

import json
import os
import random
import shutil
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import timedelta
from itertools import cycle, islice
from pathlib import Path
from typing import Any, NamedTuple

import hypothesis
import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from hypothesis import HealthCheck, Phase
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of
from inputs import mutated
from runner import MOST_SECONDS, Case

from behaviors.checkpoint import write_checkpoint
from behaviors.learning import Learning
from behaviors.recipe import Recipe
from behaviors.recipe import read_recipe as skill_recipe
from coevo.config import RunSettings, check, check_experiment, override, to_toml
from coevo.errors import InputError
from coevo.files import digest_of, pack_arrays, read_arrays
from coevo.game import check_playable
from coevo.recipes import read_recipe, recipe_names
from coevo.run import open_run
from coevo.skill import load_skill, skill_path
from coevo.study.folder import ROW, finished_runs
from coevo.study.plan import read_plan
from coevo.tree import parse, simplify
from coevo.tree.program import measure

__all__ = ["structured"]

_EXAMPLES = 20  # of one case

_numbers = st.integers() | st.floats() | st.sampled_from((0, 1, -1, 2**31, 2**63, 2**64, 1e-300, 1e300, 0.5))
_plain = st.booleans() | _numbers | st.text(max_size=20)
_values = st.recursive(
    _plain, lambda of: st.lists(of, max_size=4) | st.dictionaries(st.text(max_size=8), of, max_size=4), max_leaves=12
)
_tables = st.deferred(
    lambda: arrays_of.arrays(
        st.sampled_from(("u1", "i4", "i8", "f4", "f8", "bool", "<U3")),
        arrays_of.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=6),
    )
)


class _Kind(NamedTuple):
    """Inputs of one kind. strategy: that makes them. attempt: reads one; it may raise nothing but ``InputError``."""

    name: str
    strategy: st.SearchStrategy[Any]
    attempt: Callable[[Any], None]


def structured(count: int, rng: random.Random, whole: Path, folder: Path) -> Iterator[Case]:
    """Yield cases of some inputs each, of all kinds in turn.

    Args:
        count: of inputs.
        rng: that seeds them.
        whole: a finished run.
        folder: for files.
    """
    kinds = [*_settings(), _trees(), _skills(folder), *_checkpoints(whole, folder), _parts(whole, folder)]
    kinds += _studies(folder)
    for kind in islice(cycle(kinds), max(len(kinds), count // _EXAMPLES)):
        seed = rng.getrandbits(32)
        yield Case(
            f"structured: {kind.name}",
            f"seed {seed}",
            lambda kind=kind, seed=seed: _try(kind, seed),
            _EXAMPLES * MOST_SECONDS,
            _EXAMPLES,
        )


def _try(kind: _Kind, seed: int) -> None:
    @hypothesis.seed(seed)
    @hypothesis.settings(
        max_examples=_EXAMPLES,
        deadline=timedelta(seconds=MOST_SECONDS),
        database=None,
        phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
    )
    @hypothesis.given(kind.strategy)
    def attempt(value: object) -> None:
        with suppress(InputError):
            kind.attempt(value)

    attempt()


def _spots(data: object, path: tuple[object, ...] = ()) -> Iterator[tuple[object, ...]]:
    """Yield the way to each value within plain data."""
    pairs = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in pairs:
        yield (*path, key)
        yield from _spots(value, (*path, key))


def _changed(data: Any) -> st.SearchStrategy[Any]:
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


def _as_toml(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(str(key))} = {_as_toml(of)}" for key, of in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_as_toml, value)) + "]"
    return repr(value) if isinstance(value, float) else json.dumps(value)


# ------------------------------------------------------------------------------------------------ texts


def _settings() -> list[_Kind]:
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
        for one in (f"{key}={_as_toml(value)}", f"{key}={text}", text):
            with suppress(InputError):
                check_experiment(override(recipes["smoke"], [one]), "hypothesis")

    return [
        _Kind("recipes (evolution)", _changed(experiment), evolution),
        _Kind("recipes (skill)", _changed(skill), learning),
        _Kind("--set", st.tuples(keys, _values, st.text(max_size=40)), assignment),
    ]


def _trees() -> _Kind:
    words = st.sampled_from(
        ("IF_ball_is_left", "IF_r1_is_lost", "shoot", "search", "(", ")", ", ", ",", " ", "IF_", "\n")
    )

    def attempt(pieces: list[str]) -> None:
        tree = parse("".join(pieces))
        assert parse(str(tree)) == tree, "a tree is not read as it was written"
        assert simplify(tree).nodes <= tree.nodes, "a simplified tree has grown"

    return _Kind("trees", st.lists(words | st.text(max_size=3), max_size=30), attempt)


# ------------------------------------------------------------------------------------------------ arrays


def _own(folder: Path, source: Path | None = None) -> Path:
    """Return a folder that is this process's alone, as several try inputs of one kind at a time.

    Args:
        folder: where.
        source: what it is a copy of, at first; by default it is empty.
    """
    path = folder / f"of-{os.getpid()}"
    if not path.exists():
        path.mkdir() if source is None else shutil.copytree(source, path)
    return path


@contextmanager
def _file(path: Path, data: bytes) -> Iterator[Path]:
    path.write_bytes(data)
    try:
        yield path
    finally:
        path.unlink()


def _exchanged(arrays: Mapping[str, Any]) -> st.SearchStrategy[dict[str, Any]]:
    """Return a strategy of arrays, one or two of which are others, or lacking."""
    change = st.tuples(st.sampled_from(sorted(arrays)), st.none() | _tables)

    def exchange(changes: list[tuple[str, Any]]) -> dict[str, Any]:
        copy = dict(arrays)
        for name, array in changes:
            copy.pop(name, None)
            if array is not None:
                copy[name] = array
        return copy

    return st.lists(change, min_size=1, max_size=2).map(exchange)


def _text(data: object) -> Any:
    return np.frombuffer(json.dumps(data).encode("utf-8", "surrogatepass"), np.uint8)


def _skills(folder: Path) -> _Kind:
    arrays = read_arrays(skill_path("search"))
    header = json.loads(bytes(arrays["header"]))
    made = st.tuples(_changed(header), st.just(arrays)) | st.tuples(st.just(header), _exchanged(arrays))

    def attempt(given: tuple[Any, dict[str, Any]]) -> None:
        about, changed = given
        with _file(_own(folder) / "skill.npz", pack_arrays({**changed, "header": _text(about)})) as path:
            skill = load_skill(path)
        assert skill.digest == about["digest"], "a skill does not match its digest"
        assert len(skill.policy) == len(skill.values), "a skill has no policy"

    return _Kind("skills", made, attempt)


def _checkpoints(whole: Path, folder: Path) -> list[_Kind]:
    kept = read_arrays(whole / "checkpoint.npz")
    del kept["digest"]
    (folder / "runs").mkdir()

    def of_run(arrays: dict[str, Any]) -> None:
        run = _own(folder / "runs", whole)
        (run / "checkpoint.npz").write_bytes(pack_arrays({**arrays, "digest": digest_of(arrays)}))
        opened = open_run(run)
        checkpoint = opened.checkpoint()
        assert checkpoint is not None
        for role, trees in checkpoint.populations.items():
            for codes in trees:
                measure(codes, opened.game.function_set(role))

    recipe = skill_recipe("search")
    first = folder / "learning.npz"
    learning = Learning(recipe, seed=1, trials=1000)
    learning.advance()
    learning.save(first)
    parts = read_arrays(first)
    about = json.loads(bytes(parts["header"]))
    parts = {name: array for name, array in parts.items() if name not in ("digest", "header", "format", "code")}
    made = st.tuples(_changed(about["at"]), st.just(parts)) | st.tuples(st.just(about["at"]), _exchanged(parts))

    def of_learning(given: tuple[Any, dict[str, Any]]) -> None:
        at, changed = given
        path = _own(folder) / "learning.npz"
        write_checkpoint(path, about["learning"], at, changed)
        gone_on = Learning.load(path, recipe, seed=1, trials=1000)
        if not gone_on.is_finished:
            gone_on.advance()

    return [
        _Kind("checkpoints (evolution)", _exchanged(kept), of_run),
        _Kind("checkpoints (learning)", made, of_learning),
    ]


def _parts(whole: Path, folder: Path) -> _Kind:
    source = Path(shutil.copytree(whole, folder / "source"))
    (source / "digests.txt").unlink()  # so that it is for nobody to know that it was changed
    (source / "checkpoint.npz").unlink()
    (folder / "parts").mkdir()
    part = Path("individuals.parquet") / "part-00002.parquet"
    table = pq.read_table(source / part)
    rows = len(table)
    column = st.one_of(
        *(st.lists(of | st.none(), min_size=rows, max_size=rows) for of in (st.integers(-(2**31), 2**31), st.floats())),
        st.lists(st.lists(st.integers(-5, 300), max_size=5), min_size=rows, max_size=rows),
        st.lists(st.text(max_size=3), min_size=rows, max_size=rows),
    )

    def attempt(changes: list[tuple[str, Any]]) -> None:
        changed = table
        for name, values in changes:
            if name in changed.column_names:
                at = changed.column_names.index(name)
                changed = changed.remove_column(at)
                if values is not None:
                    changed = changed.add_column(at, name, pa.array(values))
        run = _own(folder / "parts", source)
        pq.write_table(changed, run / part)
        opened = open_run(run)
        for read in (
            lambda: opened.individuals,
            lambda: opened.records(2),
            lambda: opened.tree("r0", 2),
            lambda: opened.champion_tree("r0", 2),
        ):
            with suppress(InputError):
                read()

    changes = st.lists(st.tuples(st.sampled_from(table.column_names), st.none() | column), min_size=1, max_size=2)
    return _Kind("parts", changes, attempt)


# ------------------------------------------------------------------------------------------------ studies


def _studies(folder: Path) -> list[_Kind]:
    study = {
        "kind": "study",
        "recipes": ["smoke"],
        "seeds": 2,
        "set": {"gp.population": 6},
        "vary": {"fitness.kind": ["fixed", "varying"]},
        "arms": {"one": {"gp.generations": 2}},
    }

    def plan(data: dict[str, Any]) -> None:
        text = "".join(f"{json.dumps(str(key))} = {_as_toml(value)}\n" for key, value in data.items())
        with _file(_own(folder) / "study.toml", text.encode("utf-8", "replace")) as path:
            read_plan(str(path))

    table = b"recipe,seed,run,share\nsmoke,0,smoke-seed0,0.5\nsmoke,1,smoke-seed1,0.25\n"
    rows = {
        f"smoke-seed{seed}": {"measured": ["robots"], "row": {"share": share}} for seed, share in ((0, 0.5), (1, 0.25))
    }

    def tables(given: tuple[Any, int]) -> None:
        told, seed = given
        study = _own(folder / "tables")
        for name, row in told.items() if isinstance(told, dict) else ():
            if name in rows:
                (study / name).mkdir(exist_ok=True)
                (study / name / ROW).write_text(json.dumps(row), encoding="utf-8")
        changed = mutated(table, random.Random(seed)) if seed % 2 else table
        (study / "table.csv").write_bytes(changed)
        for path, row in finished_runs(study):
            assert row["run"] == path.name, "a row is of another run"

    (folder / "tables").mkdir()
    return [
        _Kind("studies", _changed(study), plan),
        _Kind("rows of studies", st.tuples(_changed(rows), st.integers(0, 2**32)), tables),
    ]
