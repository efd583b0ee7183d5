"""A study's folder: the only place that reads and writes one.

``study.toml`` the study, resolved; ``recipes`` the recipes and modules of one's own that were given as files; a folder
a run; ``table.csv`` a row a finished run, ``failed.csv`` a row a run that failed. In the folder of a finished run
``study.json`` holds its row. Names that begin with a dot are of a study under way. Every file is written whole, so a
study may be killed at any instant, and all that is written follows from what the runs came to, not from when.
"""

from __future__ import annotations

import csv
import io
import json
import math
import secrets
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from coevo.config import check, read_toml, to_toml
from coevo.errors import InputError
from coevo.files import make_folder, read_text, read_whole, write_whole
from coevo.folder import SAME_COMMAND, lock_folder
from coevo.seal import seal, unseal
from coevo.soundness import Finding
from coevo.study.kinds import Cell
from coevo.study.plan import RECIPES, Plan, PlannedRun, StudySettings, by_dotted_key
from coevo.study.registry import kind_named
from coevo.study.sets import table_bytes

__all__ = ["ROW", "STUDY", "StudyFolder", "check_folder", "check_study", "finished_runs", "open_study", "row_bytes"]

STUDY = "study.toml"
ROW = "study.json"
_TABLE, _FAILED = "table.csv", "failed.csv"
_FLAG = ".going-"
_ANEW = "the same 'coevo study' makes it anew"


class _IncompleteError(ValueError):
    """A table has no row of a finished run, as it was not measured when the table was written."""


class _Row(NamedTuple):
    """What was measured of a run, what it came to, and which it is; of a row of before that is not told."""

    measured: list[str]
    row: dict[str, Cell]
    key: dict[str, Cell]


def row_bytes(measured: Sequence[str], row: Mapping[str, Cell], key: Mapping[str, Cell]) -> bytes:
    """Return the file that holds the row of a finished run.

    Args:
        measured: what was measured, by the names that its kind gives it.
        row: what it came to, by column.
        key: the columns before these: which run of the study it is.

    Raises:
        ValueError: a cell is no number that JSON knows.
    """
    if any(isinstance(cell, float) and not math.isfinite(cell) for cell in row.values()):
        raise ValueError(f"a row must have finite numbers, got {dict(row)}")
    return seal({"measured": list(measured), "row": dict(row), "key": dict(key)})


def _read_row(path: Path) -> _Row:
    """Return the row of a finished run.

    Raises:
        OSError: it cannot be read.
        ValueError, TypeError, LookupError: it is damaged.
    """
    told = unseal(read_text(path))
    if not told.keys() <= {"measured", "row", "key"}:
        raise ValueError("it is no row")
    return _Row(list(told["measured"]), dict(told["row"]), dict(told.get("key", {})))


def finished_runs(path: Path) -> list[tuple[Path, dict[str, str]]]:
    """Return the folder of each finished run of a study, which may be under way, and its row of the table.

    Raises:
        InputError: there is none, or the table is damaged.
    """
    try:
        rows = _table_rows(path)
    except FileNotFoundError:
        rows = []
    except NotADirectoryError:
        what = "is a file" if path.is_file() else "lies within a file"
        raise InputError(f"{path} {what}, but the folder of a study is expected; name the one with {_TABLE}") from None
    except (OSError, ValueError) as error:
        raise InputError(_told(path, error)) from None
    if not rows or "run" not in rows[0]:
        raise InputError(f"{path} holds no finished run of a study; run 'coevo study' first, or name its folder")
    return [(path / row["run"], row) for row in rows]


def _told(path: Path, error: Exception) -> str:
    """Return what is wrong with the table in a folder, and what to do."""
    if isinstance(error, _IncompleteError):
        return f"{path / _TABLE} is incomplete ({error}); 'coevo study' without --only completes it"
    return f"{path / _TABLE} is damaged ({error}); {_ANEW}"


