"""Compile functions with numba, and keep the machine code of every version of the sources apart.

numba's own cache looks only at the file that defines a function: an edit of a helper or a constant in
another file would go on running the old machine code. Here the folder of the cache is named by a digest of
every kernel source and of the versions of the libraries, so that stale code can never be run.

Parts of kernels (``helper``, ``inlined``) are compiled once for each combination of types, whatever the values: numba
would make a copy for every literal argument such as ``t = 0``, and machine code of every part alone. Python calls
entries; it may call a part too, which then is compiled by itself in each process.
"""

from __future__ import annotations

import hashlib
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache, cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar, cast

import llvmlite.binding
import numba
import platformdirs
from numba import types
from numba.core import cgutils
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

__all__ = ["KERNEL_SOURCES", "borrowed", "cache_folder", "entry", "helper", "inlined", "is_compiled", "start_costs"]

_F = TypeVar("_F", bound=Callable[..., Any])
_PACKAGES = Path(__file__).resolve().parents[1]
_LIBRARIES = ("numba", "llvmlite", "numpy", "pymunk")
_OPTIONS: dict[str, Any] = {"nogil": True, "fastmath": False, "error_model": "numpy"}
_entries: list[Any] = []
_decorating = threading.Lock()

# Where compiled code may stand: files, and folders with all that is in them. A number that a kernel uses must come from
# one of these too, as the machine code holds it.
KERNEL_SOURCES = (
    "coevo/compiled.py",
    "coevo/game",
    "coevo/skill",
    "coevo/soccer",
    "coevo/stage",
    "coevo/tree",
    "behaviors/actor_critic",
    "behaviors/tabular",
    "behaviors/trials",
)


def _kernel_files() -> list[Path]:
    found: list[Path] = []
    for name in KERNEL_SOURCES:
        path = _PACKAGES / name
        found += [path] if path.suffix else path.rglob("*.py")
    return sorted(path for path in found if path.exists())


@cache
def cache_folder() -> Path:
    """Return the folder that holds the machine code of exactly these sources on this kind of processor."""
    digest = hashlib.sha256()
    for library in _LIBRARIES:
        digest.update(f"{library} {version(library)}\n".encode())
    digest.update(f"{sys.version} {platform.machine()} {llvmlite.binding.get_host_cpu_name()}\n".encode())
    for path in _kernel_files():
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


class _PartLibrary(JITCodeLibrary):  # type: ignore[misc]  # numba carries no types
    """Code of a part, which becomes machine code only in the entries that it is linked into.

    Left to itself numba optimises every part and makes machine code of it, and does both again for each caller.
    """

    def finalize(self) -> None:
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)  # noqa: SLF001 - numba's name
        self._finalized = True

    def get_pointer_to_function(self, _name: str) -> int:
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        return _WithoutEnvironment()


class _WithoutEnvironment:
    """Takes the Python environment of a part, which has none: nothing in a part touches Python's objects."""

    def set_env(self, _name: str, _environment: Any) -> None:
        return


class _PartCompiler(Compiler):  # type: ignore[misc]  # numba carries no types
    """numba's compiler, which puts its result into a ``_PartLibrary``."""

    def define_pipelines(self) -> Any:
        self.state["library"] = _PartLibrary(self.state.targetctx.codegen(), "part")
        return super().define_pipelines()


class _Part(CPUDispatcher):  # type: ignore[misc]  # numba carries no types
    """A part of kernels. It has no wrapper for Python, which gets one when it calls: to try a part, or to test it."""

    def __call__(self, *arguments: Any) -> Any:
        return self._alone(*arguments)

    @cached_property
    def _alone(self) -> Any:
        part = self

        @numba.njit(**_OPTIONS)
        def alone(*arguments: Any) -> Any:
            return part(*arguments)

        return alone


