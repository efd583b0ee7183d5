"""Several runs: what to call them, and which of them differ in nothing but the seed."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from coevo.config import EvolutionSettings
from coevo.errors import InputError
from coevo.run import Run, open_run

__all__ = ["check_apart", "group_names", "open_runs", "run_names", "unfinished"]

_MOST_LETTERS = 40  # of a value in a name
_MOST_SETTINGS = 3  # that a group's name tells


def open_runs(runs: str | Path | Run | Sequence[str | Path | Run]) -> list[Run]:
    """Open run folders; runs that are open already are taken as they are.

    Raises:
        InputError: there is none, one is no run, or a folder is named twice.
    """
    given = [runs] if isinstance(runs, (str, Path, Run)) else list(runs)
    if not given:
        raise InputError("expected at least one run folder, got none; start a run with 'coevo evolve'")
    opened = [run if isinstance(run, Run) else open_run(run) for run in given]
    places = [run.path.resolve() for run in opened]
    twice = next((run.path for run, place in zip(opened, places, strict=True) if places.count(place) > 1), None)
    if twice is not None:
        raise InputError(f"{twice} is named twice; name each run once")
    return opened


def check_apart(runs: Sequence[Run]) -> None:
    """Refuse runs that are counted as several and are the same: a copy says nothing new.

    Raises:
        InputError: two have the same settings and seed.
    """
    known: dict[str, Run] = {}
    for run in runs:
        same = known.setdefault(json.dumps(msgspec.to_builtins(run.config), sort_keys=True), run)
        if same is not run:
            raise InputError(
                f"{run.path} and {same.path} have the same settings and seed, and would count as two runs: name one of"
                " them"
            )


def unfinished(runs: Iterable[Run]) -> list[str]:
    """Return a line for each run whose last champions are not those of the last generation that was asked for."""
    return [
        f"{run.path} is not finished: its last champions are those of generation {run.finished} of"
        f" {run.config.gp.generations}"
        for run in runs
        if not run.is_finished
    ]


def run_names(runs: Sequence[Run]) -> list[str]:
    """Return the names of runs: those of their folders, with folders above where names would be equal.

    Example:
        >>> from pathlib import Path
        >>> from analysis.groups import run_names
        >>> from coevo.recipes import read_experiment
        >>> from coevo.run import create_run
        >>> run_names([create_run(Path(folder), read_experiment("smoke")) for folder in ("a/x", "b/x", "b/y")])
        ['a/x', 'b/x', 'y']
    """
    parts = [run.path.resolve().parts for run in runs]
    lengths = [1] * len(runs)
    while True:
        names = ["/".join(part[-length:]) for part, length in zip(parts, lengths, strict=True)]
        same = [number for number, name in enumerate(names) if names.count(name) > 1]
        if not same:
            return names
        for number in same:
            lengths[number] += 1


def group_names(runs: Sequence[Run]) -> dict[str, str]:
    """Return the group of each run, by the run's name: runs whose settings differ in the seed alone are one group.

    A group is called by its recipe's name and the settings in which it differs from others of that name, such as
    ``three-learners fitness.kind=varying``.
    """
    settings = [_flat(run.config) for run in runs]
    keys = [json.dumps(flat, sort_keys=True) for flat in settings]
    distinct = dict(zip(keys, settings, strict=True))
    names: dict[str, str] = {}
    for key, flat in distinct.items():
        alike = [other for other in distinct.values() if other["name"] == flat["name"]]
        name = " ".join([str(flat["name"]), _differences(flat, alike)]).rstrip()
        taken = list(names.values())
        names[key] = name if name not in taken else f"{name} ({sum(one.startswith(name) for one in taken) + 1})"
    return {run: names[key] for run, key in zip(run_names(runs), keys, strict=True)}


def _differences(flat: Mapping[str, Any], alike: Sequence[Mapping[str, Any]]) -> str:
    values = {setting: {repr(one.get(setting)) for one in alike} for one in alike for setting in one}
    differ = [setting for setting, found in values.items() if len(found) > 1 and setting in flat]
    differ.sort(key=lambda setting: -len(values[setting]))  # those first that tell the most groups apart
    told = [f"{setting}={_text(flat[setting])}" for setting in differ]
    more = f" and {len(told) - _MOST_SETTINGS} more" if len(told) > _MOST_SETTINGS else ""
    return ", ".join(told[:_MOST_SETTINGS]) + more


def _text(value: Any) -> str:
    text = str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)
    return text if len(text) <= _MOST_LETTERS else f"{text[: _MOST_LETTERS - 3]}..."  # a tree, as a rule


def _flat(settings: EvolutionSettings) -> dict[str, Any]:
    """Return all settings but the seed by their dotted names."""
    return {name: value for name, value in _leaves(msgspec.to_builtins(settings), "") if name != "seed"}


def _leaves(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        pairs = [(str(key), part) for key, part in value.items()]
    elif isinstance(value, (list, tuple)) and any(isinstance(part, (Mapping, list, tuple)) for part in value):
        pairs = [(str(number), part) for number, part in enumerate(value)]
    else:
        yield name, value
        return
    for key, part in pairs:
        yield from _leaves(part, f"{name}.{key}" if name else key)