def _table_rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a study's table, each compared with what its run says that it came to, if it does.

    Raises:
        OSError: it cannot be read.
        ValueError: it is damaged.
    """
    table = csv.DictReader(io.StringIO(read_text(path / _TABLE), newline=""), strict=True)
    try:
        rows = [dict(row) for row in table]
    except csv.Error as error:
        raise ValueError(str(error)) from None
    for number, row in enumerate(rows):
        name, seed = row.get("run"), row.get("seed")
        if name is None or seed is None or Path(name).name != name or not name.endswith(f"seed{seed}"):
            raise ValueError(f"its row {number + 1} names no run")
        try:
            told = _read_row(path / name / ROW) if (path / name / ROW).exists() else _Row([], {}, {})
        except (OSError, ValueError, TypeError, LookupError):
            raise ValueError(f"{Path(name) / ROW} does not tell what the run came to") from None
        if None in row or any(row.get(column) != str(cell) for column, cell in {**told.row, **told.key}.items()):
            raise ValueError(f"its row of {name} is not what the run came to")
    _check_runs(path, [row["run"] for row in rows])
    return rows


def _check_runs(path: Path, found: Sequence[str]) -> None:
    """Compare the runs of a table with those of the study, in their order, and with those that are finished.

    Raises:
        ValueError: a run is another, stands elsewhere, or is lacking.
    """
    if not (path / STUDY).exists():  # a table of which nothing else was kept
        return
    try:
        record = check(StudySettings, read_toml(path / STUDY), STUDY)
    except InputError as error:
        raise ValueError(str(error)) from None
    if not record.conditions:  # of before
        return
    seeds = range(record.seeds) if isinstance(record.seeds, int) else record.seeds
    planned = [f"{label}-seed{seed}" for label in record.conditions for seed in seeds]
    if list(found) != [name for name in planned if name in set(found)]:
        raise ValueError("its rows are not those of the study, in their order")
    if any(path.glob(f"{_FLAG}*")):  # what is finished by now may not have come into the table yet
        return
    lacking = [name for name in planned if name not in set(found) and (path / name / ROW).exists()]
    if lacking:
        raise _IncompleteError(f"it has no row of {lacking[0]}, which is finished")


def check_study(path: Path) -> list[Finding]:
    """Return what is sound in a study's folder besides its runs: what they came to, and the table of it."""
    found = []
    for one in sorted(path.glob(f"*/{ROW}")):
        name = str(one.relative_to(path))
        try:
            _read_row(one)
        except (OSError, ValueError, TypeError, LookupError) as error:
            found.append(Finding(name, "damaged", f"{one} is damaged ({error}); delete it; {_ANEW}"))
        else:
            found.append(Finding(name, "sound"))
    try:
        _table_rows(path)
    except FileNotFoundError:
        return [*found, Finding(_TABLE, "missing")]
    except (OSError, ValueError) as error:
        return [*found, Finding(_TABLE, "damaged", _told(path, error))]
    return [*found, Finding(_TABLE, "sound")]


class StudyFolder:
    """The folder of a study, for the one process that directs it; made by ``open_study``.

    Attributes:
        path: where it is.
        plan: what is in it, or will be.
        flag: a file that is there as long as this process wants the runs: workers leave a run when it has gone.
    """

    def __init__(self, path: Path, plan: Plan, release: Callable[[], None]) -> None:
        self.path, self.plan, self._release = path, plan, release
        for left in path.glob(f"{_FLAG}*"):
            left.unlink(missing_ok=True)
        self.flag = path / f"{_FLAG}{secrets.token_hex(8)}"
        self.flag.touch()

    def leave(self) -> None:
        """Tell workers to leave their runs; all that is done is saved."""
        self.flag.unlink(missing_ok=True)

    def close(self) -> None:
        """Leave all runs, and let other processes in."""
        self.leave()
        self._release()

    @property
    def table(self) -> Path:
        """Where the table is."""
        return self.path / _TABLE

    def row(self, run: PlannedRun) -> dict[str, Cell] | None:
        """Return what a run came to, by column; None if it is not finished, or was not asked all that is asked now."""
        folder, kind = self.path / run.name, kind_named(run.condition.kind)
        try:
            told = _read_row(folder / ROW)
        except (OSError, ValueError, TypeError, LookupError):
            return None
        if told.measured != list(kind.measured) or told.key not in ({}, run.key):
            return None
        return told.row if kind.is_whole(folder, run.settings) else None

    def is_measured_otherwise(self, run: PlannedRun) -> bool:
        """Tell whether a run has a row that does not count, most likely as other things are measured now."""
        return (self.path / run.name / ROW).exists() and self.row(run) is None

    @property
    def failures(self) -> dict[str, str]:
        """Why runs of the study failed when they were tried last, by their names; what cannot be read is left out."""
        try:
            rows = list(csv.DictReader(io.StringIO(read_text(self.path / _FAILED), newline="")))
        except (OSError, ValueError, csv.Error):
            return {}
        names = {run.name for run in self.plan.runs}
        return {row["run"]: row.get("reason") or "" for row in rows if row.get("run") in names}

    def write_tables(self, rows: Mapping[str, Mapping[str, Cell]], failed: Mapping[str, str]) -> None:
        """Write the table, and that of the runs that failed, in the order of the plan.

        Args:
            rows: what runs came to, by their names.
            failed: why runs failed, by their names.

        Raises:
            InputError: they cannot be written.
        """
        runs = self.plan.runs
        key = list(runs[0].key)
        found = [{**run.key, **rows[run.name]} for run in runs if run.name in rows]
        columns = list(dict.fromkeys([*key, *(column for row in found for column in row)]))
        lost = [{**run.key, "reason": failed[run.name]} for run in runs if run.name in failed]
        with _Writing(self.path):
            write_whole(self.table, table_bytes(found, columns))
            if lost:
                write_whole(self.path / _FAILED, table_bytes(lost))
            else:
                (self.path / _FAILED).unlink(missing_ok=True)


