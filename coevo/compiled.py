"""Compile functions with numba, and keep the machine code of every version of the sources apart.

numba's own cache looks only at the file that defines a function: an edit of a helper or a constant in
another file would go on running the old machine code. Here the folder of the cache is named by a digest of
every kernel source and of the versions of the libraries, so that stale code can never be run.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import sys
import threading
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar, cast

import llvmlite.binding
import numba
import platformdirs
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

__all__ = ["borrowed", "cache_folder", "entry", "helper", "inlined", "is_compiled"]

_F = TypeVar("_F", bound=Callable[..., Any])
_PACKAGES = Path(__file__).resolve().parents[1]
_DECORATED = re.compile(rb"^from coevo\.compiled import .*\b(entry|helper|inlined)\b", re.MULTILINE)
_TAKEN_FROM = re.compile(rb"^from behaviors\.([\w.]+) import", re.MULTILINE)
_LIBRARIES = ("numba", "llvmlite", "numpy", "pymunk")
_entries: list[Any] = []
_decorating = threading.Lock()


def _kernel_sources() -> list[Path]:
    """Every source that may hold compiled code: it is cheaper to compile once too often than to run old code."""
    folders = [_PACKAGES / "coevo" / part for part in ("soccer", "skill", "tree")]
    singles = [_PACKAGES / "coevo" / "game.py", _PACKAGES / "coevo" / "compiled.py"]
    found = [path for folder in folders for path in folder.glob("*.py")]
    return sorted(path for path in [*found, *singles, *_learning_sources()] if path.exists())


def _learning_sources() -> set[Path]:
    """The modules of behaviors that hold compiled code, and those that they take names from."""
    texts = {path: path.read_bytes() for path in (_PACKAGES / "behaviors").rglob("*.py")}
    waiting = [path for path, text in texts.items() if _DECORATED.search(text)]
    found: set[Path] = set()
    while waiting:
        path = waiting.pop()
        if path in texts and path not in found:
            found.add(path)
            for name in _TAKEN_FROM.findall(texts[path]):
                module = _PACKAGES.joinpath("behaviors", *name.decode().split("."))
                waiting += [module.with_suffix(".py"), module / "__init__.py"]
    return found


@cache
def cache_folder() -> Path:
    """Return the folder that holds the machine code of exactly these sources on this kind of processor."""
    digest = hashlib.sha256()
    for library in _LIBRARIES:
        digest.update(f"{library} {version(library)}\n".encode())
    digest.update(f"{sys.version} {platform.machine()} {llvmlite.binding.get_host_cpu_name()}\n".encode())
    for path in _kernel_sources():
        digest.update(path.relative_to(_PACKAGES).as_posix().encode() + b"\0" + path.read_bytes())
    root = os.environ.get("COEVO_CACHE_DIR") or platformdirs.user_cache_dir("coevo")
    return Path(root) / digest.hexdigest()[:20]


def _without_owner(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, types.Array):
        array = make_array(kind)(context, builder, value=value)
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        array.parent = cgutils.get_null_value(array.parent.type)
        return array._getvalue()  # noqa: SLF001 - numba's own name for it
    if isinstance(kind, types.BaseTuple):
        parts = cgutils.unpack_tuple(builder, value, len(kind))
        parts = [_without_owner(context, builder, *part) for part in zip(kind.types, parts, strict=True)]
        return context.make_tuple(builder, kind, parts)
    return value


@intrinsic
def borrowed(_typing: Any, value: Any) -> Any:
    """Return arrays, or tuples of arrays, without their owner: for compiled code only.

    numba counts references to an array's owner with atomic operations whenever a row is taken or an array handed to
    another function, which costs as much as the work on a few numbers. An entry that borrows its arguments counts
    nothing; its caller keeps them alive.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _without_owner(context, builder, signature.args[0], arguments[0])

    return value(value), generate


def helper(function: _F) -> _F:
    """Compile ``function`` as a part of the entry kernels that call it."""
    return cast("_F", numba.njit(nogil=True, fastmath=False, error_model="numpy")(function))


def inlined(function: _F) -> _F:
    """Compile ``function`` into each place that calls it.

    For what runs in every step and takes whole tuples of arrays: handing a hundred words over costs more than the work.
    """
    return cast("_F", numba.njit(nogil=True, fastmath=False, error_model="numpy", forceinline=True)(function))


def entry(function: _F) -> _F:
    """Compile ``function`` as a kernel that Python calls; its machine code is kept on disk."""
    with _decorating:
        before = numba.config.CACHE_DIR
        numba.config.CACHE_DIR = str(cache_folder())
        try:
            compiled = numba.njit(nogil=True, fastmath=False, error_model="numpy", cache=True)(function)
        finally:
            numba.config.CACHE_DIR = before
    _entries.append(compiled)
    return cast("_F", compiled)


def is_compiled(function: Callable[..., Any]) -> bool:
    """Tell whether ``function`` has machine code on disk or in memory, so that a first call will not compile."""
    if getattr(function, "signatures", None):
        return True
    name = getattr(function, "__qualname__", "")
    folder = cache_folder()
    return (folder.is_dir() and any(folder.glob(f"*/*.{name}-*.nbi"))) or any(folder.glob(f"*.{name}-*.nbi"))
