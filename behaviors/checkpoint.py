"""A learning that was stopped, as a file: where it stands, and which learning it is.

Randomness is derived from the seed and a trial's number, so models, tables, what is stored and the number of trials
are all there is to a learning. Going on gives what an undisturbed learning gives, to the last bit; therefore a
checkpoint of other settings, another version of the code or another kind of processor is refused.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import cache_folder
from coevo.errors import InputError
from coevo.files import DamagedFileError, digest_of, pack_arrays, parse_json, read_arrays, write_whole

__all__ = ["REMEDY", "parts_of", "read_checkpoint", "trials_done", "with_prefix", "write_checkpoint"]

_FORMAT = 2
REMEDY = "begin anew with --restart, which throws it away"


def write_checkpoint(
    path: Path, learning: Mapping[str, Any], header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write where a learning stands, whole or not at all.

    Args:
        path: an npz file.
        learning: what decides the result, plain data: another learning may not go on with it.
        header: where it stands, plain data.
        arrays: the rest of it.

    Raises:
        OSError: it cannot be written.
    """
    whole: dict[str, NDArray[Any]] = {
        "format": np.array([_FORMAT]),
        "code": _text(cache_folder().name),
        "header": _text(json.dumps({"learning": learning, "at": header})),
        **arrays,
    }
    whole["digest"] = digest_of(whole)
    write_whole(path, pack_arrays(whole))


def read_checkpoint(
    path: Path, learning: Mapping[str, Any], *, remedy: str = REMEDY
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return header and arrays of where this very learning stands.

    Args:
        path: the file.
        learning: what decides the result.
        remedy: what a user can do about a file that does not serve.

    Raises:
        InputError: the file is damaged, or is of another learning; it stays as it is.
    """
    arrays, header = _read(path, remedy)
    difference = _difference(header["learning"], json.loads(json.dumps(learning)))  # as JSON gives it back
    if difference is not None:
        raise InputError(f"{path} is of another learning: {difference}; go on as it was begun, or {remedy}")
    if not np.array_equal(arrays["code"], _text(cache_folder().name)):
        raise InputError(
            f"{path} was written by another version of coevo or its libraries, or on another kind of processor, and"
            f" would not give the same skill; {remedy}"
        )
    return header["at"], arrays


def trials_done(path: Path) -> str:
    """Return how far the learning of a checkpoint is, in words.

    Raises:
        InputError: the file is damaged.
    """
    _, header = _read(path)
    return f"{header['at']['done']} of {header['learning']['trials']} trials"


def with_prefix(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return arrays under names that begin with a prefix."""
    return {f"{prefix}.{name}": array for name, array in arrays.items()}


def parts_of(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the arrays whose names begin with a prefix, without it."""
    start = f"{prefix}."
    return {name.removeprefix(start): array for name, array in arrays.items() if name.startswith(start)}


def _read(path: Path, remedy: str = REMEDY) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    try:
        arrays = read_arrays(path)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except DamagedFileError as error:
        raise InputError(f"{path} is no checkpoint of a learning or is damaged ({error}); {remedy}") from None
    digest = arrays.pop("digest", None)
    if digest is None or "header" not in arrays or not np.array_equal(digest, digest_of(arrays)):
        raise InputError(
            f"{path} is no checkpoint of a learning or is damaged: its contents do not match its digest; {remedy}"
        )
    if int(arrays["format"][0]) != _FORMAT:
        raise InputError(f"{path} has format {int(arrays['format'][0])}, this version reads format {_FORMAT}; {remedy}")
    try:
        header: dict[str, Any] = parse_json(bytes(arrays["header"]))
    except ValueError as error:
        raise InputError(f"{path} is damaged ({error}); {remedy}") from None
    return arrays, header


def _text(text: str) -> NDArray[np.uint8]:
    return np.frombuffer(text.encode(), np.uint8)


def _difference(there: Any, here: Any, where: str = "") -> str | None:
    """Return the first difference of plain data in words, None if there is none."""
    if isinstance(there, Mapping) and isinstance(here, Mapping):
        pairs = [
            (str(key), there.get(key), here.get(key)) for key in [*here, *(key for key in there if key not in here)]
        ]
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        pairs = [(str(i), one, other) for i, (one, other) in enumerate(zip(there, here, strict=True))]
    else:
        return None if there == here else f"{where} is {there!r} there and {here!r} here"
    found = (_difference(one, other, f"{where}.{key}" if where else key) for key, one, other in pairs)
    return next((difference for difference in found if difference is not None), None)
