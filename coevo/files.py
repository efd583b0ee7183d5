"""Files that are written whole or not at all, and arrays in them without pickle."""

from __future__ import annotations

import hashlib
import io
import os
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["DamagedFileError", "digest_of", "lock", "pack_arrays", "read_arrays", "write_whole"]


class DamagedFileError(Exception):
    """A file is there and can be read, but is not what it should be."""


def write_whole(path: Path, data: bytes) -> None:
    """Write a file whole or not at all, even if the machine stops in between.

    Raises:
        OSError: it cannot be written; a file that was there before is as it was.
    """
    partial = path.with_name(f".{path.name}.partial")  # readers of folders pass over names with a dot
    try:
        with partial.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError:
        partial.unlink(missing_ok=True)
        raise


def lock(path: Path) -> Callable[[], None]:
    """Lock a file, which is made if it is not there, against other processes; return what lets go of it.

    Raises:
        BlockingIOError: another process holds it.
        OSError: it cannot be written.
    """
    try:
        import fcntl  # noqa: PLC0415 - not on every system
    except ImportError:  # no such locks on this system
        return lambda: None
    file = path.open("w")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise
    except OSError:  # a file system without locks
        return file.close
    return file.close


def pack_arrays(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return arrays as npz; the same arrays give the same bytes."""
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            entry = zipfile.ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            data = io.BytesIO()
            np.lib.format.write_array(data, np.ascontiguousarray(array), allow_pickle=False)
            archive.writestr(entry, data.getvalue())
    return whole.getvalue()


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read the arrays of an npz file.

    Raises:
        OSError: the file cannot be read.
        DamagedFileError: it is no npz file, is damaged, or holds objects.
    """
    content = path.read_bytes()
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:  # reading a whole entry checks its sum
            return {
                name.removesuffix(".npy"): np.lib.format.read_array(io.BytesIO(archive.read(name)), allow_pickle=False)
                for name in archive.namelist()
            }
    except (ValueError, EOFError, KeyError, OSError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise DamagedFileError(str(error)) from None


def digest_of(arrays: Mapping[str, NDArray[Any]]) -> NDArray[np.uint8]:
    """Return the SHA-256 of arrays and their names, (32,)."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(f"{name} {arrays[name].dtype} {arrays[name].shape}".encode())
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return np.frombuffer(digest.digest(), np.uint8)
