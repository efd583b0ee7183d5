"""Damage of all that commands read back: runs, skills, learnings, studies. It is refused, or nothing differs for it."""

from __future__ import annotations

import io
import random
import shutil
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from itertools import chain
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import click
import msgspec
from damage import every, spoil
from folders import SLOW, SMALL
from runner import Case
from structured import SET, TEAM

from behaviors.learning import Learning
from behaviors.recipe import read_recipe
from behaviors.schedule.recipe import read_schedule
from behaviors.studies.chapter3 import run_set
from behaviors.studies.team import learn_team
from behaviors.team.recipe import read_team
from coevo.cli.commands import cli
from coevo.errors import InputError
from coevo.seal import unseal
from coevo.skill import load_skill, read_card
from coevo.study import cores, open_method, read_sets, write_set
from coevo.study.folder import finished_runs
from coevo.study.task import do

__all__ = ["readings"]

_LEARN = ("learn", "search", "--trials", "1000", "--games", "50", "--json", "--quiet")
_READS = 20  # kinds of them
_STUDIES = {
    "evolution": 'kind = "study"\nrecipes = ["smoke"]\nseeds = 2\n[set]\n'
    + "".join(f'"{key}" = {value}\n' for key, _, value in (one.partition("=") for one in SMALL)),
    "skill": 'kind = "study"\nrecipes = ["search"]\nseeds = 2\n[set]\ntrials = 500\n',
}


class _Read(NamedTuple):
    """A folder, and something that reads it: what that tells of the folder may not differ, whatever was damaged."""

    kind: str
    folder: Path
    reads: Callable[[Path], object]


def command(*arguments: object) -> str:
    """Do a command in this process, and return what it prints; that it fails is a refusal.

    Raises:
        InputError: it is refused in words.
    """
    printed = io.StringIO()
    try:
        with redirect_stdout(printed), redirect_stderr(io.StringIO()):
            code = cli.main([str(one) for one in arguments], prog_name="coevo", standalone_mode=False)
    except click.ClickException as error:
        raise InputError(error.format_message()) from None
    if isinstance(code, int) and code:
        raise InputError(f"it ends with {code}")
    return printed.getvalue()


def _telling(*arguments: str) -> Callable[[Path], object]:
    """Return what does a command, with the folder in the place of "@"; its name is no part of what that prints."""

    def tell(path: Path) -> object:
        return (
            command(*(one.replace("@", str(path)) for one in arguments)).replace(str(path), "@").replace(path.name, "@")
        )

    return tell


def _page(*arguments: str) -> Callable[[Path], object]:
    """Return what does a command that writes a page, and gives the page."""

    def tell(path: Path) -> object:
        page = path.with_suffix(".html")
        command(*(one.replace("@", str(path)) for one in arguments), "--out", page)
        text = page.read_text(encoding="utf-8")
        page.unlink()
        return text.replace(str(path), "@").replace(path.name, "@")

    return tell


def _learned(path: Path) -> object:
    command(*_LEARN, "--resume", "--out", path)
    return load_skill(path / "skill.npz").digest, read_card(path / "skill.npz")  # the recipe is there to be edited


def _of_several(folder: Path) -> Iterator[_Read]:
    """Yield what robots learned together: a set of chapter 3, and turns of chapter 5."""
    schedule = read_schedule("chapter3/schedule", SET)
    files = run_set(schedule, 0)
    settings = msgspec.json.format(msgspec.json.encode(schedule)).decode()
    write_set(open_method(folder / "sets" / "schedule", settings), 0, files.pop("set.json"), files)
    yield _Read("sets of chapter 3", folder / "sets", _sets)
    name, changes = TEAM
    learn_team(read_team(name, changes), folder / "team", lambda: None)
    yield _Read("a team that is checked", folder / "team", _checked(_team))


def _sets(path: Path) -> object:
    return {
        name: [(one.summary, one.rows("trials.csv"), load_skill(one.folder / "passer.npz").digest) for one in sets]
        for name, sets in read_sets(path).items()
    }


def _team(path: Path) -> object:
    names = sorted(one.name for one in path.iterdir() if one.suffix in (".csv", ".json"))
    skills = [load_skill(one).digest for one in sorted(path.glob("*.npz"))]
    told = [unseal(data) if one.endswith(".json") else data for one in names if (data := (path / one).read_bytes())]
    return names, told, skills


