"""What robots of a trial learn with, side by side for compiled code: numbers, tables, decisions, stores."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from behaviors.actor_critic.updates import Outlook
from behaviors.tabular.decisions import Decisions
from behaviors.tabular.qlearning import Learner
from behaviors.tabular.table import Table
from behaviors.trials.task import CHANNELS
from coevo.compiled import inlined
from coevo.soccer.camera import FEATURES

__all__ = [
    "Criteria",
    "Mind",
    "Minds",
    "Store",
    "decisions_of",
    "learner_of",
    "make_minds",
    "make_store",
    "outlook_of",
    "pack_store",
    "rows_in_order",
    "table_of",
    "unpack_store",
    "with_tables_of",
]


class Store(NamedTuple):
    """A ring of the latest experience of one robot: N_all rows, one a step.

    trial: (N_all,) int64 number of the trial. inputs: (N_all, 2) code of the action that led to the row's image.
    features: (N_all, objects, 11), areas: (N_all, objects), as in the robot's memory.
    written: (1,) int64, how many rows were ever written; the newest is row (written - 1) % N_all.
    """

    trial: NDArray[np.int64]
    inputs: NDArray[np.float64]
    features: NDArray[np.float64]
    areas: NDArray[np.float64]
    written: NDArray[np.int64]


def make_store(rows: int, objects: int) -> Store:
    """Make room for the latest ``rows`` steps of a robot whose memory holds so many objects."""
    features, areas = np.zeros((rows, objects, FEATURES)), np.zeros((rows, objects))
    return Store(np.zeros(rows, np.int64), np.zeros((rows, 2)), features, areas, np.zeros(1, np.int64))


def rows_in_order(store: Store) -> NDArray[np.int64]:
    """Return the rows of a store that were written, oldest first."""
    rows, written = len(store.trial), int(store.written[0])
    return np.arange(max(0, written - rows), written) % rows


def pack_store(store: Store) -> dict[str, NDArray[Any]]:
    """Return what was stored, by name, for a file: without rows that were never written."""
    rows = min(len(store.trial), int(store.written[0]))
    return {name: part if name == "written" else part[:rows] for name, part in store._asdict().items()}


def unpack_store(room: Store, parts: Mapping[str, NDArray[Any]]) -> None:
    """Put what was packed into an empty store.

    Raises:
        ValueError: there is no room for it.
    """
    for name, part in parts.items():
        getattr(room, name)[: len(part)] = part


class Criteria(NamedTuple):
    """A vector-valued reward of one robot.

    credits: (channels, CHANNELS) float64. once: (CHANNELS,) bool. discounts: (lengths, channels, channels) float64.
    tolerances: (channels,) float64. See behaviors.actor_critic.updates.
    """

    credits: NDArray[np.float64]
    once: NDArray[np.bool_]
    discounts: NDArray[np.float64]
    tolerances: NDArray[np.float64]


@dataclass
class Mind:
    """What one robot decides and learns with.

    Attributes:
        learner: numbers of learning, whose epsilon also is that of a robot that does not learn.
        table: the values that it learns; in the trials it becomes a part of what all robots share.
        store: where it keeps what it sees, if it does.
        old: skill of the bank whose policy is reused (3.10), -1 for none.
        at_random: instead of by a policy, but for as long as its actions last.
        rewards: for each of the task's channels.
        criteria: its vector-valued reward, if it has one.
    """

    learner: Learner
    table: Table
    store: Store | None = None
    old: int = -1
    at_random: bool = False
    rewards: Mapping[int, float] = field(default_factory=dict)
    criteria: Criteria | None = None


class Minds(NamedTuple):
    """The minds of R robots.

    numbers: (R, numbers of Learner) float64. rewards: (R, CHANNELS) float64. old: (R,) int64. at_random: (R,) bool.
    table: all tables, one after the other; first_row, first_state: (R + 1,) int64, where each begins.
    decisions: (R, room) each. stores: (R,) bool, who has a store. store: (R, N_all, ...) each, without rows if nobody
        has one.
    epsilon: (R,) float64, of the trial under way.
    outlook: (R, ...) each, its events those of the task.
    """

    numbers: NDArray[np.float64]
    rewards: NDArray[np.float64]
    old: NDArray[np.int64]
    at_random: NDArray[np.bool_]
    table: Table
    first_row: NDArray[np.int64]
    first_state: NDArray[np.int64]
    decisions: Decisions
    stores: NDArray[np.bool_]
    store: Store
    epsilon: NDArray[np.float64]
    outlook: Outlook


def make_minds(minds: Sequence[Mind], time_limit: int, objects: int) -> Minds:
    """Put minds side by side; their tables and stores become parts of what is returned.

    Args:
        minds: one for each robot.
        time_limit: of a trial [steps].
        objects: how many the memory of each robot holds.
    """
    robots = len(minds)
    stores = [mind.store for mind in minds]
    empty = make_store(max((len(store.trial) for store in stores if store is not None), default=0), objects)
    room: list[NDArray[Any]] = [np.stack([column] * robots) for column in empty]
    store = Store(*room)
    for n, mind in enumerate(minds):
        if mind.store is not None:
            for part, given in zip(store, mind.store, strict=True):
                part[n] = given
            mind.store = Store(*(part[n] for part in store))
    rewards = np.zeros((robots, CHANNELS))
    for n, mind in enumerate(minds):
        for channel, amount in mind.rewards.items():
            rewards[n, channel] = amount
    shape = (robots, time_limit)
    rows, actions, lengths = (np.zeros(shape, np.int64) for _ in range(3))
    table, first_row, first_state = _join_tables(minds)
    criteria = _join_criteria(minds)
    channels = criteria.credits.shape[1]
    paid, earned, scratch = np.zeros((robots, CHANNELS), np.bool_), np.zeros((*shape, channels)), (robots, 2, channels)
    return Minds(
        numbers=np.array([mind.learner for mind in minds], np.float64),
        rewards=rewards,
        old=np.array([mind.old for mind in minds], np.int64),
        at_random=np.array([mind.at_random for mind in minds]),
        table=table,
        first_row=first_row,
        first_state=first_state,
        decisions=Decisions(rows, actions, np.zeros(shape), lengths, np.zeros(robots, np.int64)),
        stores=np.array([store is not None for store in stores]),
        store=store,
        epsilon=np.zeros(robots),
        outlook=Outlook(
            *(criteria.credits, criteria.once, paid, earned, criteria.discounts, criteria.tolerances), np.zeros(scratch)
        ),
    )


def _join_criteria(minds: Sequence[Mind]) -> Criteria:
    """Return the criteria of all robots side by side, zeros for who has none."""
    blank = Criteria(np.zeros((0, CHANNELS)), np.zeros(CHANNELS, np.bool_), np.zeros((1, 0, 0)), np.zeros(0))
    known = [mind.criteria for mind in minds if mind.criteria is not None]
    if known:
        zeros: list[Any] = [np.zeros_like(part) for part in known[0]]
        blank = Criteria(*zeros)
    columns: Iterable[Any] = zip(*(mind.criteria or blank for mind in minds), strict=True)
    side_by_side: list[Any] = [np.stack(parts) for parts in columns]
    return Criteria(*side_by_side)


def with_tables_of(side_by_side: Minds, minds: Sequence[Mind]) -> Minds:
    """Return minds side by side with the tables that these have now, which become parts of what is returned."""
    table, first_row, first_state = _join_tables(minds)
    return side_by_side._replace(table=table, first_row=first_row, first_state=first_state)


def _join_tables(minds: Sequence[Mind]) -> tuple[Table, NDArray[np.int64], NDArray[np.int64]]:
    """Return all tables one after the other, and the first row and state of each; the minds get their parts."""
    tables = [mind.table for mind in minds]
    whole = Table(*(np.concatenate(columns) for columns in zip(*tables, strict=True)))
    first_row = np.cumsum([0, *(len(table.values) for table in tables)])
    first_state = np.cumsum([0, *(len(table.rows) for table in tables)])
    for n, mind in enumerate(minds):
        a, b, c, d = first_row[n], first_row[n + 1], first_state[n], first_state[n + 1]
        critic, actor = whole.critic[a:b], whole.actor[a:b]
        values, visits, fixed = whole.values[a:b], whole.visits[a:b], whole.fixed[a:b]
        mind.table = Table(values, visits, fixed, critic, actor, whole.rows[c:d], whole.used[n : n + 1])
    return whole, first_row, first_state


@inlined
def learner_of(minds: Minds, robot: int) -> Learner:
    """Return the numbers of one robot."""
    n = minds.numbers[robot]
    one_step, per_action, follows, vector, literal = n[0] != 0.0, n[1] != 0.0, n[11] != 0.0, n[13] != 0.0, n[14] != 0.0
    gamma, decay, alpha, visits, least, start, end = n[2], n[3], n[4], n[5], n[6], n[7], n[8]
    return Learner(
        one_step,
        per_action,
        gamma,
        decay,
        alpha,
        visits,
        least,
        start,
        end,
        n[9],
        n[10],
        follows,
        n[12],
        vector,
        literal,
        n[15],
        int(n[16]),
    )


@inlined
def table_of(minds: Minds, robot: int) -> Table:
    """Return the table of one robot."""
    table, a, b = minds.table, minds.first_row[robot], minds.first_row[robot + 1]
    rows, used = table.rows[minds.first_state[robot] : minds.first_state[robot + 1]], table.used[robot : robot + 1]
    critic, actor = table.critic[a:b], table.actor[a:b]
    return Table(table.values[a:b], table.visits[a:b], table.fixed[a:b], critic, actor, rows, used)


@inlined
def decisions_of(minds: Minds, robot: int) -> Decisions:
    """Return the decisions of one robot."""
    of = minds.decisions
    return Decisions(
        of.rows[robot], of.actions[robot], of.rewards[robot], of.lengths[robot], of.made[robot : robot + 1]
    )


@inlined
def outlook_of(minds: Minds, robot: int) -> Outlook:
    """Return what one robot earns, and how it looks ahead."""
    of = minds.outlook
    return Outlook(
        of.credits[robot],
        of.once[robot],
        of.paid[robot],
        of.earned[robot],
        of.discounts[robot],
        of.tolerances[robot],
        of.scratch[robot],
    )
