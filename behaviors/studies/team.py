"""Several learners in a study of many runs: a folder a run, with the skill of each robot and what happened."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from behaviors.frequencies import FREQUENCIES
from behaviors.learned import CHECKPOINT, go_on_while_wanted, held_folder, writing
from behaviors.team.course import TeamCourse
from behaviors.team.recipe import TeamRecipe
from behaviors.team.scene import run_games, team_scene, unlearned
from behaviors.team.tables import measured, rates, scored
from behaviors.trials.kernels import run_trials
from coevo.compiled import is_compiled
from coevo.config import FileSettings, check, file_kind, to_toml
from coevo.errors import InputError
from coevo.files import read_text, write_whole
from coevo.recipes import recipe_names, recipe_path
from coevo.seal import seal, unseal
from coevo.seeds import SetStream
from coevo.soundness import check_summary
from coevo.study import table_bytes
from coevo.study.kinds import Cell, Headlines

__all__ = ["TEAM", "TeamRuns", "learn_team"]

TEAM = "team.json"  # what a run came to
_CHECKS = "checks.csv"


class TeamRuns:
    """Learnings of several robots; see ``coevo.study.kinds.StudyKind``."""

    headlines = (Headlines(("scored_team0", "scored_team1")),)
    measured = ("team",)

    def recipes(self) -> Mapping[str, Path]:
        """Return the recipes that can be given by name."""
        kind = file_kind(TeamRecipe)
        return {name: recipe_path(name, kind) for name in recipe_names(kind)}

    def settings(self, data: Mapping[str, Any], source: str) -> TeamRecipe:
        """Make the recipe of a learning."""
        return check(TeamRecipe, data, source)

    def check(self, _settings: FileSettings, _folders: Sequence[Path]) -> list[Path]:
        """Have nothing to try: a recipe names no other files, and starts are looked for before anything is learned."""
        return []

    def warm_up(self, settings: FileSettings, tell: Callable[[str], None]) -> None:
        """Load the machine code of trials, or compile it."""
        assert isinstance(settings, TeamRecipe)
        if not is_compiled(run_trials):
            tell("Compiling the trials for this machine, once: about 30 s ...")
        run_games(team_scene(settings, unlearned(settings)), settings, settings.seed, (SetStream.CHECKS,), 0)

    def is_whole(self, folder: Path, settings: FileSettings) -> bool:
        """Tell whether what it came to is there, which is written last."""
        assert isinstance(settings, TeamRecipe)
        learned = {name for turn in settings.turns for name in turn.learners}
        files = [TEAM, FREQUENCIES, *(f"{name}.npz" for name in learned)]
        return all((folder / name).exists() for name in files)

    def run(
        self, settings: FileSettings, folder: Path, _folders: Sequence[Path], tick: Callable[[], None]
    ) -> dict[str, Cell]:
        """Learn to the end, and measure what was learned."""
        assert isinstance(settings, TeamRecipe)
        if self.is_whole(folder, settings):
            told = _told(folder)
            if told.get("recipe_digest") == _digest(settings):
                return _row(told)
        return _row(learn_team(settings, folder, tick))


def learn_team(recipe: TeamRecipe, folder: Path, tick: Callable[[], None]) -> dict[str, Any]:
    """Let robots learn from wherever they stand in a folder, write the folder, and return what it came to.

    Args:
        recipe: robots and turns.
        folder: gets the skill of each robot (``r0.npz``), ``frequencies.csv``, ``checks.csv``, ``team.json`` and the
            recipe; until then there is a checkpoint.
        tick: called after each block of trials; it raises when the learning is to be left, which then is saved.

    Raises:
        InputError: no start was found, there is nothing to learn from, or the folder cannot be written.
    """
    with held_folder(folder):
        checkpoint = folder / CHECKPOINT
        course = _under_way(recipe, checkpoint)
        go_on_while_wanted(course, folder, tick)
        told = _summary(recipe, course)
        files = {FREQUENCIES: table_bytes(course.frequencies()), _CHECKS: table_bytes(_checks(course))}
        files |= {f"{name}.npz": skill.to_bytes() for name, skill in course.skills().items()}
        data = seal(told, files)
        with writing(folder):
            for name, content in {**files, "recipe.toml": to_toml(recipe).encode()}.items():
                write_whole(folder / name, content)
            write_whole(folder / TEAM, data)
            checkpoint.unlink(missing_ok=True)
    return unseal(data)


def _under_way(recipe: TeamRecipe, checkpoint: Path) -> TeamCourse:
    if checkpoint.exists():
        try:
            return TeamCourse.load(checkpoint, recipe, recipe.seed)
        except InputError:  # damaged, or of other machine code: a study learns again
            checkpoint.unlink()
    return TeamCourse(recipe, recipe.seed)


def _digest(recipe: TeamRecipe) -> str:
    return hashlib.sha256(msgspec.json.encode(recipe)).hexdigest()


def _checks(course: TeamCourse) -> list[dict[str, Any]]:
    """Return the rows of the checks, whose columns are of all robots."""
    columns = list(dict.fromkeys(column for row in course.checks for column in row))
    return [{column: row.get(column, "") for column in columns} for row in course.checks]


def _summary(recipe: TeamRecipe, course: TeamCourse) -> dict[str, Any]:
    teams = sorted({member.team for member in recipe.robots})
    turns = [
        {
            "turn": name,
            "trials": len(found.ends),
            "scored": {str(team): scored(found, team) for team in teams},
            "robots": {robot: rates(found, n) for n, robot in enumerate(recipe.names)},
        }
        for name, found in course.results.items()
    ]
    skills = course.skills()
    return {
        "name": recipe.name,
        "seed": recipe.seed,
        "recipe_digest": _digest(recipe),
        "states": {name: int(skill.values.shape[0]) for name, skill in skills.items()},
        "digests": {name: skill.digest for name, skill in skills.items()},
        "turns": turns,
        **({"models": course.renewed} if course.renewed else {}),
        "after": measured(recipe, course.afterwards()),
    }


def _told(folder: Path) -> dict[str, Any]:
    if any(finding.state == "damaged" for finding in check_summary(folder / TEAM)):  # learned again
        return {}
    return unseal(read_text(folder / TEAM))


def _row(told: Mapping[str, Any]) -> dict[str, Cell]:
    """Return a row of the table: greedy games after the last turn, and the goals of both sides in that turn."""
    last, after = told["turns"][-1], told["after"]
    row: dict[str, Cell] = {f"scored_team{team}": share for team, share in after["scored"].items()}
    for robot, happened in after["robots"].items():
        row |= {f"{event}_{robot}": happened[event] for event in ("goal", "pass", "giveaway", "collision")}
    row |= {f"last_turn_goals_team{team}": goals for team, goals in last["scored"].items()}
    return row