class _Writing:
    """Turns failures of writing into messages for the user."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __enter__(self) -> None:
        pass

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        if isinstance(error, OSError):
            reason = error.strerror or str(error)
            raise InputError(f"cannot write into {self._folder}: {reason}; mend this or choose another --out") from None


def check_folder(path: Path, plan: Plan) -> None:
    """Refuse a folder that holds something else than this study, or than a part of its seeds and arms.

    Raises:
        InputError: with the remedy.
    """
    try:
        if not (path / STUDY).exists():
            if path.exists() and (not path.is_dir() or any(not one.name.startswith(".") for one in path.iterdir())):
                raise InputError(f"{path} exists and is not the folder of a study; choose another --out")
            return
    except OSError as error:
        raise InputError(f"cannot open {path}: {error.strerror or error}; choose another --out") from None
    there, new = check(StudySettings, read_toml(path / STUDY), str(path / STUDY)), plan.record
    different = [
        name
        for name in ("recipes", "set", "vary", "arms", "conditions")
        if _plain(there, name) != _plain(new, name, of=there)
    ]
    if different:
        what = different[0]
        if what == "conditions":
            what = f"settings, which a recipe or a default now gives{_which_setting(path, plan, there)}"
        raise InputError(f"{path} holds another study: it differs in its {what}; choose another --out")
    lacking = [seed for seed in there.seeds if seed not in plan.seeds] if isinstance(there.seeds, tuple) else []
    if lacking:
        raise InputError(
            f"{path} holds this study with more seeds, such as {lacking[0]}; give these too (more may be added), or"
            " choose another --out"
        )


def _which_setting(path: Path, plan: Plan, there: StudySettings) -> str:
    """Return the first setting that a run in the folder has otherwise than the plan, to be put into a message.

    Nothing if no run of a condition that differs was begun, or the difference is in a module of one's own.
    """
    for run in plan.runs:
        label = run.condition.label
        if there.conditions.get(label) in (None, plan.record.conditions.get(label)):
            continue
        try:
            before = by_dotted_key(read_toml(path / run.name / "config.toml"))
        except InputError:
            continue
        now = by_dotted_key(tomllib.loads(to_toml(run.settings)))
        for key in [*now, *before]:
            if now.get(key) != before.get(key):
                was, is_now = (f"is {of[key]!r}" if key in of else "is not there" for of in (before, now))
                return f": {key} {was} in {run.name} and {is_now} now"
    return ""


def _plain(record: StudySettings, name: str, *, of: StudySettings | None = None) -> str:
    """Return a setting as text that can be compared; of arms and conditions only those that ``of`` has, if given."""
    value = msgspec.to_builtins(getattr(record, name))
    if of is not None and name in ("arms", "conditions"):
        value = {key: one for key, one in value.items() if key in getattr(of, name)}
    # Conditions in their order, which is that of the table; of settings TOML does not keep it.
    return json.dumps(value, sort_keys=name != "conditions")


def open_study(path: Path, plan: Plan) -> StudyFolder:
    """Make the folder of a study, or open it to go on.

    Raises:
        InputError: it holds something else, another process goes on with it, or it cannot be written.
    """
    check_folder(path, plan)
    recipes = path / RECIPES
    with _Writing(path):
        make_folder(path)
        release = lock_folder(path, SAME_COMMAND)
        write_whole(path / STUDY, to_toml(plan.record).encode())
        wanted = {f"{name}.toml": file for name, file in plan.files.items()}
        wanted |= {file.name: file for file in plan.own_files}
        for name, file in wanted.items():
            make_folder(recipes, within=path)
            data = read_whole(file)
            if not (recipes / name).is_file() or read_whole(recipes / name) != data:
                write_whole(recipes / name, data)
        return StudyFolder(path, plan, release)
