"""Attack coevo: kills, crashes, damage, links, races, inputs that nobody means; a table of what was tried and failed.

``make attack`` does all of it, in about half an hour on two cores; ``make attack ARGS="--scale 0.01"`` a small share.
With ``--mutation NAME`` a part of the code is taken away first, and the attack must fail.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path

from damage import damages
from folders import crashes, finish, full_disks, links, small
from inputs import archives, settings, trees
from kills import commands, kills, races, read_only
from reading import readings
from runner import Case, Tally, try_all
from structured import structured

from coevo import chain as digests
from coevo import files, soundness
from coevo.console import duration, table
from coevo.game import prepare
from coevo.run import create_run
from coevo.run_reader import RunReader

FAMILIES = ("inputs", "structured", "damage", "reading", "links", "crashes", "kills", "races")


def _skip_digest() -> None:
    """Tables are not compared with their digests any more."""
    soundness._of_tables = lambda _run, _generations: iter(())  # noqa: SLF001


def _skip_parts() -> None:
    """Parts are not compared with their digests, wherever they are read."""
    soundness._compared = lambda _folder, name, _digest, **_: soundness.Finding(name, "sound")  # noqa: SLF001
    RunReader.part_digest = lambda _self, _generation: None  # type: ignore[method-assign]


def _skip_chain() -> None:
    """Lines of the chain need not follow from each other."""

    def read(text: str) -> digests.Chain:
        rows = [tuple(line.split(",")) for line in text.splitlines()[1:]]
        return digests.Chain([row for row in rows if len(row) == 3])

    digests.Chain.read = staticmethod(read)  # type: ignore[method-assign, assignment]


def _drop_fsync() -> None:
    """Files get their names before their contents are synced."""

    def write_whole(path: Path, data: bytes) -> None:
        partial = path.with_name(f".{path.name}.partial")
        with files.begin_file(partial) as file:
            file.write(data)
        files.end_file(partial, path)

    _replaced("write_whole", write_whole)


def _drop_rename() -> None:
    """Files are written where they stand."""

    def write_whole(path: Path, data: bytes) -> None:
        with path.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())

    _replaced("write_whole", write_whole)


def _drop_lock() -> None:
    """Nobody holds a folder."""
    _replaced("lock", lambda _path: lambda: None)


def _follow_links() -> None:
    """What is written goes where links point to."""
    _replaced("begin_file", lambda partial: partial.open("wb"))
    files.make_folder = lambda path, **_: path.mkdir(parents=True, exist_ok=True)  # type: ignore[assignment]
    _replaced("make_folder", files.make_folder)


def _unbounded() -> None:
    """Archives may declare what they like."""
    files._check_entries = lambda _entries, _most: None  # type: ignore[assignment]  # noqa: SLF001


def _replaced(name: str, function: Callable[..., object]) -> None:
    """Put a function in the place of one of ``coevo.files``, wherever it is known."""
    before = getattr(files, name)
    for module in list(sys.modules.values()):
        if getattr(module, name, None) is before:
            setattr(module, name, function)


# By name what takes the part away, the family that must notice, and of which files it damages them.
MUTATIONS: dict[str, tuple[Callable[[], None], str, str]] = {
    "skip-digest": (_skip_digest, "damage", "*.csv"),
    "skip-parts": (_skip_parts, "damage", "*.parquet"),
    "skip-chain": (_skip_chain, "damage", "digests.txt"),
    "drop-fsync": (_drop_fsync, "crashes", "*"),
    "drop-rename": (_drop_rename, "crashes", "*"),
    "drop-lock": (_drop_lock, "races", "*"),
    "follow-links": (_follow_links, "links", "*"),
    "unbounded": (_unbounded, "inputs", "*"),
}


def _cases(chosen: tuple[str, ...], scale: float, names: str, rng: random.Random, work: Path) -> Iterator[Case]:
    """Yield all cases of the chosen families; damage of files with such names only."""

    def folder(name: str) -> Path:
        (work / name).mkdir()
        return work / name

    whole, half = work / "whole", work / "half"
    create_run(whole, small())
    finish(whole)
    shutil.copytree(whole, half)
    (half / "individuals.parquet" / "part-00002.parquet").unlink()
    (half / "checkpoint.npz").unlink()
    runs = {"finished": whole, "stopped": half}
    made = []
    if "inputs" in chosen:
        made.append(settings(int(14_000 * scale), rng, folder("recipes")))
        made.append(trees(int(2_000 * scale) or 20, rng))
        made.append(archives(int(3_000 * scale) or 20, rng, folder("archives")))
    if "structured" in chosen:
        made.append(structured(int(6_000 * scale), rng, whole, folder("structured")))
    if "damage" in chosen:
        made.append(damages(int(1_500 * scale) or 20, rng, runs, whole, folder("damages"), names))
    if "reading" in chosen:
        made.append(readings(int(1_200 * scale) or 20, rng, whole, folder("readings")))
    if "links" in chosen:
        made.append(links(runs, folder("links")))
    if "crashes" in chosen:
        made.append(crashes(scale, rng, whole, folder("crashes")))
        made.append(full_disks(scale, whole, folder("disks")))
    all_of = commands(work, whole) if {"kills", "races"} & set(chosen) else []
    if "kills" in chosen:
        made.append(kills(int(600 * scale) or 4, rng, all_of, folder("kills")))
        made.append(read_only(int(60 * scale) or 1, rng, all_of, folder("read-only")))
    if "races" in chosen:
        made.append(races(int(80 * scale) or 2, rng, all_of, folder("races")))
    return chain(*made)


def _report(tallies: dict[str, Tally], seconds: float) -> bool:
    """Print the table; return whether nothing failed."""
    rows = [
        [name, str(of.tried), str(of.refused), str(len(of.failures)), f"{of.seconds:.1f}", f"{of.megabytes:.0f}"]
        for name, of in tallies.items()
    ]
    tried, failed = (sum(int(row[at]) for row in rows) for at in (1, 3))
    rows.append(["all", str(tried), str(sum(int(row[2]) for row in rows)), str(failed), "", ""])
    print(table(["attack", "tried", "refused", "failed", "longest [s]", "memory [MB]"], rows))
    for name, of in tallies.items():
        for case, wrong in of.failures[:10]:
            print(f"{name}: {case}: {wrong}")
    print(f"{tried} tried, {failed} failed, in {duration(seconds)}")
    return not failed


def main() -> None:
    """Attack, and end with 1 if anything failed."""
    parser = argparse.ArgumentParser(prog="tools/attack", description=__doc__)
    parser.add_argument("--scale", type=float, default=1.0, help="how much of it; 1 is about half an hour on two cores")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="how many cases at a time")
    parser.add_argument("--only", action="append", choices=FAMILIES, help="one family; may be repeated")
    parser.add_argument("--files", help="which files of runs are damaged, such as 'digests.txt'")
    parser.add_argument("--mutation", choices=MUTATIONS, help="take a part of the code away first: it must fail")
    given = parser.parse_args()
    chosen, names = tuple(given.only or FAMILIES), given.files or "*"
    if given.mutation:
        mutate, family, of = MUTATIONS[given.mutation]
        mutate()
        chosen, names = tuple(given.only or (family,)), given.files or of
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="coevo-attack-") as work:
        prepare(small(), lambda text: print(text, file=sys.stderr))
        cases = _cases(chosen, given.scale, names, random.Random(given.seed), Path(work))
        tallies = try_all(cases, jobs=given.jobs, batch=8, tell=lambda text: print(text, file=sys.stderr, flush=True))
    sound = _report(tallies, time.monotonic() - began)
    sys.stdout.flush()
    os._exit(0 if sound else 1)  # what is left of pymunk would be taken apart after its library


if __name__ == "__main__":
    main()
