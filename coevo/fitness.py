"""Fitness of a role from what happened in its games; smaller is better (Uchibe 1999, 6.3.3).

Goals and lost goals are those of the robot's team, kicks the steps in which it touched the ball, collisions its
own, steps those of all games together. All may be numbers or arrays of one shape. The weights carry the names of
Table 6.2; ``t_max`` is the number of games.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from coevo.config import EvolutionSettings
from coevo.errors import InputError
from coevo.plugins import load_callable, own_failure

__all__ = ["Scorer", "fixed", "varying"]

_OF_TABLE_6_2 = ("goals", "lost", "kicks", "collisions", "steps")


def _short_of(value: ArrayLike, enough: float) -> NDArray[np.float64]:
    """h(x, y) of (6.2): how much is missing to ``enough``."""
    return np.maximum(0.0, enough - np.asarray(value, np.float64))


def fixed(
    goals: ArrayLike,
    lost: ArrayLike,
    kicks: ArrayLike,
    collisions: ArrayLike,
    steps: ArrayLike,
    *,
    alpha_g: float = 1.0,
    alpha_l: float = 0.5,
    alpha_k: float = 1e-3,
    alpha_c: float = 5e-3,
    alpha_s: float = 1e-4,
    beta: float = 4000.0,
    t_max: float = 20.0,
) -> NDArray[np.float64]:
    """Return the fixed fitness (6.1).

    Example:
        >>> from coevo.fitness import fixed
        >>> float(fixed(goals=20, lost=0, kicks=4000, collisions=0, steps=0))  # nothing is missing
        0.0
        >>> fixed(goals=[20, 15], lost=[0, 2], kicks=[4000, 4000], collisions=[0, 0], steps=[1000, 1000])
        array([0.1, 6.1])
    """
    return (
        alpha_g * _short_of(goals, t_max)
        + alpha_l * np.asarray(lost, np.float64)
        + alpha_k * _short_of(kicks, beta)
        + alpha_c * np.asarray(collisions, np.float64)
        + alpha_s * np.asarray(steps, np.float64)
    )


def varying(
    goals: ArrayLike,
    lost: ArrayLike,
    kicks: ArrayLike,
    collisions: ArrayLike,
    steps: ArrayLike,
    *,
    generation: int,
    generations: int,
    alpha_g: float = 1.0,
    alpha_l: float = 1.0,
    alpha_k: float = 1e-2,
    alpha_c: float = 1e-2,
    alpha_s: float = 1e-2,
    beta: float = 4000.0,
    t_max: float = 20.0,
) -> NDArray[np.float64]:
    """Return the varying fitness (6.3): kicks count less and less, collisions and time more and more.

    Args:
        goals, lost, kicks, collisions, steps: what happened.
        generation: g, from 0.
        generations: G, at least 1.
        alpha_g, alpha_l, alpha_k, alpha_c, alpha_s, beta, t_max: see Table 6.2.

    Example:
        >>> from coevo.fitness import varying
        >>> what = {"goals": 20, "lost": 0, "kicks": 3900, "collisions": 10, "steps": 0}
        >>> [float(varying(**what, generation=g, generations=60)) for g in (0, 60)]  # kicks count, then collisions
        [1.0, 0.1]
    """
    past = generation / generations
    return fixed(
        goals,
        lost,
        kicks,
        collisions,
        steps,
        alpha_g=alpha_g,
        alpha_l=alpha_l,
        alpha_k=(1.0 - past) * alpha_k,
        alpha_c=past * alpha_c,
        alpha_s=past * alpha_s,
        beta=beta,
        t_max=t_max,
    )


class Scorer:
    """The fitness that an experiment asks for: (6.1), (6.3), or a function of one's own, tried before any game.

    Args:
        settings: the experiment.
        counts: the names of what its game counts.
        folders: where a function of one's own is looked for, before what is installed.

    Raises:
        InputError: there is no such function, or it does not return what it should.

    Example:
        >>> import numpy as np
        >>> from coevo.fitness import Scorer
        >>> from coevo.game import SoccerGame
        >>> from coevo.recipes import read_experiment
        >>> scorer = Scorer(read_experiment("smoke", ["evaluation.games=20"]), SoccerGame.counts)
        >>> counted = {"goals": 15, "lost": 2, "kicks": 4000, "collisions": 0, "steps": 1000}
        >>> scorer({name: np.array([number]) for name, number in counted.items()}, generation=0)
        array([6.1])
    """

    def __init__(self, settings: EvolutionSettings, counts: Sequence[str], folders: Sequence[Path] = ()) -> None:
        self._settings, self._kind = settings.fitness, settings.fitness.kind
        self._games, self._generations = settings.evaluation.games, settings.gp.generations
        self._own: Callable[..., object] | None = None
        if ":" in self._kind:
            self._own = load_callable(self._kind, "fitness.kind", folders)
            self(dict.fromkeys(counts, np.ones(2, np.int64)), 0)
            return
        missing = [name for name in _OF_TABLE_6_2 if name not in counts]
        if missing:
            raise InputError(
                f"fitness.kind: {self._kind!r} needs {', '.join(_OF_TABLE_6_2)}, but this game counts"
                f" {', '.join(counts)}; give module:function of your own"
            )

    def __call__(self, measures: Mapping[str, NDArray[np.int64]], generation: int) -> NDArray[np.float64]:
        """Return (individuals,) fitness; ``measures``: by name (individuals,), summed over each one's games."""
        if self._own is not None:
            return self._ask(self._own, measures, generation)
        what = [measures[name] for name in _OF_TABLE_6_2]
        if self._kind == "fixed":
            return fixed(*what, **msgspec.structs.asdict(self._settings.fixed), t_max=float(self._games))
        weights = msgspec.structs.asdict(self._settings.varying)
        total = self._generations
        return varying(*what, generation=generation, generations=total, **weights, t_max=float(self._games))

    def _ask(
        self, own: Callable[..., object], measures: Mapping[str, NDArray[np.int64]], generation: int
    ) -> NDArray[np.float64]:
        kept = {name: values.copy() for name, values in measures.items()}  # it may do with them what it likes
        individuals = len(next(iter(measures.values())))
        try:
            given = own(kept, games=self._games, generation=generation, generations=self._generations)
            fitness = np.asarray(given, np.float64)
        except Exception as error:  # noqa: BLE001 - whatever its author did
            raise own_failure(f"fitness.kind: {self._kind}", error) from None
        if fitness.shape != (individuals,):
            raise InputError(
                f"fitness.kind: {self._kind} must return one number for each of {individuals} individuals,"
                f" got shape {fitness.shape}"
            )
        if not np.isfinite(fitness).all():
            raise InputError(f"fitness.kind: {self._kind} must return finite numbers, got {fitness.tolist()[:5]}")
        return fitness
