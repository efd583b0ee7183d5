"""Numbers of a page, made small: differences, runs, and images of labels."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["differences", "pack_images", "runs"]

_LABEL_BITS = 4


def differences(column: NDArray[np.int64]) -> list[int]:
    """Return the first number, and of each other one the difference to the one before."""
    return [int(number) for number in np.diff(column, prepend=0)]


def runs(column: NDArray[Any]) -> list[int]:
    """Return value, number of steps, value, number of steps, ..."""
    return [int(number) for pair in zip(*_runs(column), strict=True) for number in pair]


def _runs(column: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Return the values of runs, and their lengths."""
    starts = np.flatnonzero(np.diff(column, prepend=column[:1] + 1))
    return column[starts], np.diff(starts, append=len(column))


def pack_images(images: NDArray[np.uint8]) -> str:
    """Return images of labels as base64 of a stream that zlib compressed.

    Each image is a row of runs down its columns, from left to right; a run is one number, 16 times its length plus its
    label, in bytes of seven bits, the lowest first, and all but the last with the eighth bit set.

    Args:
        images: (moments, rows, columns) uint8, labels below 16.
    """
    stream = bytearray()
    for image in np.ascontiguousarray(images.transpose(0, 2, 1)).reshape(len(images), -1).astype(np.int64):
        labels, lengths = _runs(image)
        for number in ((lengths << _LABEL_BITS) + labels).tolist():
            rest = number
            while rest > 0x7F:
                stream.append(rest & 0x7F | 0x80)
                rest >>= 7
            stream.append(rest)
    return base64.b64encode(zlib.compress(bytes(stream), 9)).decode("ascii")
