"""Play the games of a generation, on several workers."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from typing import Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from coevo.config import RunSettings, check
from coevo.errors import InputError
from coevo.game import Arena, Outcome
from coevo.seeds import RunStream, game_seeds
from coevo.tree import Program

__all__ = ["Evaluator", "check_backend", "group_seeds"]

_JOBLIB = {"threads": "threading", "processes": "loky", "dask": "dask"}

_local = threading.local()
_with_arena: set[threading.Thread] = set()


def group_seeds(run_seed: int, generation: int, group: int, games: int) -> NDArray[np.uint64]:
    """Return the seeds of a group's games: each can be played again alone."""
    return game_seeds(run_seed, RunStream.GAMES, generation, group, count=games)


def _arena(settings: bytes) -> Arena:
    """Return this thread's arena for the settings, made once."""
    if getattr(_local, "settings", None) != settings:
        _with_arena.add(threading.current_thread())
        _local.arena = Arena(check(RunSettings, msgspec.json.decode(settings), "settings"))
        _local.settings = settings
    arena: Arena = _local.arena
    return arena


def _play(settings: bytes, generation: int, group: int, programs: Sequence[Program | None]) -> Outcome:
    arena = _arena(settings)
    seeds = group_seeds(arena.settings.seed, generation, group, arena.settings.evaluation.games)
    return arena.play(programs, seeds)


def check_backend(backend: str) -> None:
    """Refuse a backend that is unknown or not installed.

    Raises:
        InputError: with the remedy.
    """
    if backend not in _JOBLIB:
        raise InputError(f"the backend must be one of {', '.join(_JOBLIB)}, got {backend!r}")
    if backend == "dask" and find_spec("distributed") is None:
        raise InputError("the backend dask needs Dask, which is not installed: pip install 'coevo[dask]'")


class Evaluator:
    """Plays whole generations; use it as a context, so that its workers end with it.

    Args:
        settings: the experiment.
        workers: how many threads or processes; results do not depend on it.
        backend: threads (compiled games release Python's lock), processes, or a Dask cluster.
    """

    def __init__(self, settings: RunSettings, *, workers: int, backend: str) -> None:
        import joblib

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
        for thread in _with_arena - {threading.current_thread(), threading.main_thread()}:
            thread.join()
        _with_arena.clear()

    def play(self, generation: int, groups: Sequence[Sequence[Program | None]]) -> Iterator[Outcome]:
        """Yield the outcome of each group's games, in the order of the groups."""
        yield from self._parallel(
            self._task(self._settings, generation, group, programs) for group, programs in enumerate(groups)
        )
