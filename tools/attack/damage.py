"""Damage: every file of every kind of folder, in every way. What is read afterwards is refused, or is as before."""

from __future__ import annotations

import io
import os
import random
import shutil
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from fnmatch import fnmatch
from pathlib import Path

from folders import SLOW, ended, finish, results_of
from inputs import mutated
from runner import Case

from coevo.errors import InputError
from coevo.run import open_run
from coevo.soundness import check_run

__all__ = ["damages", "every", "spoil"]

WAYS = ("flip", "cut", "empty", "longer", "lost", "foreign", "fifo", "link", "rewritten", "swapped", "lines")


def damages(
    count: int, rng: random.Random, runs: Mapping[str, Path], whole: Path, folder: Path, names: str = "*"
) -> Iterator[Case]:
    """Yield damage of each file of each kind of run: going on refuses it, or comes to the same bytes.

    Args:
        runs: finished, and stopped half way, by name.
        whole: the finished one.
        folder: for copies.
        names: of the files to damage, as a pattern.
    """
    for kind, name, way, seed in every(count, rng, runs, names):
        yield Case(
            f"damage ({kind})",
            f"{name}, {way}, seed {seed}",
            lambda a=runs[kind], n=name, w=way, s=seed: _damage(a, n, w, random.Random(s), whole, folder / str(s)),
            SLOW,
        )


def _damage(source: Path, name: str, way: str, rng: random.Random, whole: Path, copy: Path) -> str:
    shutil.copytree(source, copy)
    try:
        changed = spoil(copy, name, way, rng)
        if not changed:
            return ""
        before = results_of(whole)
        run = None
        with suppress(InputError):
            run = open_run(copy)
        told = run is None or any(finding.state != "sound" for finding in check_run(run))
        if not told and name != "config.toml" and not name.startswith("results/"):
            return "the damage is not told by a check"
        with suppress(InputError):  # what is read is sound, or refused
            if run is not None:
                _ = run.individuals, run.generations, run.tree("r0", 0)
        try:
            finish(copy)
        except InputError:
            return "" if told else "a check told nothing, but the run is refused"
        return ended(copy, before)
    finally:
        shutil.rmtree(copy)


def every(
    count: int, rng: random.Random, folders: Mapping[str, Path], names: str = "*"
) -> Iterator[tuple[str, str, str, int]]:
    """Yield kind of folder, name of a file in it, way to damage it and a seed: all of them in turn, in random order."""
    all_of = [
        (kind, name, way)
        for kind, path in folders.items()
        for name in sorted(str(one.relative_to(path)) for one in path.rglob("*") if one.is_file())
        if fnmatch(name, names)
        for way in WAYS
    ]
    rng.shuffle(all_of)
    for number in range(count):
        yield *all_of[number % len(all_of)], rng.getrandbits(64)


def spoil(copy: Path, name: str, way: str, rng: random.Random) -> bool:
    """Damage a file; return whether it is not as good as it was."""
    path = copy / name
    data = path.read_bytes()
    match way:
        case "flip":
            at = rng.randrange(len(data)) if data else 0
            path.write_bytes(data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :] if data else b"x")
        case "cut" | "empty":
            path.write_bytes(data[: rng.randrange(len(data)) if way == "cut" and data else 0])
        case "longer":
            path.write_bytes(data + rng.choice((b"\0", b"\n", rng.randbytes(100), data)))
        case "lines":
            lines = data.split(b"\n")
            at = rng.randrange(len(lines))
            lines[at : at + 2] = rng.choice((lines[at + 1 : at + 2], lines[at : at + 2][::-1]))  # lost, or exchanged
            path.write_bytes(b"\n".join(lines))
        case "lost":
            path.unlink()
        case "foreign":
            path.write_bytes(rng.randbytes(rng.randrange(2000)))
        case "fifo":
            path.unlink()
            os.mkfifo(path)
            return True
        case "link":
            path.unlink()
            path.symlink_to("/dev/zero")
            return True
        case "rewritten":
            path.write_bytes(mutated(data, rng))
        case _:
            others = sorted(one for one in copy.rglob("*") if one.is_file() and one.suffix == path.suffix)
            path.write_bytes(rng.choice(others).read_bytes())
    return not path.exists() or not _as_good(path.name, path.read_bytes(), data)


def _as_good(name: str, found: bytes, before: bytes) -> bool:
    """Tell whether bytes that differ mean the same: the times in an archive, say, mean nothing."""
    if found == before or not name.endswith(".npz"):
        return found == before
    try:
        with zipfile.ZipFile(io.BytesIO(found)) as one, zipfile.ZipFile(io.BytesIO(before)) as other:
            return {n: one.read(n) for n in one.namelist()} == {n: other.read(n) for n in other.namelist()}
    except Exception:  # noqa: BLE001 - it is damaged
        return False
