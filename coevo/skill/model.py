"""A learned skill as data: local prediction models and a table of action values, checked on the way in and out."""

from __future__ import annotations

import hashlib
import importlib.resources
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coevo.config import RobotSettings
from coevo.errors import InputError, MissingFileError, nearest_name
from coevo.files import DamagedFileError, pack_arrays, parse_json, read_arrays, read_text, write_whole
from coevo.seal import unseal
from coevo.soccer.drive import action_set

__all__ = [
    "MOST_STATES",
    "OBJECT_KINDS",
    "ObjectModel",
    "Skill",
    "installed_skills",
    "load_skill",
    "pack_models",
    "read_card",
    "skill_description",
    "skill_path",
    "state_count",
    "unpack_models",
]

FORMAT = 1
# What a skill can look at, and how many features each has. "mate" is the robot's first team mate, "robot" whichever
# other robot looks largest.
OBJECT_KINDS = {"ball": 4, "own_goal": 11, "opponent_goal": 11, "mate": 5, "robot": 5}
INPUTS = 2
MOST_STATES = 14_000_000  # of one skill; its table is then near half a gigabyte, the most that is read
_MOST_ORDER, _MOST_ACTIONS = 32, 64
_CELLS = 3  # (3.9)
_LOST_STATES = 2  # of a file that does not say: the only number there was when the first skills were learned


def state_count(order: int, lost_states: int) -> int:
    """Return the number of discrete states of one object: three cells an element (3.9), and those for "not visible"."""
    return int(_CELLS**order) + lost_states


@dataclass(frozen=True)
class ObjectModel:
    """How one object's state is estimated from the past: x = M (p - mean), (3.3) and (A.9).

    Attributes:
        kind: what is looked at, a key of OBJECT_KINDS.
        history_length: steps of past actions and observations, l.
        memory_matrix: (order, l * (2 + features)) float64; the past is newest first, actions before observations.
        past_mean: (l * (2 + features),) float64.
        cell: half the width of the middle cell, in standard deviations; (3.9) has 1.
        lost_states: states for "not visible": 2 tell on which side it was seen last, (3.9) has 1.
    """

    kind: str
    history_length: int
    memory_matrix: NDArray[np.float64]
    past_mean: NDArray[np.float64]
    cell: float
    lost_states: int = _LOST_STATES

    @property
    def order(self) -> int:
        """Dimension of the state, n."""
        return int(self.memory_matrix.shape[0])

    @property
    def states(self) -> int:
        """Number of discrete states."""
        return state_count(self.order, self.lost_states)


