"""The skills of a run, kept in its folder: what it plays with does not depend on what lies elsewhere.

``skills/NAME/skill.npz`` is a copy of the skill of each terminal, with its card if it has one, and ``skills/kept.json``
says by which source each was named, and its digest.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import msgspec

from coevo.config import EvolutionSettings, RunSettings
from coevo.errors import InputError
from coevo.files import MOST_ARRAYS_BYTES, MOST_TEXT_BYTES, parse_json, read_text, read_whole
from coevo.skill import load_skill, skill_path

__all__ = ["KEPT", "skill_files", "with_kept_skills"]

KEPT = "skills/kept.json"
_S = TypeVar("_S", bound=EvolutionSettings)


def skill_files(settings: EvolutionSettings, folders: Sequence[Path] = ()) -> dict[str, bytes]:
    """Return the files that a run keeps of its skills, by their names in its folder.

    Args:
        settings: the experiment; one of another game has no skills.
        folders: the first may be that of a run, which has kept them.

    Raises:
        InputError: there is no such skill, or it is damaged.
    """
    if not isinstance(settings, RunSettings):
        return {}
    files, told = {}, {}
    there = with_kept_skills(settings, folders).terminals
    for name, source in settings.terminals.items():
        path = skill_path(there[name])
        told[name] = {"source": source, "digest": load_skill(path).digest}
        try:
            files[f"skills/{name}/skill.npz"] = read_whole(path, MOST_ARRAYS_BYTES)
            card = path.with_name("card.json")
            if card.is_file():
                files[f"skills/{name}/card.json"] = read_whole(card, MOST_TEXT_BYTES)
        except OSError as error:
            raise InputError(f"cannot read the skill {path}: {error.strerror or error}") from None
    return {**files, KEPT: (json.dumps(told, indent=2) + "\n").encode()}


def with_kept_skills(settings: _S, folders: Sequence[Path]) -> _S:
    """Return settings whose skills are those that a run has kept.

    Args:
        settings: those of a run, or of another that may name other skills, which are then left as they are.
        folders: the first may be that of a run.

    Raises:
        InputError: a kept skill is not there, damaged, or not the one that was kept.
    """
    path = folders[0] / KEPT if folders else None
    if path is None or not isinstance(settings, RunSettings) or not path.is_file():
        return settings
    try:
        kept = {str(name): (str(of["source"]), str(of["digest"])) for name, of in parse_json(read_text(path)).items()}
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is damaged ({error}); run the experiment again") from None
    found = {}
    for name, source in settings.terminals.items():
        if kept.get(name, ("", ""))[0] == source:
            file = path.parent / name / "skill.npz"
            if load_skill(file).digest != kept[name][1]:
                raise InputError(f"{file} is not the skill that the run was begun with; run the experiment again")
            found[name] = str(file)
    return msgspec.structs.replace(settings, skills={**settings.skills, **found})
