"""What settings name as ``module:name``: functions and games of one's own, found beside the recipe or installed.

A module that is one file beside the recipe, or in the current folder, is copied into the run folder, so that a
run goes on, and can be repeated, with the very code it began with.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import re
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from coevo.errors import InputError, nearest_name

__all__ = ["load_callable", "own_failure", "own_file", "search_folders"]

_REFERENCE = re.compile(r"([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*):([A-Za-z_]\w*)", re.ASCII)
_importing = threading.RLock()


def search_folders(first: Path) -> tuple[Path, ...]:
    """Return where modules of one's own are looked for: ``first``, a recipe's or a run's folder, then the current."""
    return first.resolve(), Path.cwd()


def own_file(reference: str, folders: Sequence[Path]) -> Path | None:
    """Return the file beside a recipe that ``module:name`` points to; None if it is installed, or not there."""
    module = reference.partition(":")[0]
    paths = (folder / f"{module}.py" for folder in folders)
    return next((path for path in paths if "." not in module and path.is_file()), None)


def load_callable(reference: str, setting: str, folders: Sequence[Path]) -> Callable[..., Any]:
    """Import what ``module:name`` points to.

    Args:
        reference: module and name.
        setting: where it stands, for messages.
        folders: where modules are looked for before all others.

    Raises:
        InputError: there is no such module or name, importing fails, or it cannot be called.
    """
    match = _REFERENCE.fullmatch(reference)
    if match is None:
        raise InputError(f"{setting}: expected module:name, such as mine:reach_the_ball, got {reference!r}")
    name, attribute = match.groups()
    path = own_file(reference, folders)
    with _first_on_the_path(folders):
        try:
            module = importlib.import_module(name) if path is None else _from_file(path)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - whatever its author did
            if isinstance(error, ModuleNotFoundError) and error.name == name.partition(".")[0]:
                places = " or ".join(str(folder) for folder in dict.fromkeys(folders))
                raise InputError(
                    f"{setting}: there is no module {name!r} in {places}, and none is installed; put {name}.py there"
                ) from None
            raise own_failure(f"{setting}: importing {name!r}", error) from None
    if not hasattr(module, attribute):
        near = nearest_name(attribute, [found for found in vars(module) if not found.startswith("_")])
        raise InputError(f"{setting}: the module {name!r} has no {attribute!r}.{near}")
    found: Callable[..., Any] = getattr(module, attribute)
    if not callable(found):
        raise InputError(f"{setting}: {reference} is no function, but {found!r}")
    return found


def _from_file(path: Path) -> ModuleType:
    """Import a file under a name of its own: two folders may hold files of one name, and it may change."""
    name = f"coevo_own_{hashlib.sha256(str(path).encode() + path.read_bytes()).hexdigest()[:16]}_{path.stem}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up while it is being made
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


@contextmanager
def _first_on_the_path(folders: Sequence[Path]) -> Iterator[None]:
    with _importing:
        before = list(sys.path)
        sys.path[:0] = [str(folder) for folder in dict.fromkeys(folders)]
        try:
            yield
        finally:
            sys.path[:] = before


def own_failure(what: str, error: BaseException) -> InputError:
    """Return what to tell a user whose own code failed: the error, and the line that it comes from."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    if isinstance(error, SyntaxError):
        place = f" ({Path(error.filename or '?').name}, line {error.lineno})"
        return InputError(f"{what} failed: SyntaxError: {error.msg}{place}")
    text = " ".join(str(error).split())
    return InputError(f"{what} failed: {type(error).__name__}{': ' if text else ''}{text}{place}")
