"""The table of action values while it is learned.

Dense, there is a row for every state. Sparse, there is one for every state that was visited, in the order of first
visits: (B.2) begins with zeros, so a state without a row has the value that its row would have. What is learned is the
same to the last bit.

Dense costs 24 bytes a state and action (value, visits, and the best table so far); sparse costs these for visited
states only, and 4 bytes for any other. A skill with one or two objects has hundreds of states and visits most of them:
dense is right. Where the product of three or four objects has hundreds of thousands (598,600 for the shooter of the
dissertation's Table 3.2), 25,000 trials reach a small part of it: sparse.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import helper

__all__ = ["Table", "all_states", "make_table", "pack_table", "row_of", "unpack_table", "with_room"]


_BY_ROW = ("values", "visits", "fixed", "critic", "actor")


class Table(NamedTuple):
    """Action values, of all states or of those that were visited.

    values: (room, actions) float64. visits: (room, actions) int64, how often each was updated.
    fixed: (room,) bool, whether a row stays as it is, and the bank's policy acts in its state (B.2.3).
    critic: (room, channels) float64, actor: (room, actions, channels) float64, of a vector-valued reward: the values
        then are scores that follow from the actor. Without channels for Q learning.
    rows: (states,) int32, the row of each state, -1 for none yet.
    used: (1,) int64, how many rows are in use.
    """

    values: NDArray[np.float64]
    visits: NDArray[np.int64]
    fixed: NDArray[np.bool_]
    critic: NDArray[np.float64]
    actor: NDArray[np.float64]
    rows: NDArray[np.int32]
    used: NDArray[np.int64]


def make_table(states: int, actions: int, *, sparse: bool = False, channels: int = 0) -> Table:
    """Return a table of zeros, with a critic and an actor of so many channels; a sparse one has no rows yet."""
    used = 0 if sparse else states
    rows = np.full(states, -1, np.int32) if sparse else np.arange(states, dtype=np.int32)
    return _zeros(used, actions, channels)._replace(rows=rows, used=np.array([used]))


def _zeros(room: int, actions: int, channels: int) -> Table:
    """Return a table with room for so many rows, of no states."""
    visits, fixed = np.zeros((room, actions), np.int64), np.zeros(room, np.bool_)
    critic, actor = np.zeros((room, channels)), np.zeros((room, actions, channels))
    return Table(np.zeros((room, actions)), visits, fixed, critic, actor, np.zeros(0, np.int32), np.zeros(1, np.int64))


def with_room(table: Table, more: int) -> Table:
    """Return the table with room for ``more`` states that have no row yet, if there are so many."""
    states, (room, actions, channels) = len(table.rows), table.actor.shape
    needed = min(states, int(table.used[0]) + more)
    if needed <= room:
        return table
    larger = _zeros(needed, actions, channels)
    for name in _BY_ROW:
        getattr(larger, name)[:room] = getattr(table, name)
    return larger._replace(rows=table.rows, used=table.used)


def all_states(values: NDArray[np.float64], rows: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return (states, actions) values of every state, zeros where it has no row.

    Args:
        values: (room, actions), maybe of a moment when fewer states had rows.
        rows: (states,), the row of each state.
    """
    whole = np.zeros((len(rows), values.shape[1]), np.float32)
    known = (rows >= 0) & (rows < len(values))
    whole[known] = values[rows[known]]
    return whole


def pack_table(table: Table) -> dict[str, NDArray[Any]]:
    """Return the rows of a table that are in use, by name, for a file."""
    used = int(table.used[0])
    states = np.flatnonzero(table.rows >= 0)
    parts = {name: getattr(table, name)[:used] for name in _BY_ROW}
    return {**parts, "state_of_row": states[np.argsort(table.rows[states])]}


def unpack_table(parts: Mapping[str, NDArray[Any]], states: int) -> Table:
    """Return the table that was packed, for so many states."""
    used = len(parts["values"])
    rows = np.full(states, -1, np.int32)
    rows[parts["state_of_row"]] = np.arange(used)
    by_row = {name: parts[name] for name in _BY_ROW}
    return Table(**by_row, rows=rows, used=np.array([used]))


@helper
def row_of(table: Table, state: int) -> int:
    """Return the row of a state, which it gets now if it has none."""
    row = int(table.rows[state])
    if row < 0:
        row = int(table.used[0])
        table.rows[state] = row
        table.used[0] += 1
    return row
