"""The trace file and the digest of trajectories."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from coevo.replay.files import whole_file

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from coevo.replay.recording import Recording
    from coevo.stage import Trace

__all__ = ["trace_digest", "write_trace"]

_COLUMNS = ["game", "step", "body", "x_m", "y_m", "heading_rad", "skill"]


def write_trace(path: str | Path, recording: Recording) -> None:
    """Write a row for each game, step and body as CSV: where it is and which skill it chooses there.

    Step 0 is the start. ``skill`` is empty for the ball, for a robot without a tree and in the last state.
    Numbers have all the digits that make them the same again: Python's ``float`` and pandas from 3.1 on read
    them back exactly, older pandas with ``float_precision="round_trip"``.

    Args:
        path: the file to write, whole or not at all.
        recording: the games.

    Raises:
        InputError: the file cannot be written.
    """
    bodies = np.array([*(actor.name for actor in recording.actors), "ball"])
    with whole_file(Path(path)) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(_COLUMNS) + "\n")
        for game, trace in enumerate(recording.traces):
            _rows(game, bodies, list(recording.skills), trace).to_csv(
                file, header=False, index=False, lineterminator="\n"
            )


def _rows(
    game: int, bodies: np.ndarray[tuple[int], np.dtype[np.str_]], skills: Sequence[str], trace: Trace
) -> pd.DataFrame:
    states, count, _ = trace.states.shape
    chosen = np.full((states, count), -1)
    chosen[:-1, :-1] = trace.skills
    x, y, heading = trace.states[:, :, :3].reshape(-1, 3).T
    columns = [
        np.full(states * count, game),
        np.repeat(np.arange(states), count),
        np.tile(bodies.astype(object), states),
        x,
        y,
        heading,
        np.array([*skills, ""], object)[chosen].ravel(),  # -1 is the last
    ]
    return pd.DataFrame(dict(zip(_COLUMNS, columns, strict=True)))


def trace_digest(traces: Iterable[Trace], count: int | None = None) -> str:
    """Return the SHA-256 of all trajectories, every bit of the states and the skills, as hex digits.

    Args:
        traces: of games; they need not be there at a time if ``count`` says how many they are.
        count: how many they are.
    """
    if count is None:
        traces = list(traces)
        count = len(traces)
    digest = hashlib.sha256(count.to_bytes(8, "little"))
    for trace in traces:
        digest.update(np.array(trace.states.shape + trace.skills.shape, "<i8").tobytes())
        digest.update(np.ascontiguousarray(trace.states, "<f8").tobytes())
        digest.update(np.ascontiguousarray(trace.skills, "<i1").tobytes())
    return digest.hexdigest()