def _study(source: Path) -> Callable[[Path], object]:
    def table(path: Path) -> object:
        with mock.patch.object(cores, "on_cores", lambda tasks, _workers: map(do, tasks)):
            command("study", source, "--out", path, "--quiet")
        return (path / "table.csv").read_bytes()

    return table


def _checked(reads: Callable[[Path], object]) -> Callable[[Path], object]:
    """Return what reads a folder only after `coevo check` has found it sound."""

    def tell(path: Path) -> object:
        command("check", path)
        return reads(path)

    return tell


def _carded(path: Path) -> object:
    card = read_card(path / "skill.npz")
    if not card:
        raise InputError("there is no card, which a check tells of as missing")
    return card


def _rows(path: Path) -> object:
    return [(one.name, row) for one, row in finished_runs(path)]


def _of_runs(whole: Path, folder: Path) -> Iterator[_Read]:
    run = Path(shutil.copytree(whole, folder / "run"))
    played = ("tournament", "@", "--games", "4", "--again", "2", "--workers", "1", "--json", "--quiet")
    _telling(*played)(run)
    yield _Read("tournament", run, _telling(*played))
    yield _Read("inspect", run, _telling("inspect", "@", "--json"))
    yield _Read("play", run, _telling("play", "@", "--games", "2", "--json", "--quiet"))
    yield _Read("curves", run, _telling("curves", "@", "--json"))
    yield _Read("ancestry", run, _telling("ancestry", "@", "--json"))
    yield _Read("settlements", run, _telling("settlements", "@", "--games", "4", "--workers", "1", "--json", "-q"))
    yield _Read("report", run, _page("report", "@", "--workers", "1", "--quiet"))


def _of_skills(folder: Path) -> Iterator[_Read]:
    skill = folder / "skill"
    command(*_LEARN, "--out", skill)
    file = "@/skill.npz"
    yield _Read("skills evaluate", skill, _telling("skills", "evaluate", file, "--games", "20", "--json"))
    yield _Read("skills watch", skill, _page("skills", "watch", file, "--games", "1"))
    yield _Read("learn --resume, finished", skill, _learned)
    yield _Read("a skill that is checked", skill, _checked(_carded))
    recipe = read_recipe("search")
    learning = Learning(recipe, seed=recipe.seed, trials=1000)
    learning.advance()
    learning.advance()
    (folder / "learning").mkdir()
    learning.save(folder / "learning" / "learning.npz")
    yield _Read("learn --resume, under way", folder / "learning", _learned)


def _of_studies(folder: Path) -> Iterator[_Read]:
    for kind, text in _STUDIES.items():
        source, whole, half = folder / f"{kind}.toml", folder / f"study-{kind}", folder / f"half-{kind}"
        source.write_text(text)
        _study(source)(whole)
        shutil.copytree(whole, half)
        (run,) = half.glob("*-seed1")
        (run / "study.json").unlink()
        for name in ("card.json", "skill.npz", "checkpoint.npz", "individuals.parquet/part-00002.parquet"):
            (run / name).unlink(missing_ok=True)
        yield _Read(f"study ({kind}, finished)", whole, _study(source))
        yield _Read(f"study ({kind}, under way)", half, _study(source))
        yield _Read(f"tables of a study ({kind})", whole, _rows)


def readings(count: int, rng: random.Random, whole: Path, folder: Path) -> Iterator[Case]:
    """Yield damage of a file of a folder, and a command that reads the folder: refused, or nothing differs.

    Args:
        count: how many in all.
        rng: that chooses.
        whole: a finished run.
        folder: for copies.
    """
    kinds = chain(_of_runs(whole, folder), _of_skills(folder), _of_several(folder), _of_studies(folder))
    for number, read in enumerate(kinds):
        sound = Path(shutil.copytree(read.folder, folder / f"sound-{number}"))
        expected = read.reads(sound)
        shutil.rmtree(sound)
        for _, name, way, seed in every(-(-count // _READS), rng, {read.kind: read.folder}):
            yield Case(
                f"read: {read.kind}",
                f"{name}, {way}, seed {seed}",
                lambda r=read, e=expected, n=name, w=way, s=seed: _read(r, e, n, w, random.Random(s), folder / str(s)),
                3 * SLOW,
            )


def _read(read: _Read, expected: object, name: str, way: str, rng: random.Random, copy: Path) -> str:
    shutil.copytree(read.folder, copy)
    try:
        if not spoil(copy, name, way, rng):
            return ""
        return "" if read.reads(copy) == expected else "the damage is read as if it were sound"
    finally:
        shutil.rmtree(copy)
