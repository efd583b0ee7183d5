"""Inputs that Hypothesis makes: well-formed outside, anything inside, with digests that are right."""

from __future__ import annotations

import json
import os
import random
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import timedelta
from itertools import cycle, islice
from pathlib import Path
from typing import Any, Protocol

import hypothesis
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from hypothesis import HealthCheck, Phase
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of
from inputs import mutated
from runner import MOST_SECONDS, Case
from texts import Kind, altered, as_toml, of_settings, of_trees

from behaviors.checkpoint import write_checkpoint
from behaviors.learning import Learning
from behaviors.recipe import read_recipe as skill_recipe
from behaviors.schedule.course import Course
from behaviors.schedule.recipe import read_schedule
from behaviors.team.course import TeamCourse
from behaviors.team.recipe import read_team
from behaviors.team.scene import unlearned
from coevo.errors import InputError
from coevo.files import digest_of, pack_arrays, read_arrays
from coevo.run import open_run
from coevo.skill import load_skill, skill_path
from coevo.study.folder import ROW, finished_runs
from coevo.study.plan import read_plan
from coevo.tree.program import measure

__all__ = ["SET", "TEAM", "structured"]

_EXAMPLES = 20  # of one case
_BLOCKS = 3  # of trials before a checkpoint
SET = (
    *("trials=60", "games=20", "store.steps=3000", "store.least_windows=100", "store.report_orders=false"),
    *("experience.windows=300", "time_limit_steps=150", "transfer.trials_e=0"),
    *("transfer.trials_f=0", "passer.learning.check_games=10", "shooter.learning.check_games=10"),
)
TEAM = (
    "chapter5/shoot-and-pass",
    ["trials=300", "time_limit_steps=60", "games=20", "learning.check_every=250", "learning.check_games=10"],
)

_tables = st.deferred(
    lambda: arrays_of.arrays(
        st.sampled_from(("u1", "i4", "i8", "f4", "f8", "bool", "<U3")),
        arrays_of.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=6),
    )
)


def structured(count: int, rng: random.Random, whole: Path, folder: Path) -> Iterator[Case]:
    """Yield cases of some inputs each, of all kinds in turn.

    Args:
        count: of inputs.
        rng: that seeds them.
        whole: a finished run.
        folder: for files.
    """
    kinds = [*of_settings(), of_trees(), _skills(folder), *_checkpoints(whole, folder), _parts(whole, folder)]
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


def _try(kind: Kind, seed: int) -> None:
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


def _skills(folder: Path) -> Kind:
    arrays = read_arrays(skill_path("search"))
    header = json.loads(bytes(arrays["header"]))
    made = st.tuples(altered(header), st.just(arrays)) | st.tuples(st.just(header), _exchanged(arrays))

    def attempt(given: tuple[Any, dict[str, Any]]) -> None:
        about, changed = given
        with _file(_own(folder) / "skill.npz", pack_arrays({**changed, "header": _text(about)})) as path:
            skill = load_skill(path)
        assert skill.digest == about["digest"], "a skill does not match its digest"
        assert len(skill.policy) == len(skill.values), "a skill has no policy"

    return Kind("skills", made, attempt)


def _checkpoints(whole: Path, folder: Path) -> list[Kind]:
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

    skill, schedule, team = skill_recipe("search"), read_schedule("chapter3/schedule", SET), read_team(*TEAM)
    return [
        Kind("checkpoints (evolution)", _exchanged(kept), of_run),
        _of_learning(
            "learning",
            Learning(skill, seed=1, trials=1000),
            lambda path: Learning.load(path, skill, seed=1, trials=1000),
            folder,
        ),
        _of_learning("set", Course(schedule, 1), lambda path: Course.load(path, schedule, 1), folder),
        _of_learning(
            "team", TeamCourse(team, 1, members=unlearned(team)), lambda path: TeamCourse.load(path, team, 1), folder
        ),
    ]


class _UnderWay(Protocol):
    """A learning a block of trials at a time."""

    @property
    def is_finished(self) -> bool: ...

    def advance(self) -> object: ...

    def save(self, path: Path) -> None: ...


def _of_learning(name: str, learning: _UnderWay, load: Callable[[Path], _UnderWay], folder: Path) -> Kind:
    """Return checkpoints of a learning whose header or arrays are others, with a digest that is right."""
    first = folder / f"{name}.npz"
    for _ in range(_BLOCKS):
        learning.advance()
    learning.save(first)
    parts = read_arrays(first)
    about = json.loads(bytes(parts["header"]))
    parts = {name: array for name, array in parts.items() if name not in ("digest", "header", "format", "code")}
    made = st.tuples(altered(about["at"]), st.just(parts)) | st.tuples(st.just(about["at"]), _exchanged(parts))

    def attempt(given: tuple[Any, dict[str, Any]]) -> None:
        at, changed = given
        path = _own(folder) / f"{name}.npz"
        write_checkpoint(path, about["learning"], at, changed)
        gone_on = load(path)
        if not gone_on.is_finished:
            gone_on.advance()

    return Kind(f"checkpoints ({name})", made, attempt)


def _parts(whole: Path, folder: Path) -> Kind:
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
    return Kind("parts", changes, attempt)


# ------------------------------------------------------------------------------------------------ studies


def _studies(folder: Path) -> list[Kind]:
    study = {
        "kind": "study",
        "recipes": ["smoke"],
        "seeds": 2,
        "set": {"gp.population": 6},
        "vary": {"fitness.kind": ["fixed", "varying"]},
        "arms": {"one": {"gp.generations": 2}},
    }

    def plan(data: dict[str, Any]) -> None:
        text = "".join(f"{json.dumps(str(key))} = {as_toml(value)}\n" for key, value in data.items())
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
        Kind("studies", altered(study), plan),
        Kind("rows of studies", st.tuples(altered(rows), st.integers(0, 2**32)), tables),
    ]
