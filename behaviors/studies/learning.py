"""Learning in a study of many runs: a folder as of ``coevo learn``, and what the card says of it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import UNSET

from behaviors.cards import make_card
from behaviors.coordination.relearning import shared_models
from behaviors.curriculum import check_curriculum
from behaviors.learned import (
    CARD_GAMES,
    CHECKPOINT,
    SKILL,
    card_of,
    go_on_while_wanted,
    held_folder,
    write_learned,
)
from behaviors.learning import Learning, warm_up
from behaviors.lpm import PersistentExcitationWarning
from behaviors.recipe import Recipe, named_recipes, of_seed
from behaviors.trials.kernels import run_trials
from coevo.compiled import is_compiled
from coevo.config import FileSettings, check
from coevo.errors import InputError
from coevo.seeds import StartsSeed
from coevo.skill import load_skill
from coevo.study.kinds import Cell, Headlines

__all__ = ["SkillRuns"]


class SkillRuns:
    """Learnings of skills; see ``coevo.study.kinds.StudyKind``."""

    headlines = (Headlines(("success_rate_in_view", "success_rate_anywhere")),)
    measured = ("card",)

    def recipes(self) -> Mapping[str, Path]:
        """Return the recipes that can be given by name."""
        return named_recipes()

    def settings(self, data: Mapping[str, Any], source: str) -> Recipe:
        """Make the recipe of a learning."""
        return check(Recipe, data, source)

    def check(self, settings: FileSettings, _folders: Sequence[Path]) -> list[Path]:
        """Load the skills that a recipe names, and check its curriculum."""
        assert isinstance(settings, Recipe)
        if settings.curriculum is not UNSET:
            check_curriculum(settings, settings.trials)
        named = [model.model_of for model in settings.objects] + [settings.mover.skill]
        for name in named:
            if name is not UNSET:
                load_skill(of_seed(name, settings.seed))
        if settings.coordination is not UNSET:
            shared_models(settings, settings.seed)  # loads its skills, and tells whether they fit
        return []

    def warm_up(self, settings: FileSettings, tell: Callable[[str], None]) -> None:
        """Load the machine code of trials, or compile it."""
        assert isinstance(settings, Recipe)
        if not is_compiled(run_trials):
            tell("Compiling the trials for this machine, once: about 20 s ...")
        warm_up(settings)

    def is_whole(self, folder: Path, _settings: FileSettings) -> bool:
        """Tell whether skill and card are there."""
        return (folder / SKILL).exists() and (folder / "card.json").exists()

    def run(
        self, settings: FileSettings, folder: Path, _folders: Sequence[Path], tick: Callable[[], None]
    ) -> dict[str, Cell]:
        """Learn to the end, and measure what was learned."""
        assert isinstance(settings, Recipe)
        card = card_of(folder, settings) if self.is_whole(folder, settings) else None
        return _row(_learned(settings, folder, tick) if card is None else card)


def _learned(recipe: Recipe, folder: Path, tick: Callable[[], None]) -> dict[str, Any]:
    """Learn from wherever the learning in a folder stands, write the folder, and return the card."""
    with held_folder(folder):
        return _learned_there(recipe, folder, tick)


def _learned_there(recipe: Recipe, folder: Path, tick: Callable[[], None]) -> dict[str, Any]:
    checkpoint = folder / CHECKPOINT
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PersistentExcitationWarning)  # the recipe asks for it, again and again
        learning = _under_way(recipe, checkpoint)
    go_on_while_wanted(learning, folder, tick)
    skill = learning.skill()
    card = make_card(recipe, skill, games=CARD_GAMES, seed=StartsSeed.CARDS)
    card = write_learned(folder, learning, skill, card, recipe)
    kept: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(card))  # as the file gives it back
    return kept


def _under_way(recipe: Recipe, checkpoint: Path) -> Learning:
    if checkpoint.exists():
        try:
            return Learning.load(checkpoint, recipe, seed=recipe.seed, trials=recipe.trials)
        except InputError:  # damaged, or of other machine code: a study learns again
            checkpoint.unlink()
    return Learning(recipe, seed=recipe.seed, trials=recipe.trials)


def _row(card: Mapping[str, Any]) -> dict[str, Cell]:
    row: dict[str, Cell] = {}
    for starts, told in card["measured"].items():
        for key in ("success_rate", "collision_rate", "collision_rate_chaser", "mean_kicks", "stray_goal_rate"):
            if key in told:
                row[f"{key}_{starts.replace('-', '_')}"] = told[key]
    curriculum = card.get("curriculum", {})
    told = {name: curriculum[name] for name in ("trials", "level", "dimension", "model_steps") if name in curriculum}
    if curriculum:
        told["met"] = int(curriculum["met"])
    return {**row, "states": card["states"], **told}
