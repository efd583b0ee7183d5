"""A folder whose files are written whole or not at all, by one process at a time, and what is found out about it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coevo.errors import InputError
from coevo.files import DamagedFileError, digest_of, lock, pack_arrays, read_arrays, write_whole

__all__ = ["Folder", "read_table", "save_lines", "save_whole", "writing"]


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn failures of writing into messages for the user."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(
            f"cannot write {path}: {reason}. What was saved before is intact; mend this and go on with 'coevo resume'"
        ) from None


def save_whole(path: Path, data: bytes) -> None:
    """Write a file whole or not at all; what goes wrong is told in words."""
    with writing(path):
        write_whole(path, data)


def save_lines(path: Path, lines: Sequence[str]) -> None:
    """Write a table of lines as ``save_whole`` does."""
    save_whole(path, ("\n".join(lines) + "\n").encode())


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
        data = path.read_bytes()
        if digest is not None and digest != hashlib.sha256(data).digest():
            raise InputError(f"{path} is damaged: its contents do not match its digest; {remedy}")
        # Arrow reads its own buffer, in this thread: a thread of its pool that holds a Python object while Python
        # ends aborts the process (apache/arrow#34314).
        return pq.ParquetFile(pa.BufferReader(data), pre_buffer=False).read(use_threads=False)
    except InputError:
        raise
    except (OSError, ValueError, pa.ArrowException) as error:
        first = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path} is damaged ({first}); {remedy}") from None


class Folder:
    """A folder on disk.

    Args:
        path: where it is.
        identity: of what it is about; results that were kept under another are refused.
    """

    def __init__(self, path: Path, identity: bytes) -> None:
        self.path, self._identity = path, identity

    @property
    def results(self) -> list[str]:
        """Names of what is kept of contests and the like."""
        return sorted(path.stem for path in (self.path / "results").glob("*.npz"))

    def save_result(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Keep arrays that were found out about this run, whole or not at all."""
        kept = {**arrays, "run": np.frombuffer(self._identity, np.uint8)}
        path = self.path / "results" / f"{name}.npz"
        with writing(path):
            path.parent.mkdir(exist_ok=True)
        save_whole(path, pack_arrays({**kept, "digest": digest_of(kept)}))

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
        except (LookupError, OSError, DamagedFileError, TypeError, ValueError) as error:
            raise InputError(f"{path} is damaged ({error}); {remedy}") from None
        return arrays

    def forget_results(self) -> None:
        """Remove what was found out, as it is of something else now; it is made anew when it is asked for."""
        for name in self.results:
            with writing(self.path / "results"):
                (self.path / "results" / f"{name}.npz").unlink()

    def lock(self) -> Callable[[], None]:
        """Keep other processes from writing into this run; return what lets go of it."""
        with writing(self.path):
            try:
                return lock(self.path / ".lock")
            except BlockingIOError:
                raise InputError(
                    f"{self.path} is being written by another coevo process; wait for it or stop it"
                ) from None
