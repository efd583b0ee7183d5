"""A learning that was stopped, as a file: where it stands, and which learning it is.

Randomness is derived from the seed and a trial's number, so models, table and the number of trials are all there is
to a learning. Going on gives what an undisturbed learning gives, to the last bit; therefore a checkpoint of other
settings, another version of the code or another kind of processor is refused.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from behaviors.tabular.table import Table
from coevo.compiled import cache_folder
from coevo.errors import InputError
from coevo.files import DamagedFileError, digest_of, pack_arrays, read_arrays, write_whole
from coevo.skill import ObjectModel
from coevo.skill.model import pack_models, unpack_models

__all__ = ["Standing", "read_checkpoint", "trials_done", "write_checkpoint"]

_FORMAT = 1
_REMEDY = "begin anew with --restart, which throws it away"


@dataclass
class Standing:
    """Where a learning stands.

    Attributes:
        models: how the state of each object is estimated.
        table: the values.
        done: how many trials have been run.
        best: (rows in use then, actions) values that did best in the checks, None before the first.
        best_score: what they scored.
        kept_after: how many trials had been run then.
    """

    models: tuple[ObjectModel, ...]
    table: Table
    done: int = 0
    best: NDArray[np.float64] | None = None
    best_score: float = -np.inf
    kept_after: int = 0


def write_checkpoint(path: Path, standing: Standing, learning: Mapping[str, Any]) -> None:
    """Write where a learning stands, whole or not at all.

    Args:
        path: an npz file.
        standing: what to keep.
        learning: what decides the result, plain data: another learning may not go on with it.

    Raises:
        OSError: it cannot be written.
    """
    table, used = standing.table, int(standing.table.used[0])
    objects, models = pack_models(standing.models)
    states = np.flatnonzero(table.rows >= 0)
    header = {
        "learning": learning,
        "objects": objects,
        "states": len(table.rows),
        "done": standing.done,
        "kept_after": standing.kept_after,
    }
    arrays: dict[str, NDArray[Any]] = {
        "format": np.array([_FORMAT]),
        "code": _text(cache_folder().name),
        "header": _text(json.dumps(header)),
        "values": table.values[:used],
        "visits": table.visits[:used],
        "fixed": table.fixed[:used],
        "state_of_row": states[np.argsort(table.rows[states])],
        "best_score": np.array([standing.best_score]),
        **models,
    }
    if standing.best is not None:
        arrays["best"] = standing.best
    arrays["digest"] = digest_of(arrays)
    write_whole(path, pack_arrays(arrays))


def read_checkpoint(path: Path, learning: Mapping[str, Any]) -> Standing:
    """Read where this very learning stands.

    Raises:
        InputError: the file is damaged, or is of another learning; it stays as it is.
    """
    arrays, header = _read(path)
    difference = _difference(header["learning"], json.loads(json.dumps(learning)))  # as JSON gives it back
    if difference is not None:
        raise InputError(f"{path} is of another learning: {difference}; go on as it was begun, or {_REMEDY}")
    if not np.array_equal(arrays["code"], _text(cache_folder().name)):
        raise InputError(
            f"{path} was written by another version of coevo or its libraries, or on another kind of processor, and"
            f" would not give the same skill; {_REMEDY}"
        )
    used = np.array([len(arrays["values"])])
    rows = np.full(header["states"], -1, np.int32)
    rows[arrays["state_of_row"]] = np.arange(used[0])
    return Standing(
        unpack_models(header["objects"], arrays),
        Table(arrays["values"], arrays["visits"], arrays["fixed"], rows, used),
        header["done"],
        arrays.get("best"),
        float(arrays["best_score"][0]),
        header["kept_after"],
    )


def trials_done(path: Path) -> str:
    """Return how far the learning of a checkpoint is, in words.

    Raises:
        InputError: the file is damaged.
    """
    _, header = _read(path)
    return f"{header['done']} of {header['learning']['trials']} trials"


def _read(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    try:
        arrays = read_arrays(path)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except DamagedFileError as error:
        raise InputError(f"{path} is no checkpoint of a learning or is damaged ({error}); {_REMEDY}") from None
    digest = arrays.pop("digest", None)
    if digest is None or "header" not in arrays or not np.array_equal(digest, digest_of(arrays)):
        raise InputError(
            f"{path} is no checkpoint of a learning or is damaged: its contents do not match its digest; {_REMEDY}"
        )
    if int(arrays["format"][0]) != _FORMAT:
        raise InputError(
            f"{path} has format {int(arrays['format'][0])}, this version reads format {_FORMAT}; {_REMEDY}"
        )
    header: dict[str, Any] = json.loads(bytes(arrays["header"]))
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