def _part(function: _F, **options: bool) -> _F:
    compiled = numba.njit(
        no_cpython_wrapper=True, no_cfunc_wrapper=True, pipeline_class=_PartCompiler, **_OPTIONS, **options
    )(function)
    resolve = compiled.get_call_template

    def resolve_types(arguments: Any, named: Any) -> Any:
        plain = {name: types.unliteral(kind) for name, kind in named.items()}
        return resolve(tuple(types.unliteral(kind) for kind in arguments), plain)

    compiled.get_call_template = resolve_types
    compiled.__class__ = _Part
    return cast("_F", compiled)


def helper(function: _F) -> _F:
    """Compile ``function`` as a part of the entry kernels that call it."""
    return _part(function)


def inlined(function: _F) -> _F:
    """Compile ``function`` into each place that calls it.

    For what runs in every step and takes whole tuples of arrays: handing a hundred words over costs more than the work.
    """
    return _part(function, forceinline=True)


def entry(function: _F) -> _F:
    """Compile ``function`` as a kernel that Python calls; its machine code is kept on disk."""
    with _decorating:
        before = numba.config.CACHE_DIR
        numba.config.CACHE_DIR = str(cache_folder())
        try:
            compiled = _kept(function)
        finally:
            numba.config.CACHE_DIR = before
    _entries.append(compiled)
    return cast("_F", compiled)


def _kept(function: Callable[..., Any]) -> Any:
    """Compile a kernel whose machine code is kept in the folder of these sources, or nowhere.

    Where that folder cannot be written numba takes one beside the source, which it does not keep apart by versions.
    """
    with suppress(RuntimeError):  # it finds no place at all
        compiled = numba.njit(cache=True, no_cfunc_wrapper=True, **_OPTIONS)(function)
        kept = compiled._cache  # noqa: SLF001 - numba's own name for it
        if Path(kept.cache_path).is_relative_to(cache_folder()):
            compiled._cache = _ForgivingCache(kept)  # noqa: SLF001 - the same
            return compiled
    return numba.njit(no_cfunc_wrapper=True, **_OPTIONS)(function)


class _ForgivingCache:
    """numba's cache of one entry, which does without where its files are damaged or cannot be written."""

    def __init__(self, cache: Any) -> None:
        self._cache = cache

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the machine code for a signature; None if there is none that can be read."""
        try:
            return self._cache.load_overload(signature, context)
        except Exception:  # noqa: BLE001 - a damaged pickle fails in any way
            with suppress(Exception):
                self._cache.flush()
            return None

    def save_overload(self, signature: Any, data: Any) -> None:
        """Keep machine code, if it can be kept."""
        with suppress(Exception):
            self._cache.save_overload(signature, data)


def is_compiled(function: Callable[..., Any]) -> bool:
    """Tell whether ``function`` has machine code on disk or in memory, so that a first call will not compile."""
    if getattr(function, "signatures", None):
        return True
    name = getattr(function, "__qualname__", "")
    folder = cache_folder()
    return (folder.is_dir() and any(folder.glob(f"*/*.{name}-*.nbi"))) or any(folder.glob(f"*.{name}-*.nbi"))


def start_costs(code: str) -> tuple[float, float]:
    """Return what compiling for a program costs, and how long it takes when nothing has to be compiled.

    Args:
        code: Python code that a process of its own runs, four times.

    Returns:
        CPU seconds with an empty cache less those with a full one; seconds on the clock with a full one, the median.
    """
    cpu, clock = [], []
    with tempfile.TemporaryDirectory(prefix="coevo-cache-") as folder:
        for _ in range(4):
            began = time.perf_counter()
            environment = os.environ | {"COEVO_CACHE_DIR": folder}
            process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL, env=environment)  # noqa: S603 - our own code
            _, status, used = os.wait4(process.pid, 0)  # of this child alone: others may be reaped meanwhile
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode:
                raise subprocess.CalledProcessError(process.returncode, process.args)
            cpu.append(used.ru_utime + used.ru_stime)
            clock.append(time.perf_counter() - began)
    return cpu[0] - statistics.median(cpu[1:]), statistics.median(clock[1:])
