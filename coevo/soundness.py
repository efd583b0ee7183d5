"""Whether a run folder is as it was written: each file against the digest that was fixed when it was written."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from coevo.environment import environment
from coevo.errors import InputError
from coevo.files import parse_json, read_text
from coevo.folder import read_lines
from coevo.levels import level_lines
from coevo.run import Run
from coevo.run_reader import AGAIN, CHAMPIONS, DIGESTS, OLDER, part_name, why_unsound
from coevo.seal import FILES, unseal
from coevo.skill import load_skill, read_card

__all__ = [
    "SUMMARIES",
    "Finding",
    "check_run",
    "check_skill",
    "check_summary",
    "differences",
    "require_as_learned",
    "require_sound",
    "restore",
]


# Of a skill, of robots that learned by turns, and of a set of chapter 3: each speaks of the files beside it.
SUMMARIES = ("card.json", "team.json", "set.json")
_LEARN = "remove this folder, and learn again by the same command"


class Finding(NamedTuple):
    """What was found of a file of a run folder.

    name: of the file. state: sound, missing (it is made anew when it is needed) or damaged. why: in words, or "".
    """

    name: str
    state: str
    why: str = ""


def check_run(run: Run) -> list[Finding]:
    """Return what is sound in a run folder and what is not: all that was written, and what was found out since."""
    return [*_of_the_run(run), *_of_results(run)]


def require_sound(run: Run) -> None:
    """Refuse a run of which something is not as it was written: it would be hidden by what comes after.

    Raises:
        InputError: says what, and what to do.
    """
    for finding in _of_the_run(run):
        if finding.state == "damaged":
            raise InputError(finding.why)


def _of_the_run(run: Run) -> Iterator[Finding]:
    try:
        chain = run.chain
    except InputError as error:
        yield Finding(DIGESTS, "damaged", str(error))
        return
    if chain is None:
        yield Finding(DIGESTS, "damaged", f"{run.path} {OLDER}")
        return
    yield Finding(DIGESTS, "sound")
    generations = sum(name.startswith("individuals.parquet/") for name in chain.digests)
    later = {part_name(number) for number in range(generations)}
    begun = [name for name in chain.digests if " " not in name and name not in later and name != CHAMPIONS]
    if "config.toml" not in begun:
        yield Finding("config.toml", "damaged", f"{run.path / DIGESTS} does not tell of config.toml; {AGAIN}")
    for name in begun:
        yield _compared(run.path, name, chain.digests[name])
    known = {run.path / name for name in later}
    for path in sorted((run.path / "individuals.parquet").glob("*.parquet")):
        if path not in known:
            yield Finding(
                f"individuals.parquet/{path.name}",
                "damaged",
                f"{path} is not of this run: {DIGESTS} does not know it; take it away",
            )
    there = [number for number in range(generations) if (run.path / part_name(number)).exists()]
    for number in range(generations):
        name = part_name(number)
        if number > max(there, default=-1):  # played again, and compared with what is known of it
            yield Finding(name, "missing")
        else:
            yield _compared(run.path, name, chain.digests[name])
    yield from _of_tables(run, run.finished)
    yield _of_checkpoint(run)
    if CHAMPIONS in chain.digests or (run.path / CHAMPIONS).exists():
        yield _compared(run.path, CHAMPIONS, chain.digests.get(CHAMPIONS, ""), may_lack=True)


def _compared(folder: Path, name: str, digest: str, *, may_lack: bool = False) -> Finding:
    if may_lack and not (folder / name).exists():
        return Finding(name, "missing")
    remedy = f"delete it; 'coevo resume {folder}' makes it anew" if may_lack else f"{AGAIN}, or put it back as it was"
    why = why_unsound(folder, name, digest, remedy)
    return Finding(name, "damaged" if why else "sound", why)


def _of_tables(run: Run, generations: int) -> Iterator[Finding]:
    try:
        names = list(run.tables)
    except InputError as error:  # of the game, which is made of skills and code that are told of already
        yield Finding("generations.csv", "damaged", str(error))
        return
    for name in names:
        if not (run.path / name).exists():
            yield Finding(name, "missing")
            continue
        try:
            run.table_lines(name)
        except InputError as error:
            yield Finding(name, "damaged", str(error))
        else:
            yield Finding(name, "sound")
    if run.config.levels is not None and generations:
        yield _of_levels(run, generations)


def _of_levels(run: Run, generations: int) -> Finding:
    path = run.path / "levels.csv"
    if not path.exists():
        return Finding(path.name, "missing")
    try:
        lines = read_lines(path)
        wanted = level_lines(run.config, run.game, run.level_records(generations))
    except (OSError, ValueError) as error:
        return Finding(path.name, "damaged", f"cannot check {path}: {error}")
    more = 0 if generations == run.config.gp.generations else 2  # a kill may have left a generation more, and the end
    if lines[: len(wanted)] == wanted and len(lines) <= len(wanted) + more:
        return Finding(path.name, "sound")
    remedy = f"delete it; 'coevo resume {run.path}' makes it anew"
    return Finding(path.name, "damaged", f"{path} is damaged: its rows are not those that were written; {remedy}")


def _of_checkpoint(run: Run) -> Finding:
    name = "checkpoint.npz"
    try:
        checkpoint = run.checkpoint()
    except InputError as error:
        return Finding(name, "damaged", str(error))
    if checkpoint is None:
        return Finding(name, "missing")
    if checkpoint.generation > run.finished:
        why = (
            f"{run.path} has lost generations that its checkpoint tells of; remove this folder and {AGAIN}, or put"
            f" {part_name(run.finished)} back"
        )
        return Finding(part_name(run.finished), "damaged", why)
    return Finding(name, "sound")


def _of_results(run: Run) -> Iterator[Finding]:
    for name in run.results:
        try:
            run.result(name)
        except InputError as error:
            yield Finding(f"results/{name}.npz", "damaged", str(error))
        else:
            yield Finding(f"results/{name}.npz", "sound")


def restore(run: Run) -> None:
    """Make tables anew that are lost, from the individuals; call it only of a run that is sound.

    Raises:
        InputError: they cannot be written.
    """
    generations = run.finished
    if not generations:
        return
    for name in run.tables:
        if not (run.path / name).exists():
            run.save_table(name, generations)
    if run.config.levels is not None and not (run.path / "levels.csv").exists():
        run.save_levels(generations)


def differences(run: Run) -> list[str]:
    """Return in words what equal bytes depend on, and is otherwise here than where the run was begun."""
    try:
        there = parse_json(run.environment)
    except ValueError:
        return []
    if not isinstance(there, dict):
        return []
    here = json.loads(json.dumps(environment(run.config, run.folders)))
    return _differences(there, here)


def _differences(there: dict[str, Any], here: dict[str, Any]) -> list[str]:
    keys = ("python", "platform", "processor", "kernels", "commit")
    found = [f"{key} {there[key]} there, {here[key]} here" for key in keys if there.get(key, here[key]) != here[key]]
    versions = there.get("versions")
    for name, version in here["versions"].items():
        was = versions.get(name, version) if isinstance(versions, dict) else version
        if was != version:
            found.append(f"{name} {was} there, {version} here")
    return found


def check_skill(folder: Path) -> list[Finding]:
    """Return what is sound in the folder of a learned skill."""
    path = folder / "skill.npz"
    try:
        skill, card = load_skill(path), read_card(path)
    except InputError as error:
        return [Finding("skill.npz", "damaged", str(error))]
    found = [Finding("skill.npz", "sound")]
    if not card:
        there = os.path.lexists(folder / "card.json")
        why = f"{folder / 'card.json'} cannot be read, or is no card; learn the skill again with 'coevo learn'"
        return [*found, Finding("card.json", "damaged", why) if there else Finding("card.json", "missing")]
    if card.get("digest") != skill.digest:
        return [*found, Finding("card.json", "damaged", f"{folder / 'card.json'} is the card of another skill")]
    return [*found, Finding("card.json", "sound"), *_beside(folder, card)]


def _beside(folder: Path, told: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield what was found of the files that a summary speaks of."""
    for name, digest in dict(told.get(FILES, {})).items():
        why = why_unsound(folder, name, digest, _LEARN) if Path(name).name == name else "it is no name of a file"
        yield Finding(name, "damaged" if why else "sound", why)


def check_summary(path: Path) -> list[Finding]:
    """Return whether a summary of what was learned is sound, and the files beside it that it speaks of."""
    try:
        told = unseal(read_text(path))
    except (OSError, ValueError) as error:
        return [Finding(path.name, "damaged", f"{path} is damaged ({error}); {_LEARN}")]
    return [Finding(path.name, "sound"), *_beside(path.parent, told)]


def require_as_learned(folder: Path) -> None:
    """Refuse a folder of what was learned in which something is not as its summaries tell.

    Raises:
        InputError: says what, and what to do.
    """
    for name in SUMMARIES:
        for finding in check_summary(folder / name) if (folder / name).exists() else ():
            if finding.state == "damaged":
                raise InputError(finding.why)
