"""Files that appear whole or not at all."""

from __future__ import annotations

import os
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from coevo.errors import InputError
from coevo.files import begin_file, end_file, sync_file

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
        if path.exists() and not path.is_file():
            raise InputError(f"cannot write {path}: it is no regular file; give the name of a file")
        # The suffix stays the last part: OpenCV tells the format by it, and takes a name with a colon for an address.
        partial = path.absolute().with_name(f".coevo-{os.getpid()}.partial{path.suffix}")
        begin_file(partial).close()
        yield partial
        sync_file(partial)
        end_file(partial, path.absolute())
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"cannot write {path}: there is no folder {path.parent}; make it first") from None
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    except ValueError as error:  # of the name
        raise InputError(f"cannot write {str(path)!r}: {error}") from None
    finally:
        if partial is not None:
            with suppress(OSError):
                partial.unlink()
