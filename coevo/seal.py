"""Summaries that carry a digest of themselves, and of the files beside them that they speak of."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import msgspec

from coevo.chain import sha256
from coevo.files import parse_json

__all__ = ["FILES", "seal", "unseal"]

FILES = "files"  # the digest of each file that a summary speaks of
_SEAL = "sha256"


def seal(told: Mapping[str, Any], files: Mapping[str, bytes] | None = None) -> bytes:
    """Return the JSON of a summary with its digest.

    Args:
        told: plain data.
        files: those beside it, by name; its digests of them are then a part of it.

    Example:
        >>> from coevo.seal import seal, unseal
        >>> unseal(seal({"seed": 1}, {"trials.csv": b""}))["seed"]
        1
    """
    digests = {FILES: {name: sha256(data) for name, data in files.items()}} if files else {}
    plain = msgspec.json.decode(msgspec.json.encode({**told, **digests}))  # as the file gives it back
    return msgspec.json.format(msgspec.json.encode({**plain, _SEAL: _digest(plain)}), indent=2) + b"\n"


def unseal(text: str | bytes) -> dict[str, Any]:
    """Return a summary, with the digests of its files; one of before has no digest of itself.

    Raises:
        ValueError: it is no summary, or does not match its digest.
    """
    read = parse_json(text)
    told: dict[str, Any] = read if isinstance(read, dict) else {FILES: None}
    files = told.get(FILES, {})
    if not isinstance(files, dict) or any(type(one) is not str for one in files.values()):
        raise ValueError("it is no summary")
    digest = told.pop(_SEAL, None)
    if digest not in (None, _digest(told)):
        raise ValueError("it does not match its digest")
    return told


def _digest(plain: Mapping[str, Any]) -> str:
    return sha256(json.dumps(plain, sort_keys=True).encode())