@dataclass(frozen=True)
class Skill:
    """A learned behaviour.

    Attributes:
        name: shoot, pass, avoid, search, or a name of your own.
        drive: the drive it was learned with.
        objects: the models whose discrete states make up the table's rows, the last one varying fastest.
        values: (states, actions) float32 action values.
        min_steps, max_steps: how long an action lasts; in between it ends when the state changes (3.3.1).
        about: how it was learned (recipe, seed, trials), plain data.
        sparse: the file holds only the rows that are not all zeros, as most are where few states were visited.
        domain: kinds of the objects without which it has nothing to go by: while one of them is out of view the robot
            stands, and it is for the tree to choose something else. Empty: it knows what to do in every state.
    """

    name: str
    drive: str
    objects: tuple[ObjectModel, ...]
    values: NDArray[np.float32]
    min_steps: int
    max_steps: int
    about: Mapping[str, Any] = field(default_factory=dict)
    sparse: bool = False
    domain: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        states = math.prod(model.states for model in self.objects)
        if not self.objects or self.values.ndim != 2 or self.values.shape[0] != states:
            raise ValueError(f"values must have one row for each of {states} states, got shape {self.values.shape}")
        numbers = [self.values, *(part for m in self.objects for part in (m.memory_matrix, m.past_mean, m.cell))]
        if not all(np.isfinite(part).all() for part in numbers):
            raise ValueError("values and models must be finite numbers")
        for model in self.objects:
            if model.history_length < 1:
                raise ValueError(f"history_length of {model.kind} must be at least 1, got {model.history_length}")
            if model.lost_states not in (1, 2):
                raise ValueError(f"lost_states of {model.kind} must be 1 or 2, got {model.lost_states}")
            if model.kind not in OBJECT_KINDS:
                raise ValueError(f"object must be one of {', '.join(OBJECT_KINDS)}, got {model.kind!r}")
            past = model.history_length * (INPUTS + OBJECT_KINDS[model.kind])
            if model.memory_matrix.shape[1] != past or model.past_mean.shape != (past,):
                raise ValueError(
                    f"the memory matrix of {model.kind} must have {past} columns, got {model.memory_matrix.shape}"
                )
        unseen = set(self.domain) - {model.kind for model in self.objects}
        if unseen or len(set(self.domain)) < len(self.domain):
            got = ", ".join(map(repr, sorted(unseen))) or "one of them twice"
            raise ValueError(f"domain must name objects of the skill, each once, got {got}")
        if not 1 <= self.min_steps <= self.max_steps:
            raise ValueError(f"expected 1 <= min_steps <= max_steps, got {self.min_steps} and {self.max_steps}")

    @property
    def actions(self) -> int:
        """Number of actions of the drive."""
        return int(self.values.shape[1])

    @property
    def policy(self) -> NDArray[np.int8]:
        """(states,) the best action of each state, of equals the first; outside the domain the one that stands."""
        best: NDArray[np.int8] = np.argmax(self.values, axis=1).astype(np.int8)
        if self.domain:
            best[self._outside()] = action_set(RobotSettings(drive="pws" if self.drive == "pws" else "4ws")).standing
        return best

    def _outside(self) -> NDArray[np.bool_]:
        """(states,) whether an object of the domain is out of view."""
        outside = np.zeros(1, np.bool_)
        for model in self.objects:
            lost = np.zeros(model.states, np.bool_)
            lost[model.states - model.lost_states :] = model.kind in self.domain
            outside = np.logical_or.outer(outside, lost).ravel()
        return outside

    @property
    def digest(self) -> str:
        """SHA-256 of everything that decides what the skill does."""
        digest = hashlib.sha256()
        digest.update(f"{FORMAT} {self.drive} {self.min_steps} {self.max_steps}".encode())
        digest.update(np.ascontiguousarray(self.values).reshape(-1).view(np.uint8).data)
        for model in self.objects:
            digest.update(f"{model.kind} {model.history_length} {model.cell!r}".encode())
            if model.lost_states != _LOST_STATES:
                digest.update(f" {model.lost_states} lost".encode())
            digest.update(np.ascontiguousarray(model.memory_matrix).tobytes())
            digest.update(np.ascontiguousarray(model.past_mean).tobytes())
        if self.domain:
            digest.update(f"domain {' '.join(sorted(self.domain))}".encode())
        return digest.hexdigest()

    def save(self, path: Path) -> None:
        """Write the skill as npz, whole or not at all; the same skill gives the same bytes."""
        write_whole(path, self.to_bytes())

    def to_bytes(self) -> bytes:
        """Return the skill as an npz file holds it."""
        objects, models = pack_models(self.objects)
        header = {
            "format": FORMAT,
            "name": self.name,
            "drive": self.drive,
            "min_steps": self.min_steps,
            "max_steps": self.max_steps,
            "objects": objects,
            "about": dict(self.about),
            "digest": self.digest,
        }
        if self.domain:
            header["domain"] = list(self.domain)
        arrays: dict[str, NDArray[Any]] = {
            "header": np.frombuffer(json.dumps(header, sort_keys=True).encode(), np.uint8),
        }
        if self.sparse:
            rows = np.flatnonzero(self.values.any(axis=1))
            arrays["rows"], arrays["values"] = rows.astype(np.int64), self.values[rows]
        else:
            arrays["values"] = self.values
        return pack_arrays({**arrays, **models})


def pack_models(models: Sequence[ObjectModel]) -> tuple[list[dict[str, Any]], dict[str, NDArray[Any]]]:
    """Return models as plain data and arrays, for ``unpack_models``."""
    plain: list[dict[str, Any]] = []
    arrays: dict[str, NDArray[Any]] = {}
    for i, model in enumerate(models):
        plain.append(
            {"kind": model.kind, "history_length": model.history_length, "order": model.order, "cell": model.cell}
        )
        if model.lost_states != _LOST_STATES:
            plain[-1]["lost_states"] = model.lost_states
        arrays[f"memory_matrix_{i}"], arrays[f"past_mean_{i}"] = model.memory_matrix, model.past_mean
    return plain, arrays


def unpack_models(plain: Sequence[Mapping[str, Any]], arrays: Mapping[str, NDArray[Any]]) -> tuple[ObjectModel, ...]:
    """Return the models that ``pack_models`` was given.

    Raises:
        KeyError, TypeError, ValueError, OverflowError: that is not what came.
    """
    for i in range(len(plain)):
        shape = arrays[f"memory_matrix_{i}"].shape
        if len(shape) != 2 or shape[0] > _MOST_ORDER:
            raise ValueError(f"a memory matrix has {_MOST_ORDER} rows at most, got the shape {shape}")
    return tuple(
        ObjectModel(
            str(item["kind"]),
            int(item["history_length"]),
            np.asarray(arrays[f"memory_matrix_{i}"], np.float64),
            np.asarray(arrays[f"past_mean_{i}"], np.float64),
            float(item["cell"]),
            int(item.get("lost_states", _LOST_STATES)),
        )
        for i, item in enumerate(plain)
    )


