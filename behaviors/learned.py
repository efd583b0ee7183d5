"""The folder of a learned skill: where a learning under way stands, then the skill, its recipe and its card."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol, TypeVar

from behaviors.curriculum import CHECKS, TABLES
from behaviors.frequencies import FREQUENCIES
from behaviors.learning import Learning
from behaviors.recipe import Recipe, recipe_digest
from coevo.config import to_toml
from coevo.console import put_off_interrupt
from coevo.errors import InputError
from coevo.files import make_folder, write_whole
from coevo.folder import SAME_COMMAND, held
from coevo.seal import seal, unseal
from coevo.skill import Skill, load_skill, read_card

__all__ = [
    "CARD_GAMES",
    "CHECKPOINT",
    "SKILL",
    "UnderWay",
    "card_of",
    "go_on",
    "go_on_while_wanted",
    "held_folder",
    "is_learned",
    "write_learned",
    "writing",
]

_Block_co = TypeVar("_Block_co", covariant=True)

CHECKPOINT, SKILL = "learning.npz", "skill.npz"
CARD_GAMES = 1000  # starts that cards are measured on
_SAVE_EVERY_S, _SAVE_SHARE = 3.0, 0.05  # seldom, and where a table is large, never for more than this share of the time


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Turn failures of writing into messages for the user."""
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot write into {folder}: {error.strerror or error}; choose another --out") from None


@contextmanager
def held_folder(folder: Path) -> Iterator[None]:
    """Make the folder of a skill, if it is not there, and keep other processes from writing into it meanwhile.

    Raises:
        InputError: another process learns there, or it cannot be written.
    """
    with writing(folder):
        make_folder(folder)
    with held(folder, then=SAME_COMMAND):
        yield


class UnderWay(Protocol[_Block_co]):
    """A learning of one robot or of several, a block of trials at a time; a block says how it went."""

    @property
    def is_finished(self) -> bool:
        """Whether all trials have been run."""

    def advance(self) -> _Block_co:
        """Run the next block of trials."""

    def save(self, path: Path) -> None:
        """Write where it stands, whole or not at all."""


def go_on(learning: UnderWay[_Block_co], checkpoint: Path, report: Callable[[_Block_co], None]) -> None:
    """Learn to the end, and write a checkpoint now and then.

    Args:
        learning: under way.
        checkpoint: the file that it is kept in.
        report: called after each block of trials with how it went, such as the share of them that succeeded.
    """
    saved, wait = time.perf_counter(), _SAVE_EVERY_S
    while not learning.is_finished:
        with put_off_interrupt():
            block = learning.advance()
        report(block)
        began = time.perf_counter()
        if began - saved >= wait:
            with writing(checkpoint.parent):
                learning.save(checkpoint)
            saved = time.perf_counter()
            wait = max(_SAVE_EVERY_S, (saved - began) / _SAVE_SHARE)
    with writing(checkpoint.parent):
        learning.save(checkpoint)  # what follows takes a while, and what is learned is not to be lost by it


def go_on_while_wanted(learning: UnderWay[Any], folder: Path, tick: Callable[[], None]) -> None:
    """Learn to the end in a study, or save and leave when it is not wanted any more.

    Args:
        learning: under way.
        folder: of what is learned; its checkpoint is kept there.
        tick: called after each block of trials; it raises when the learning is to be left.
    """
    checkpoint = folder / CHECKPOINT

    def leave_if_unwanted(_block: Any) -> None:
        try:
            tick()
        except Exception:
            with writing(folder):
                learning.save(checkpoint)
            raise

    go_on(learning, checkpoint, leave_if_unwanted)


def write_learned(
    folder: Path, learning: Learning, skill: Skill, card: dict[str, Any], recipe: Recipe | None
) -> dict[str, Any]:
    """Write a skill with its card, what its learning tells besides, and its recipe; remove the checkpoint.

    Args:
        folder: of the skill.
        learning, skill, card: that was learned.
        recipe: None to leave that as it is.

    Returns:
        The card, with digests of what the learning tells besides.
    """
    files = learning.files()
    data = seal(card, files)
    with writing(folder):
        for name in (*TABLES, CHECKS, FREQUENCIES):
            (folder / name).unlink(missing_ok=True)
        for name, content in files.items():
            write_whole(folder / name, content)
        if recipe is not None:
            write_whole(folder / "recipe.toml", to_toml(recipe).encode())
        skill.save(folder / SKILL)
        write_whole(folder / "card.json", data)
        (folder / CHECKPOINT).unlink(missing_ok=True)
    return unseal(data)


def card_of(folder: Path, recipe: Recipe) -> dict[str, Any] | None:
    """Return the card of the skill in a folder; None if that was learned otherwise than by this recipe.

    Raises:
        InputError: there is none, or it is damaged.
    """
    path = folder / SKILL
    skill, card = load_skill(path), read_card(path)
    return card if is_learned(skill, recipe) and card.get("digest") == skill.digest else None


def is_learned(skill: Skill, recipe: Recipe) -> bool:
    """Tell whether a skill was learned by this recipe."""
    return bool(skill.about.get("recipe_digest") == recipe_digest(recipe))
