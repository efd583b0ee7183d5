"""Play games on several workers: those of a generation, and those of contests."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from coevo.config import EvolutionSettings, ForeignSettings, check_experiment
from coevo.errors import InputError
from coevo.game import Game, Played, check_played, make_game
from coevo.plugins import own_failure
from coevo.seeds import RunStream, game_seeds
from coevo.tree import Program

__all__ = ["Evaluator", "Match", "check_backend", "group_seeds"]

_JOBLIB = {"threads": "threading", "processes": "loky"}

_local = threading.local()
_with_game: set[threading.Thread] = set()


class Match(NamedTuple):
    """Games between the same trees.

    programs: for each role that evolves its tree, None for the others.
    seeds: (games,) uint64, a game each.
    """

    programs: Sequence[Program | None]
    seeds: NDArray[np.uint64]


def group_seeds(run_seed: int, generation: int, group: int, games: int) -> NDArray[np.uint64]:
    """Return the seeds of a group's games: each can be played again alone."""
    return game_seeds(run_seed, RunStream.GAMES, generation, group, count=games)


def _game(settings: bytes, folders: Sequence[Path]) -> tuple[EvolutionSettings, Game]:
    """Return the settings, and this thread's game for them, made once."""
    if getattr(_local, "key", None) != (settings, folders):
        _with_game.add(threading.current_thread())
        _local.settings = check_experiment(msgspec.json.decode(settings), "settings")
        _local.game = make_game(_local.settings, folders)
        _local.key = settings, folders
    return _local.settings, _local.game


def _play(data: bytes, folders: Sequence[Path], match: Match) -> Played:
    settings, game = _game(data, folders)
    try:
        played = game.play(match.programs, match.seeds)
        check_played(game, played, match.programs, len(match.seeds))
    except InputError:
        raise
    except Exception as error:
        if not isinstance(settings, ForeignSettings):
            raise
        raise own_failure(f"the game {settings.game['kind']}", error) from None  # whatever its author did
    return played


def check_backend(backend: str) -> None:
    """Refuse a backend that is unknown.

    Raises:
        InputError: with the remedy.
    """
    if backend not in _JOBLIB:
        raise InputError(f"the backend must be one of {', '.join(_JOBLIB)}, got {backend!r}")


class Evaluator:
    """Plays many matches at a time; use it as a context, so that its workers end with it.

    Args:
        settings: the experiment.
        workers: how many threads or processes; results do not depend on it.
        backend: threads (compiled games release Python's lock) or processes.
        folders: where a game of one's own is looked for, before what is installed.
    """

    def __init__(
        self, settings: EvolutionSettings, *, workers: int, backend: str, folders: Sequence[Path] = ()
    ) -> None:
        import joblib

        self._folders = tuple(folders)
        self._settings = msgspec.json.encode(settings)
        self._task = joblib.delayed(_play)
        self._parallel = joblib.Parallel(n_jobs=workers, backend=_JOBLIB[backend], return_as="generator")

    def __enter__(self) -> Self:
        self._parallel.__enter__()
        return self

    def __exit__(self, *failure: object) -> None:
        self._parallel.__exit__(*failure)
        # joblib tells its threads to end but does not wait: one that plays on, or frees its world, while Python ends
        # would make Chipmunk abort the process.
        for thread in _with_game - {threading.current_thread(), threading.main_thread()}:
            thread.join()
        _with_game.clear()

    def play(self, matches: Iterable[Match], settings: EvolutionSettings | None = None) -> Iterator[Played]:
        """Yield what happened in each match, in their order; ``settings`` are those of the games if not its own."""
        data = self._settings if settings is None else msgspec.json.encode(settings)
        yield from self._parallel(self._task(data, self._folders, match) for match in matches)
