"""The one reader and the one writer of files: whole or not at all, bounded, through no links; arrays without pickle.

What is read may come from a stranger. So only regular files are read (a pipe would block for ever), none that is larger
than its kind can be, and of an archive the sizes that it declares are checked before anything is unpacked.
"""

from __future__ import annotations

import errno
import hashlib
import io
import json
import math
import os
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "MOST_ARRAYS_BYTES",
    "MOST_FILE_BYTES",
    "MOST_TEXT_BYTES",
    "DamagedFileError",
    "begin_file",
    "digest_of",
    "end_file",
    "lock",
    "make_folder",
    "pack_arrays",
    "parse_json",
    "read_arrays",
    "read_text",
    "read_whole",
    "sync_file",
    "write_whole",
]

MOST_FILE_BYTES = 1 << 30  # of any file that is read in one piece
MOST_TEXT_BYTES = 16 << 20  # of settings, cards and the like
MOST_ARRAYS_BYTES = 1 << 29  # of all arrays of an archive together, unpacked
_MOST_ENTRIES = 4096
_MOST_HEADER = 4096
_MOST_FOLDERS = 200  # in one path
_PIECE = 1 << 20
_FLAGS = os.O_CLOEXEC | getattr(os, "O_NOFOLLOW", 0)
_SHAPE = r"\((?:[0-9]{1,12}(?:, ?[0-9]{1,12})*,?)?\)"
_HEADER = re.compile(
    r"\{'descr': '([<>|=]?[biufU]\d{1,4})', 'fortran_order': (True|False), 'shape': (" + _SHAPE + r"), \} *\n", re.ASCII
)


class DamagedFileError(Exception):
    """A file is there and can be read, but is not what it should be."""


# ------------------------------------------------------------------------------------------------ writing


def begin_file(partial: Path) -> IO[bytes]:
    """Make a file anew and open it; what stood there, a link too, is taken away and not followed."""
    with suppress(FileNotFoundError):
        partial.unlink()
    return os.fdopen(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _FLAGS, 0o666), "wb")


def end_file(partial: Path, path: Path) -> None:
    """Give a file that is written and synced its name, and see to it that the name lasts."""
    partial.replace(path)
    _sync_folder(path.parent)


def sync_file(path: Path) -> None:
    """See to it that what another library wrote into a file lasts."""
    handle = os.open(path, os.O_RDONLY | _FLAGS)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_whole(path: Path, data: bytes) -> None:
    """Write a file whole or not at all, even if the machine stops in between; a link is replaced, not followed.

    Raises:
        OSError: it cannot be written; a file that was there before is as it was.
    """
    partial = path.with_name(f".{path.name}.partial")  # readers of folders pass over names with a dot
    try:
        with begin_file(partial) as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        end_file(partial, path)
    except OSError:
        with suppress(OSError):
            partial.unlink()
        raise


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.EBADF, errno.ENOTSUP):  # some file systems do not sync folders
            raise
    finally:
        os.close(handle)


def make_folder(path: Path, *, within: Path | None = None) -> None:
    """Make a folder, and those above it, if they are not there.

    Args:
        path: where.
        within: a folder above it, from which on no link is followed.

    Raises:
        OSError: it cannot be made, lies too deep, or is a link that would lead out of ``within``.
    """
    if len(path.parts) > _MOST_FOLDERS:
        raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG), str(path))
    missing = []
    for folder in (path, *path.parents):
        if within is not None and within in folder.parents and folder.is_symlink():
            raise OSError(errno.ELOOP, "it is a link, and nothing is written through links", str(folder))
        if folder.is_dir():
            break
        if folder.exists():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))
        missing.append(folder)
    for folder in reversed(missing):
        folder.mkdir(exist_ok=True)
        _sync_folder(folder.parent)


def lock(path: Path) -> Callable[[], None]:
    """Lock a file, which is made if it is not there, against other processes; return what lets go of it.

    Raises:
        BlockingIOError: another process holds it.
        OSError: it cannot be written, or is no regular file.
    """
    try:
        import fcntl  # noqa: PLC0415 - not on every system
    except ImportError:  # no such locks on this system
        return lambda: None
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NONBLOCK | _FLAGS, 0o666)
        try:
            if not stat.S_ISREG(os.fstat(handle).st_mode):
                raise OSError(errno.EINVAL, "it is no regular file", str(path))
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise
            except OSError:  # a file system without locks
                return lambda: os.close(handle)
            if _is_there(path, handle):
                return lambda: _let_go(path, handle)
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)  # who held it has taken it away meanwhile: once more


def _is_there(path: Path, handle: int) -> bool:
    with suppress(FileNotFoundError):
        return os.path.samestat(os.lstat(path), os.fstat(handle))
    return False


def _let_go(path: Path, handle: int) -> None:
    with suppress(OSError):  # the folder may be gone
        if _is_there(path, handle):
            path.unlink()
    with suppress(OSError):
        os.close(handle)


# ------------------------------------------------------------------------------------------------ reading


