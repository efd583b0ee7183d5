"""Learning by trials, a block at a time: checks between the blocks, and of all tables the ones that did best are kept.

One loop serves the skill of a single robot, the periods of a schedule and the other world of periods E and F.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from behaviors.checkpoint import parts_of, with_prefix
from behaviors.settings import LearningSettings
from behaviors.tabular.decisions import most_decisions
from behaviors.tabular.table import Table, all_states, pack_table, unpack_table
from behaviors.trials.kernels import Results
from behaviors.trials.scene import Scene, no_results
from behaviors.trials.task import CHANNELS
from coevo.skill.model import MOST_STATES

__all__ = ["Check", "Practice", "Standing", "joined", "read_results"]

# Measures the tables as they are now: a score, of which more is better, and what to tell besides.
Check = Callable[[], tuple[float, Mapping[str, float]]]


@dataclass
class Standing:
    """Where a learning by trials stands.

    Attributes:
        tables: of the robots that learn, in their order.
        done: how many trials have been run.
        best: of each table the values (rows in use then, actions) that did best in the checks, none before the first.
        best_score: what they scored.
        kept_after: how many trials had been run then.
        checks: what each check found, as plain data.
        results: of the trials.
    """

    tables: list[Table]
    done: int = 0
    best: list[NDArray[np.float64]] = field(default_factory=list)
    best_score: float = -np.inf
    kept_after: int = 0
    checks: list[dict[str, Any]] = field(default_factory=list)
    results: Results = field(default_factory=lambda: no_results(0))

    def pack(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return it as plain data and arrays, for a checkpoint."""
        header = {
            "done": self.done,
            "kept_after": self.kept_after,
            "checks": self.checks,
            "states": [len(table.rows) for table in self.tables],
        }
        arrays: dict[str, NDArray[Any]] = {"best_score": np.array([self.best_score])}
        arrays |= with_prefix("results", self.results._asdict())
        for n, table in enumerate(self.tables):
            arrays |= with_prefix(f"table{n}", pack_table(table))
        return header, arrays | {f"best{n}": values for n, values in enumerate(self.best)}

    @classmethod
    def unpack(cls, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Standing:
        """Return what ``pack`` was given.

        Raises:
            LookupError, TypeError, ValueError: that is not what came.
        """
        if any(type(states) is not int or not 0 <= states <= MOST_STATES for states in header["states"]):
            raise ValueError(f"a table may have {MOST_STATES} states at most")
        tables = [unpack_table(parts_of(f"table{n}", arrays), states) for n, states in enumerate(header["states"])]
        standing = cls(
            tables,
            header["done"],
            [arrays[f"best{n}"] for n in range(len(tables)) if f"best{n}" in arrays],
            float(arrays["best_score"][0]),
            header["kept_after"],
            header["checks"],
            read_results(parts_of("results", arrays)),
        )
        standing._check()  # compiled code would not
        return standing

    def _check(self) -> None:
        told: list[Any] = [self.done, self.kept_after, self.checks]
        if [type(one) for one in told] != [int, int, list] or min(self.done, self.kept_after) < 0:
            raise ValueError("it does not tell where it stands")
        if any(type(one) is not dict for one in told[-1]):
            raise ValueError("what a check found is lost")
        if len(self.best) not in (0, len(self.tables)):
            raise ValueError("a table that was kept is lost")
        for table in self.tables:
            (room, actions), channels = table.values.shape, table.critic.shape[-1]
            shapes = ((room, actions), (room, actions), (room,), (room, channels), (room, actions, channels))
            kinds = (np.float64, np.int64, np.bool_, np.float64, np.float64)
            found = [(array.shape, array.dtype) for array in table[: len(shapes)]]
            if found != [(shape, np.dtype(kind)) for shape, kind in zip(shapes, kinds, strict=True)]:
                raise ValueError("the parts of a table do not fit each other")
            if not np.array_equal(np.sort(table.rows[table.rows >= 0]), np.arange(room)):
                raise ValueError("a row of a table is of no state, or of two")
        for values, table in zip(self.best, self.tables, strict=False):
            if values.dtype != np.float64 or values.ndim != 2 or values.shape[1] != table.values.shape[1]:
                raise ValueError("a table that was kept does not fit")


class Practice:
    """A learning by trials under way.

    Args:
        scene: where; it makes room in its tables as they need it.
        learners: numbers of its robots that learn.
        total: number of trials in all.
        run: runs the trials from number ``first`` on, ``count`` of them.
        check: measures the tables; without one, the last are kept.
        rule: when it does, and from when on the tables may be kept.
        early: check before then, too, to tell of it.
        block: number of trials between two reports of progress.
        standing: where it goes on; its tables are those of the scene.
    """

    def __init__(
        self,
        scene: Scene,
        learners: Sequence[int],
        total: int,
        run: Callable[[int, int], Results],
        *,
        check: Check | None = None,
        rule: LearningSettings | None = None,
        early: bool = False,
        block: int = 250,
        standing: Standing | None = None,
    ) -> None:
        self._scene, self._learners, self._run = scene, learners, run
        self.total = total
        self._check, self._rule, self._early, self._block = check, rule or LearningSettings(), early, block
        self.at = Standing([]) if standing is None else standing
        self._take_tables()

    def _take_tables(self) -> None:
        self.at.tables = [self._scene.minds[robot].table for robot in self._learners]

    @property
    def is_finished(self) -> bool:
        """Whether all trials have been run."""
        return self.at.done == self.total

    def go_to(self, scene: Scene) -> None:
        """Go on in another scene, with the tables of its robots."""
        self._scene = scene
        self._take_tables()

    def end(self) -> None:
        """Run no more trials: the tables are checked as they would be after the last."""
        self.total = self.at.done
        if not self.at.checks or self.at.checks[-1]["trials"] < self.at.done:
            self._check_if_due(self.at.done)

    def advance(self) -> Results:
        """Run the next block of trials, and check the tables if that is due; return how the trials went."""
        at, first = self.at, self.at.done
        count = min(self._block, self.total - first)
        bank, roles = self._scene.trial.stage.bank, self._scene.trial.stage.roles
        for robot in self._learners:
            least = int(bank.min_steps[roles.skill[robot]])
            self._scene.grow(robot, count * most_decisions(self._scene.time_limit, least))
        found = self._run(first, count)
        self._take_tables()
        at.done = first + count
        at.results = joined([at.results, found]) if first else found
        self._check_if_due(first)
        return found

    def _check_if_due(self, first: int) -> None:
        at, every = self.at, self._rule.check_every
        if self._check is None or not every:
            return
        late = at.done >= self._rule.check_from * self.total
        due = self.is_finished or at.done // every > first // every
        if not due or not (late or self._early):
            return
        score, told = self._check()
        kept = late and score >= at.best_score
        if kept:
            at.best = [table.values[: table.used[0]].copy() for table in at.tables]
            at.best_score, at.kept_after = score, at.done
        at.checks.append({"trials": at.done, **told, "kept": int(kept)})

    @property
    def kept_after(self) -> int:
        """After how many trials the tables were as those that are kept."""
        return self.at.kept_after if self.at.best else self.at.done

    def values_now(self) -> list[NDArray[np.float32]]:
        """Return (states, actions) values of each robot that learns, as they are."""
        return [all_states(table.values, table.rows) for table in self.at.tables]

    def values_kept(self) -> list[NDArray[np.float32]]:
        """Return those that did best in the checks; those of now, where nothing was checked."""
        best = self.at.best or [table.values for table in self.at.tables]
        return [all_states(values, table.rows) for values, table in zip(best, self.at.tables, strict=True)]


def read_results(parts: Mapping[str, NDArray[Any]]) -> Results:
    """Return the results of trials that a checkpoint has.

    Raises:
        TypeError, ValueError: that is not what came.
    """
    *columns, counts = found = Results(**parts)
    trials = len(columns[0])
    told = [column.shape for column in columns] + [(*counts.shape[:1], *counts.shape[2:])]
    if told != [(trials,)] * len(columns) + [(trials, CHANNELS)] or any(c.dtype != np.int64 for c in found):
        raise ValueError("results of trials are of other shapes")
    return found


def joined(found: Sequence[Results]) -> Results:
    """Return the results of trials one after the other."""
    return Results(*(np.concatenate(columns) for columns in zip(*found, strict=True)))
