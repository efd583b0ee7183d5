"""Tables that grow: an object's state gets one more axis, and every new cell begins with what is known already (4.3).

A state is told by the axes of its objects, the first axis of an object varying fastest; so the cells of an axis more
come after those that are there. An object out of view has no cells: its states stay one each. No value changes, so
the greedy policy is that of before, in every state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from behaviors.tabular.table import Table
from coevo.skill.model import state_count

__all__ = ["grown_table", "grown_values", "origins"]


def origins(sizes: Sequence[tuple[int, int]], which: int) -> NDArray[np.int64]:
    """Return (new states,) the state that each state was before one object got an axis more.

    Args:
        sizes: of each object its number of axes before, and of the states for "not visible"; the last object varies
            fastest.
        which: the object that got the axis.

    Example:
        >>> from behaviors.tabular.growing import origins
        >>> origins([(1, 1)], 0).tolist()  # three cells and one lost state become nine and one
        [0, 1, 2, 0, 1, 2, 0, 1, 2, 3]
    """
    order, lost = sizes[which]
    cells, more = state_count(order, 0), state_count(1, 0)
    of_object = np.concatenate([np.tile(np.arange(cells), more), cells + np.arange(lost)])
    before = [state_count(*size) for size in sizes]
    return np.take(np.arange(math.prod(before)).reshape(before), of_object, axis=which).ravel()


def grown_table(table: Table, origin: NDArray[np.int64], *, copy: bool = True) -> Table:
    """Return a table in which each state has what its origin has (4.3); a state has a row if its origin has one.

    Args:
        table: that is outgrown.
        origin: (new states,) see ``origins``.
        copy: with False what was learned is thrown away, a control: values and visits of the rows that learn are 0.
    """
    before = table.rows[origin]
    known = before >= 0
    from_row, used = before[known], int(known.sum())
    rows = np.full(len(origin), -1, np.int32)
    rows[known] = np.arange(used)
    values, visits, fixed = table.values[from_row], table.visits[from_row], table.fixed[from_row]
    critic, actor = table.critic[from_row], table.actor[from_row]
    if not copy:
        for part in (values, visits, critic, actor):
            part[~fixed] = 0
    return Table(values, visits, fixed, critic, actor, rows, np.array([used]))


def grown_values(
    values: NDArray[np.float64], rows: NDArray[np.int32], origin: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the values that a grown table has in place of others that were kept of the same table.

    Args:
        values: (rows in use when they were kept, actions).
        rows: (states,) the row of each state before.
        origin: (new states,).
    """
    before = rows[origin]
    from_row = before[before >= 0]
    found = np.zeros((len(from_row), values.shape[1]))
    known = from_row < len(values)
    found[known] = values[from_row[known]]
    return found
