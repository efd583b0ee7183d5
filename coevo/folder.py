"""A folder whose files are written whole or not at all, by one process at a time, and what is found out about it."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coevo.errors import InputError
from coevo.files import (
    MOST_FILE_BYTES,
    DamagedFileError,
    digest_of,
    lock,
    make_folder,
    pack_arrays,
    read_arrays,
    read_text,
    read_whole,
    write_whole,
)

__all__ = [
    "SAME_COMMAND",
    "Folder",
    "held",
    "lock_folder",
    "read_lines",
    "read_table",
    "save_lines",
    "save_whole",
    "writing",
]


_MOST_VALUES = 100_000_000  # of a table
_PATIENCE_S = 20.0  # for another process that keeps a result
_RESUME = "go on with 'coevo resume'"
SAME_COMMAND = "give the same command again"
_ASK = f"{SAME_COMMAND}; after 'coevo evolve', 'coevo resume'"  # commands of many names keep results


@contextmanager
def writing(path: Path, then: str = _RESUME) -> Iterator[None]:
    """Turn failures of writing into messages for the user; ``then`` says what to do when it is mended."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(
            f"cannot write {path}: {reason}. What was saved before is intact; mend this and {then}"
        ) from None


def lock_folder(path: Path, then: str = _RESUME) -> Callable[[], None]:
    """Keep other processes from writing into a folder; return what lets go of it; ``then`` as for ``writing``.

    Raises:
        InputError: another process holds it, or it cannot be written.
    """
    with writing(path, then):
        try:
            return lock(path / ".lock")
        except BlockingIOError:
            raise InputError(f"{path} is being written by another coevo process; wait for it or stop it") from None


@contextmanager
def held(path: Path, patience_s: float = 0.0, then: str = _RESUME) -> Iterator[None]:
    """Hold a folder as ``lock_folder`` does, and wait for another process that does for a while."""
    until = time.monotonic() + patience_s
    while True:
        try:
            release = lock_folder(path, then)
            break
        except InputError:
            if time.monotonic() >= until:
                raise
            time.sleep(0.05)
    try:
        yield
    finally:
        release()


def save_whole(path: Path, data: bytes, then: str = _RESUME) -> None:
    """Write a file whole or not at all; what goes wrong is told in words, ``then`` as for ``writing``."""
    with writing(path, then):
        write_whole(path, data)


def save_lines(path: Path, lines: Sequence[str]) -> None:
    """Write a table of lines as ``save_whole`` does."""
    save_whole(path, ("\n".join(lines) + "\n").encode())


def read_lines(path: Path) -> list[str]:
    """Return the lines of a table that ``save_lines`` wrote.

    Raises:
        OSError, ValueError: it cannot be read, or its last line is cut.
    """
    text = read_text(path, MOST_FILE_BYTES)
    if not text.endswith("\n"):
        raise ValueError("its last line is cut")
    return text[:-1].split("\n")  # and not at what else may end a line


def read_table(path: Path, digest: bytes | None, remedy: str) -> Any:
    """Read a Parquet file as a table of Arrow.

    Args:
        path: where it is.
        digest: its SHA-256, None if it is not known.
        remedy: what to do if it is damaged, for the message.

    Raises:
        InputError: it is damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        data = read_whole(path)
        if digest is not None and digest != hashlib.sha256(data).digest():
            raise InputError(f"{path} is damaged: its contents do not match its digest; {remedy}")
        # Arrow reads its own buffer, in this thread: a thread of its pool that holds a Python object while Python
        # ends aborts the process (apache/arrow#34314).
        file = pq.ParquetFile(pa.BufferReader(data), pre_buffer=False)
        _check_size(file.metadata)
        return file.read(use_threads=False)
    except InputError:
        raise
    except (OSError, ValueError, pa.ArrowException) as error:
        first = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path} is damaged ({first}); {remedy}") from None


def _check_size(about: Any) -> None:
    """Refuse a table that declares more values than any generation has, before they are unpacked."""
    groups = [about.row_group(number) for number in range(about.num_row_groups)]
    values = sum(group.column(number).num_values for group in groups for number in range(group.num_columns))
    if max(values, about.num_rows) > _MOST_VALUES:
        raise ValueError(f"it declares {values} values, and {_MOST_VALUES} is the most")


class Folder:
    """A folder on disk.

    Args:
        path: where it is.
        identity: of what it is about; results that were kept under another are refused.
    """

    def __init__(self, path: Path, identity: bytes) -> None:
        self.path, self._identity = path, identity
        self._keeps = False  # whether this process holds the results

    @property
    def results(self) -> list[str]:
        """Names of what is kept of contests and the like."""
        return sorted(path.stem for path in (self.path / "results").glob("*.npz"))

    def save_result(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Keep arrays that were found out about this run, whole or not at all."""
        told = {"run": np.frombuffer(self._identity, np.uint8), "name": np.frombuffer(name.encode(), np.uint8)}
        kept = {**arrays, **told}
        path = self.path / "results" / f"{name}.npz"
        with writing(path, _ASK):
            make_folder(path.parent, within=self.path)
        with nullcontext() if self._keeps else held(path.parent, _PATIENCE_S, _ASK):
            save_whole(path, pack_arrays({**kept, "digest": digest_of(kept)}), _ASK)

    def result(self, name: str) -> dict[str, NDArray[Any]] | None:
        """Return what was kept under a name, None if nothing was.

        Raises:
            InputError: it is damaged or belongs to another run.
        """
        path = self.path / "results" / f"{name}.npz"
        if not path.exists():
            return None
        remedy = "delete it; it is made anew when it is asked for"
        try:
            arrays = read_arrays(path)
            if not np.array_equal(arrays.pop("digest"), digest_of(arrays)):
                raise InputError(f"{path} is damaged: its contents do not match its digest; {remedy}")
            if bytes(arrays.pop("run")) != self._identity:
                raise InputError(f"{path} belongs to another run; {remedy}")
            if bytes(arrays.pop("name")) != name.encode():
                raise InputError(f"{path} is a result of another name; {remedy}")
        except (LookupError, OSError, DamagedFileError, TypeError, ValueError) as error:
            raise InputError(f"{path} is damaged ({error}); {remedy}") from None
        return arrays

    @contextmanager
    def keeping_results(self) -> Iterator[None]:
        """Keep other processes from keeping results meanwhile: for what plays long and saves often.

        Raises:
            InputError: another process does so, or the folder cannot be written.
        """
        path = self.path / "results"
        with writing(path, _ASK):
            make_folder(path, within=self.path)
        with held(path, then=_ASK):
            self._keeps = True
            try:
                yield
            finally:
                self._keeps = False

    def forget_results(self) -> None:
        """Remove what was found out, as it is of something else now; it is made anew when it is asked for."""
        for name in self.results:
            with writing(self.path / "results"):
                (self.path / "results" / f"{name}.npz").unlink()

    def lock(self) -> Callable[[], None]:
        """Keep other processes from writing into this run; return what lets go of it."""
        return lock_folder(self.path)
