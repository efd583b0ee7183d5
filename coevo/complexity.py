"""The controller of environmental complexity (chapter 4): when it is time for a harder world, or for another axis.

Nothing is learned and nothing is played here. Somebody else does one or the other on the level that the controller is
on, and tells what was counted; the controller says what follows from it (Fig. 4.3).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple, TypeVar

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from coevo.config import ComplexitySettings, CriterionSettings, assign, check
from coevo.errors import InputError, nearest_name

__all__ = [
    "Controller",
    "Counted",
    "Event",
    "Rule",
    "at_level",
    "check_rates",
    "check_wholes",
    "every_level",
    "rules_of",
    "value_change",
    "values_at",
]

_S = TypeVar("_S", bound=Struct)
Counted = Mapping[str, tuple[int, int]]
"""By name of a rate, how often it was achieved, and of how many: success rate = achievements / trials (4.5)."""


class Event(NamedTuple):
    """What the controller did.

    kind: ``start``, ``raised``, ``lowered``, ``axis_added`` or ``end``.
    level, dimension: from now on.
    rates: over the window that led to it; NaN where there was nothing to count, nothing at the start.
    """

    kind: Literal["start", "raised", "lowered", "axis_added", "end"]
    level: int
    dimension: int
    rates: Mapping[str, float]


class Rule(NamedTuple):
    """What to do as soon as all criteria are met."""

    do: Literal["raise", "lower"]
    criteria: Mapping[str, CriterionSettings]


# ------------------------------------------------------------------------------------------------------------- levels


def values_at(settings: ComplexitySettings, level: int) -> dict[str, Any]:
    """Return the value of each key on a level.

    Example:
        >>> from coevo.complexity import values_at
        >>> from coevo.config import ComplexitySettings, check
        >>> keys = [{"robot.max_speed_mps": [0.5, 1.0]}, {"ball.mass_kg": [0.2, 0.3, 0.4]}]
        >>> table = {"keys": keys, "raise_when": {"success": {"at_least": 0.7}}}
        >>> levels = check(ComplexitySettings, table, "mine")
        >>> levels.levels
        4
        >>> values_at(levels, 2)
        {'robot.max_speed_mps': 1.0, 'ball.mass_kg': 0.3}
    """
    found: dict[str, Any] = {}
    for table in settings.keys:
        steps = len(next(iter(table.values()))) - 1
        found |= {key: values[max(0, min(level, steps))] for key, values in table.items()}
        level -= steps
    return found


def at_level(base: _S, settings: ComplexitySettings, level: int, *, table: str = "levels") -> _S:
    """Return settings as they are on a level.

    Args:
        base: the settings that levels change.
        settings: the levels.
        level: from 0 on.
        table: where the levels stand, for messages.

    Raises:
        InputError: there is no such setting, or it refuses its value.
    """
    source = f"level {level} of {table}.keys"
    return check(type(base), assign(msgspec.to_builtins(base), values_at(settings, level), source), source)


def every_level(base: _S, settings: ComplexitySettings, *, table: str = "levels") -> list[_S]:
    """Return settings on each level, lowest first; so all are checked before anything is done.

    Raises:
        InputError: as of ``at_level``.
    """
    return [at_level(base, settings, level, table=table) for level in range(settings.levels)]


def rules_of(settings: ComplexitySettings) -> tuple[Rule, ...]:
    """Return what the settings wait for; what leads down is looked at first."""
    lower = (Rule("lower", settings.lower_when),) if settings.lower_when else ()
    return (*lower, Rule("raise", settings.raise_when))


def check_rates(settings: ComplexitySettings, known: Sequence[str], source: str) -> None:
    """Refuse criteria about rates that nobody measures.

    Raises:
        InputError: offers the nearest that is known.
    """
    for table in ("raise_when", "lower_when"):
        for name in getattr(settings, table):
            if name not in known:
                near = nearest_name(name, known)
                raise InputError(f"{source}: {table}: nobody measures a rate {name!r}.{near} Known: {', '.join(known)}")


def check_wholes(settings: ComplexitySettings, wholes: Sequence[Sequence[str]], source: str) -> None:
    """Refuse rates that are required together, but are more, or less, than a whole.

    Args:
        settings: with criteria.
        wholes: names of rates that are 1 together.
        source: where the settings stand.

    Raises:
        InputError: these can never be met.
    """
    for table in ("raise_when", "lower_when"):
        criteria: dict[str, CriterionSettings] = getattr(settings, table)
        for whole in wholes:
            given = [criteria.get(name, CriterionSettings(at_least=0.0)) for name in whole]
            low = sum(one.at_least or 0.0 for one in given)
            high = sum(1.0 if one.at_most is None else one.at_most for one in given)
            if low > 1.0 + 1e-9 or high < 1.0 - 1e-9:
                raise InputError(f"{source}.{table}: {' and '.join(whole)} are 1 together; these can never be met")


def value_change(before: NDArray[np.float64], after: NDArray[np.float64], *, relative: bool = False) -> float:
    """Return by how much the values of states have changed (4.4).

    Args:
        before, after: (states, actions) action values.
        relative: as a share of the sum of absolute values before.

    Example:
        >>> import numpy as np
        >>> from coevo.complexity import value_change
        >>> value_change(np.array([[0.0, 1.0], [2.0, 0.0]]), np.array([[0.0, 0.5], [2.0, 3.0]]))
        1.5
    """
    was = before.max(axis=-1)
    change = float(np.abs(after.max(axis=-1) - was).sum())
    if not relative:
        return change
    size = float(np.abs(was).sum())
    return change / size if size > 0.0 else (math.inf if change else 0.0)


# --------------------------------------------------------------------------------------------------------- controller


def _met(criterion: CriterionSettings, rate: float) -> bool:
    """Tell whether a rate is what it must be; NaN never is."""
    low = criterion.at_least is None or rate >= criterion.at_least
    high = criterion.at_most is None or rate <= criterion.at_most
    return not math.isnan(rate) and low and high


def _shortfall(criteria: Mapping[str, CriterionSettings], rates: Mapping[str, float]) -> float:
    """Return how far rates are from what they must be, summed; NaN is as far as can be."""
    missing = 0.0
    for name, criterion in criteria.items():
        if math.isnan(rates[name]):
            missing += 1.0
        else:
            missing += max(0.0, (criterion.at_least or 0.0) - rates[name])
            missing += max(0.0, rates[name] - (1.0 if criterion.at_most is None else criterion.at_most))
    return missing


class Controller:
    """Where complexity stands, and what moves it; see ``ComplexitySettings``.

    Args:
        settings: levels and criteria.
        rules: what moves the level, the first that is met; by default ``rules_of(settings)``.

    Example:
        >>> from coevo.complexity import Controller
        >>> from coevo.config import ComplexitySettings, check
        >>> table = {
        ...     "keys": [{"robot.max_speed_mps": [0.1, 0.2, 0.3]}],
        ...     "raise_when": {"success": {"at_least": 0.7}, "collisions": {"at_most": 0.1}},
        ...     "patience": 2, "dimension": 1, "most_dimensions": 4,
        ... }
        >>> controller = Controller(check(ComplexitySettings, table, "mine"))
        >>> for successes in (75, 40, 40, 40):  # of 100 trials each
        ...     event = controller.observe({"success": (successes, 100), "collisions": (5, 100)})
        ...     print(event and (event.kind, event.level, event.dimension))
        ('raised', 1, 1)
        None
        None
        ('axis_added', 1, 2)
    """

    def __init__(self, settings: ComplexitySettings, rules: Sequence[Rule] | None = None) -> None:
        self.settings = settings
        self._rules = rules_of(settings) if rules is None else tuple(rules)
        self._names = sorted({name for rule in self._rules for name in rule.criteria})
        self.level, self.dimension = settings.first, settings.dimension
        self.ended = False
        self._observed = 0  # in all
        self._since = 0  # observations before the level or the axes last changed
        self._window: list[list[tuple[int, int]]] = []
        self._best, self._waited = math.inf, 0
        self._periods: list[tuple[int, int, int]] = []

    @property
    def start(self) -> Event:
        """The event that everything begins with."""
        return Event("start", self.settings.first, self.settings.dimension, {})

    @property
    def weak_critical_periods(self) -> NDArray[np.int64]:
        """(periods, 3): level; observations before the period and at its end, when an axis was asked for."""
        return np.array(self._periods, np.int64).reshape(-1, 3)

    @property
    def rates(self) -> dict[str, float]:
        """The rates of the criteria over the window as far as it is filled; NaN where nothing was counted."""
        found = {}
        for column, name in enumerate(self._names):
            achieved, trials = (sum(row[column][k] for row in self._window) for k in range(2))
            found[name] = achieved / trials if trials else math.nan
        return found

    def observe(self, counted: Counted, *, change: float | None = None) -> Event | None:
        """Say what follows from what was counted on the level, None if nothing does.

        Args:
            counted: at least the rates that the criteria are about.
            change: (4.4), where somebody looks at it.

        Raises:
            LookupError: a rate is missing.
            ValueError: it has ended.
        """
        if self.ended:
            raise ValueError("the controller has ended; it takes no more observations")
        self._observed += 1
        self._window.append([counted[name] for name in self._names])
        del self._window[: -self.settings.window]
        if len(self._window) < self.settings.window:
            return None
        rates = self.rates
        for rule in self._rules:
            if all(_met(criterion, rates[name]) for name, criterion in rule.criteria.items()):
                if rule.do == "lower" and not self.level:
                    break  # as low as can be: it may stall here
                return self._move(rule.do, rates)
        if self._stalls(rates, change):
            return self._stalled(rates)
        return None

    def _move(self, do: str, rates: Mapping[str, float]) -> Event | None:
        if do == "lower":
            return self._changed("lowered", rates, level=-1)
        if self.level + 1 < self.settings.levels:
            return self._changed("raised", rates, level=1)
        return self._end(rates) if self.settings.at_the_top == "end" else None

    def _stalls(self, rates: Mapping[str, float], change: float | None) -> bool:
        raising = (rule.criteria for rule in self._rules if rule.do == "raise")
        missing = min((_shortfall(criteria, rates) for criteria in raising), default=0.0)
        if missing < self._best - self.settings.improvement:
            self._best, self._waited = missing, 0
        else:
            self._waited += 1
        converged = change is not None and change < self.settings.converged_below
        return converged or 0 < self.settings.patience <= self._waited

    def _stalled(self, rates: Mapping[str, float]) -> Event | None:
        for do in self.settings.on_stall:
            if do == "grow" and self.dimension < self.settings.most_dimensions:
                self._periods.append((self.level, self._since, self._observed))
                self.dimension += 1
                return self._changed("axis_added", rates)
            if do == "lower" and self.level > 0:
                return self._changed("lowered", rates, level=-1)
            if do == "raise" and self.level + 1 < self.settings.levels:
                return self._changed("raised", rates, level=1)
            if do == "end":
                return self._end(rates)
            if do == "stay":
                break
        return None

    def _changed(
        self, kind: Literal["raised", "lowered", "axis_added"], rates: Mapping[str, float], *, level: int = 0
    ) -> Event:
        self.level += level
        self._since, self._window = self._observed, []
        self._best, self._waited = math.inf, 0
        return Event(kind, self.level, self.dimension, rates)

    def _end(self, rates: Mapping[str, float]) -> Event:
        self.ended = True
        return Event("end", self.level, self.dimension, rates)

    # ---------------------------------------------------------------------------------------------- saved, restored

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return where it stands as named arrays, from which ``restore`` goes on as if nothing had happened."""
        numbers = [self.level, self.dimension, int(self.ended), self._observed, self._since, self._waited]
        return {
            "standing": np.array(numbers, np.int64),
            "best": np.array([self._best]),
            "window": np.array(self._window, np.int64).reshape(-1, len(self._names), 2),
            "periods": self.weak_critical_periods,
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Stand where ``arrays`` were saved.

        Raises:
            LookupError: something is missing.
            ValueError: they are of other settings.
        """
        level, dimension, ended, *rest = (int(number) for number in arrays["standing"])
        window = np.asarray(arrays["window"], np.int64)
        most = max(self.settings.dimension, self.settings.most_dimensions)
        fits = 0 <= level < self.settings.levels and self.settings.dimension <= dimension <= most
        if not fits or window.shape[1:] != (len(self._names), 2) or len(window) > self.settings.window:
            raise ValueError("what was saved of the controller is of other levels or criteria")
        self.level, self.dimension, self.ended = level, dimension, bool(ended)
        self._observed, self._since, self._waited = rest
        self._best = float(arrays["best"][0])
        self._window = [[(int(a), int(b)) for a, b in row] for row in window]
        self._periods = [(int(a), int(b), int(c)) for a, b, c in arrays["periods"]]
