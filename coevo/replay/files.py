"""Files that appear whole or not at all."""

from __future__ import annotations

import os
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from coevo.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

__all__ = ["whole_file"]


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give an empty file beside ``path`` to fill; it takes the place of ``path`` if all goes well.

    Raises:
        InputError: the file cannot be written there; what was there before stays.
    """
    partial: Path | None = None
    try:
        if path.is_dir():
            raise InputError(f"cannot write {path}: it is a folder; give the name of a file in it")
        # The suffix stays the last part: OpenCV tells the format by it.
        partial = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
        partial.write_bytes(b"")
        yield partial
        partial.replace(path)
    except FileNotFoundError:
        raise InputError(f"cannot write {path}: there is no folder {path.parent}; make it first") from None
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        if partial is not None:
            with suppress(OSError):
                partial.unlink()
