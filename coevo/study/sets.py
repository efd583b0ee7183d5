"""The only reader and writer of folders of sets of chapter 3: a folder a method, with its settings, in it one a set.

A set's folder is written whole when the set is finished. While it is under way, a checkpoint stands beside it, in a
file whose name begins with a dot: readers pass over it.
"""

from __future__ import annotations

import csv
import io
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coevo.chain import sha256
from coevo.errors import InputError
from coevo.files import make_folder, parse_json, read_text, read_whole, write_whole
from coevo.run_reader import why_unsound
from coevo.seal import FILES, seal, unseal
from coevo.soundness import Finding, check_summary

__all__ = ["StoredSet", "StudyMethod", "check_set", "open_method", "read_set", "read_sets", "table_bytes", "write_set"]

_SETTINGS, _SUMMARY = "settings.json", "set.json"
_OF = "settings_sha256"  # in the summary


@dataclass(frozen=True)
class StudyMethod:
    """A method's folder in a study.

    Attributes:
        folder: that holds its sets.
    """

    folder: Path

    def set_folder(self, number: int) -> Path:
        """Return where a set is, or will be."""
        return self.folder / f"set-{number:02d}"

    def missing(self, sets: int) -> list[int]:
        """Return the numbers of the first ``sets`` that are not finished."""
        return [number for number in range(sets) if not self.set_folder(number).exists()]

    def checkpoint(self, number: int) -> Path:
        """Return where a set that is under way is kept."""
        return self.folder / f".{self.set_folder(number).name}.npz"


@dataclass(frozen=True)
class StoredSet:
    """A finished set.

    Attributes:
        folder: where it is.
        summary: what it came to.
    """

    folder: Path
    summary: dict[str, Any]

    def rows(self, name: str) -> list[dict[str, str]]:
        """Return the rows of a table, such as ``trials.csv``."""
        with (self.folder / name).open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))


def open_method(folder: Path, settings: str) -> StudyMethod:
    """Make the folder of a method; one that is there must be of the same settings.

    Raises:
        InputError: it is of other settings, or cannot be written.
    """
    path = folder / _SETTINGS
    try:
        make_folder(folder)
        if path.exists() and read_text(path) != settings:
            raise InputError(f"{folder} holds sets of other settings ({path}); choose another --out, or remove it")
        write_whole(path, settings.encode())
    except OSError as error:
        raise InputError(f"cannot write into {folder}: {error.strerror or error}; choose another --out") from None
    return StudyMethod(folder)


def write_set(method: StudyMethod, number: int, summary: bytes, files: Mapping[str, bytes]) -> None:
    """Write a set's folder whole or not at all, and remove its checkpoint; one that is there stays.

    Args:
        method, number: which set.
        summary: JSON, what it came to.
        files: the other files by name.

    Raises:
        OSError: it cannot be written.
    """
    folder, settings = method.set_folder(number), read_whole(method.folder / _SETTINGS)
    summary = seal({**parse_json(summary), _OF: sha256(settings)}, files)
    partial = folder.with_name(f".{folder.name}.{os.getpid()}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    for name, data in {**files, _SUMMARY: summary}.items():
        write_whole(partial / name, data)
    try:
        partial.rename(folder)
    except OSError:
        shutil.rmtree(partial, ignore_errors=True)
        if not folder.exists():
            raise
    method.checkpoint(number).unlink(missing_ok=True)


def table_bytes(rows: Sequence[Mapping[str, Any]], columns: Sequence[str] = ()) -> bytes:
    """Return rows as CSV; of no rows and no columns nothing.

    Args:
        rows: cells by column.
        columns: by default those of the first row; a row may lack some.
    """
    text = io.StringIO()
    if rows or columns:
        writer = csv.DictWriter(text, columns or list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return text.getvalue().encode()


def check_set(folder: Path) -> list[Finding]:
    """Return what is sound of a set: what it came to, its files, and the settings of its method."""
    found, path = check_summary(folder / _SUMMARY), folder.parent / _SETTINGS
    if found[0].state == "sound":
        summary = unseal(read_text(folder / _SUMMARY))
        known, why = summary.get(_OF), ""
        if known is None and "set" not in summary:
            return [Finding(_SUMMARY, "damaged", f"{folder / _SUMMARY} is damaged: it is no summary of a set")]
        if known is not None:
            why = why_unsound(folder.parent, _SETTINGS, known, "put it back as it was")
        found.append(Finding(f"../{path.name}", "damaged" if why else "sound", why))
    return found


def read_set(folder: Path) -> tuple[StoredSet, dict[str, Any]]:
    """Return one finished set, and the settings of its method.

    Raises:
        InputError: there is none, it cannot be read, or it is not as it was written.
    """
    read = []
    for path in (folder / _SUMMARY, folder.parent / _SETTINGS):
        try:
            read.append(unseal(read_text(path)))
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            raise InputError(
                f"{folder} is no finished set: cannot read {path} ({reason}); name a folder such as"
                " runs/chapter3/schedule/set-00"
            ) from None
    summary, settings = read
    for finding in check_set(folder):
        if finding.state == "damaged":
            raise InputError(finding.why)
    for name in (_OF, FILES):
        summary.pop(name, None)
    return StoredSet(folder, summary), settings


def read_sets(study: Path) -> dict[str, list[StoredSet]]:
    """Return the finished sets of every method in a study's folder, by the method's name.

    Raises:
        InputError: there is none.
    """
    found = {}
    for method in sorted(path.parent for path in study.glob(f"*/{_SETTINGS}")):
        folders = sorted(path.parent for path in method.glob(f"set-*/{_SUMMARY}"))
        if folders:
            found[method.name] = [read_set(folder)[0] for folder in folders]
    if not found:
        raise InputError(f"{study} holds no finished set; run 'coevo reproduce chapter3' first")
    return found