def _all_rows(arrays: Mapping[str, NDArray[Any]], states: int) -> NDArray[np.float32]:
    """Return (states, actions) values, of a file that holds all rows or only some.

    Raises:
        KeyError, ValueError: the arrays are not those of a table with that many states.
    """
    values = np.asarray(arrays["values"], np.float32)
    if values.ndim == 2 and values.shape[1] > _MOST_ACTIONS:
        raise ValueError(f"a skill may have {_MOST_ACTIONS} actions at most, this one would have {values.shape[1]}")
    if "rows" not in arrays:
        return values
    rows = np.asarray(arrays["rows"], np.int64)
    if states > MOST_STATES:
        raise ValueError(f"a skill may have {MOST_STATES} states at most, this one would have {states}")
    if rows.ndim != 1 or values.ndim != 2 or len(rows) != len(values):
        raise ValueError(f"expected a row number for each row of values, got shapes {rows.shape} and {values.shape}")
    if len(rows) and (rows[0] < 0 or rows[-1] >= states or np.any(np.diff(rows) <= 0)):
        raise ValueError(f"row numbers must ascend from 0 or more to less than {states}")
    table = np.zeros((states, values.shape[1]), np.float32)
    table[rows] = values
    return table


def load_skill(source: str | Path) -> Skill:
    """Read an installed skill by name, or a skill file by path.

    Raises:
        InputError: no such skill or file, or it is damaged or of another kind.

    Example:
        >>> from coevo.skill import load_skill
        >>> skill = load_skill("shoot")
        >>> skill.drive, [model.kind for model in skill.objects], skill.values.shape
        ('pws', ['ball', 'opponent_goal'], (841, 9))
    """
    path = skill_path(source)
    damaged = f"{path} is not a skill file or is damaged ({{}}); learn it again with 'coevo learn'"
    try:
        arrays = read_arrays(path)
    except FileNotFoundError:
        raise MissingFileError(f"there is no skill file {path}") from None
    except OSError as error:
        raise InputError(f"cannot read the skill file {path}: {error.strerror or error}") from None
    except ValueError as error:  # of its name
        raise InputError(f"cannot read the skill file {str(path)!r}: {error}") from None
    except DamagedFileError as error:
        raise InputError(damaged.format(error)) from None
    try:
        header = parse_json(bytes(arrays["header"]))
        if header["format"] != FORMAT:
            raise InputError(
                f"{path} has format {header['format']}, this version reads format {FORMAT}; learn it again"
            )
        objects = unpack_models(header["objects"], arrays)
        skill = Skill(
            str(header["name"]),
            str(header["drive"]),
            objects,
            _all_rows(arrays, math.prod(model.states for model in objects)),
            int(header["min_steps"]),
            int(header["max_steps"]),
            dict(header["about"]),
            sparse="rows" in arrays,
            domain=tuple(str(kind) for kind in header.get("domain", ())),
        )
    except InputError:
        raise
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
        raise InputError(damaged.format(error)) from None
    if skill.digest != header.get("digest"):
        raise InputError(f"{path} is damaged: its contents do not match its digest; learn it again with 'coevo learn'")
    return skill


def _pretrained() -> Path:
    return Path(str(importlib.resources.files("behaviors"))) / "pretrained"


def installed_skills() -> list[str]:
    """Return the names of the skills that came with the installation.

    Example:
        >>> from coevo.skill import installed_skills
        >>> installed_skills()[:4]
        ['shoot', 'pass', 'avoid', 'search']
    """
    order = {"shoot": 0, "pass": 1, "avoid": 2, "search": 3}
    names = [folder.parent.name for folder in _pretrained().glob("*/skill.npz")]
    return sorted(names, key=lambda name: (order.get(name, 9), name))


def skill_path(source: str | Path) -> Path:
    """Return where the skill named or pointed to by ``source`` is stored."""
    text = str(source)
    if isinstance(source, Path) or text.endswith(".npz") or os.sep in text:
        path = Path(source)
        return path / "skill.npz" if path.is_dir() else path
    names = installed_skills()
    if text not in names:
        raise InputError(
            f"there is no installed skill {text!r}.{nearest_name(text, names)} Installed: {', '.join(names) or 'none'};"
            " a path of your own must end with .npz"
        )
    return _pretrained() / text / "skill.npz"


def read_card(source: str | Path) -> dict[str, Any]:
    """Return the card beside a skill: what it was measured at; empty if there is none.

    Raises:
        InputError: it is damaged.

    Example:
        >>> from coevo.skill import read_card
        >>> sorted(read_card("search")["measured"]), read_card("search")["measured"]["in-view"]["games"]
        (['in-view'], 1000)
    """
    path = skill_path(source).with_name("card.json")
    try:
        return unseal(read_text(path))
    except OSError:
        return {}
    except ValueError as error:
        raise InputError(f"{path} is damaged: {error}; learn the skill again with 'coevo learn'") from None


def skill_description(source: str | Path) -> str:
    """Return what a skill does in words that go on a sentence: of its card, else of the recipe in its file; or "".

    Example:
        >>> from coevo.skill import skill_description
        >>> skill_description("shoot")
        "drives the ball into the opponent's goal"
    """
    try:
        said = read_card(source).get("description") or load_skill(source).about.get("recipe", {}).get("description")
    except (InputError, AttributeError):  # what is wrong with it is told where it is used
        return ""
    return " ".join(said.split()) if isinstance(said, str) else ""