def read_whole(path: Path, most: int = MOST_FILE_BYTES) -> bytes:
    """Read a regular file that is not larger than ``most`` bytes.

    Raises:
        OSError: it cannot be read, is a pipe, a device or a folder, or is too large.
        ValueError: no file can have this name.
    """
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    with os.fdopen(handle, "rb") as file:
        about = os.fstat(handle)
        if stat.S_ISDIR(about.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(about.st_mode):
            raise OSError(errno.EINVAL, "it is no regular file", str(path))
        if about.st_size > most:
            raise OSError(errno.EFBIG, f"it is larger than {most} bytes", str(path))
        data = file.read(most + 1)
        if len(data) > most:
            raise OSError(errno.EFBIG, f"it is larger than {most} bytes", str(path))
        return data


def read_text(path: Path, most: int = MOST_TEXT_BYTES) -> str:
    """Read a text as ``read_whole`` does.

    Raises:
        OSError: as of ``read_whole``.
        ValueError: it is no UTF-8 text, or no file can have this name.
    """
    return read_whole(path, most).decode("utf-8").replace("\r\n", "\n")


def parse_json(text: str | bytes) -> Any:
    """Read JSON.

    Raises:
        ValueError: it is none, or is nested too deep.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deep") from None


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


def read_arrays(path: Path, most: int = MOST_ARRAYS_BYTES) -> dict[str, NDArray[Any]]:
    """Read the arrays of an npz file: numbers, truth values and texts.

    Args:
        path: the file.
        most: bytes of all arrays together; what declares more is not unpacked.

    Raises:
        OSError: the file cannot be read.
        DamagedFileError: it is no npz file, is damaged, holds objects, or is too large.
    """
    content = read_whole(path, most)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            _check_entries(entries, most)
            return {entry.filename.removesuffix(".npy"): _read_array(archive, entry) for entry in entries}
    except DamagedFileError:
        raise
    # What zipfile raises about archives that somebody made to harm is of many kinds.
    except (ValueError, EOFError, LookupError, OSError, RuntimeError, ArithmeticError, zlib.error) as error:
        raise DamagedFileError(str(error) or type(error).__name__) from None
    except (zipfile.BadZipFile, zipfile.LargeZipFile, struct.error, MemoryError) as error:
        raise DamagedFileError(str(error) or type(error).__name__) from None


def _check_entries(entries: list[zipfile.ZipInfo], most: int) -> None:
    if len(entries) > _MOST_ENTRIES:
        raise DamagedFileError(f"it holds {len(entries)} arrays, and {_MOST_ENTRIES} is the most")
    if len({entry.filename for entry in entries}) < len(entries):
        raise DamagedFileError("it holds two arrays of one name")
    for entry in entries:
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or entry.flag_bits & 1:
            raise DamagedFileError(f"{entry.filename[:80]!r} is packed in a way that is not read")
    declared = sum(entry.file_size for entry in entries)
    if declared > most:
        raise DamagedFileError(f"it declares {declared} bytes of arrays, and {most} is the most")


def _read_array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """Return an array, whose header is read first: only what its shape needs is made, and filled piece by piece."""
    with archive.open(entry) as file:
        magic = file.read(8)
        sizes = {b"\x93NUMPY\x01\x00": 2, b"\x93NUMPY\x02\x00": 4}
        if magic not in sizes:
            raise DamagedFileError(f"{entry.filename[:80]!r} is no array")
        size = int.from_bytes(file.read(sizes[magic]), "little")
        if size > _MOST_HEADER:
            raise DamagedFileError(f"the header of {entry.filename[:80]!r} is too long")
        told = _HEADER.fullmatch(file.read(size).decode("latin-1"))
        if told is None:
            raise DamagedFileError(f"{entry.filename[:80]!r} holds something else than numbers or texts")
        # Python's own reader of tuples must not be called by several threads at once (python/cpython#106905).
        kind, shape = np.dtype(told[1]), tuple(int(size) for size in re.findall(r"[0-9]{1,12}", told[3]))
        if len(shape) > 32:
            raise DamagedFileError(f"{entry.filename[:80]!r} has no shape")
        left = entry.file_size - 8 - sizes[magic] - size
        if math.prod(shape) * kind.itemsize != left or max(shape, default=0) > MOST_FILE_BYTES:
            raise DamagedFileError(f"{entry.filename[:80]!r} is not as large as its shape says")
        data = bytearray(left)
        view, at = memoryview(data), 0
        while at < left:
            piece = file.read(min(_PIECE, left - at))
            if not piece:
                raise DamagedFileError(f"{entry.filename[:80]!r} ends too soon")
            view[at : at + len(piece)] = piece
            at += len(piece)
        if file.read(1):  # and so the sum of all of it is checked
            raise DamagedFileError(f"{entry.filename[:80]!r} is longer than it says")
    if kind.kind == "b" and np.frombuffer(data, np.uint8).max(initial=0) > 1:
        raise DamagedFileError(f"{entry.filename[:80]!r} holds truth values that are none")
    flat = np.frombuffer(data, kind)
    return flat.reshape(shape, order="F" if told[2] == "True" else "C")


def digest_of(arrays: Mapping[str, NDArray[Any]]) -> NDArray[np.uint8]:
    """Return the SHA-256 of arrays and their names, (32,)."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(f"{name} {arrays[name].dtype} {arrays[name].shape}".encode("utf-8", "surrogatepass"))
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return np.frombuffer(digest.digest(), np.uint8)
