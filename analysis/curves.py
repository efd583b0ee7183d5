"""Curves over generations of any run and any game: one tidy table of it, and groups of runs side by side.

Figures 6.5, 6.6 and 6.10 to 6.13 of the dissertation are such curves: best and mean fitness, goals, lost goals, steps
of contact, collisions and steps. ``analysis.curve_chart`` draws them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.groups import open_runs, run_names
from coevo.errors import InputError, nearest_name
from coevo.measures import measures_of
from coevo.records import GenerationRecord, read_record
from coevo.run import Run
from coevo.statistics import bootstrap_interval
from coevo.tree import FunctionSet

__all__ = ["COLUMNS", "STATISTICS", "choose", "overview", "summary", "table"]

COLUMNS = ("run", "generation", "robot", "measure", "statistic", "value")
STATISTICS = ("best", "mean", "worst")
_CELL = ["generation", "robot", "measure", "statistic"]
_FAMILIES = ("use", "diversity")  # measures whose names begin so are asked for together


def table(runs: str | Path | Run | Sequence[str | Path | Run]) -> pd.DataFrame:
    """Return what was measured in each finished generation of runs, a row a number.

    Args:
        runs: run folders, or runs.

    Returns:
        Columns ``run`` (the folder's name), ``generation``, ``robot``, ``measure``, ``statistic``, ``value``. Measures:

        - ``fitness`` (smaller is better), each count of the game (summed over the games of an individual), ``depth``
          and ``nodes``: statistics ``best`` and ``worst``, that is those of the individual with the best and with the
          worst fitness, as in ``generations.csv``, and ``mean`` over the population;
        - ``use_NAME``: the share of an individual's decisions that chose the terminal NAME, with the same statistics,
          if the run has counted them; the mean is over individuals that decided at all;
        - ``diversity_trees``, the share of different trees, ``diversity_tops``, how different they are near the root,
          and, where individuals play in several groups, ``repeatability`` of fitness (``coevo.measures``): statistic
          ``mean``, as they belong to the whole population.

    Raises:
        InputError: one is no run, is named twice, or has no finished generation.

    Example:
        >>> from pathlib import Path
        >>> from analysis.curves import table
        >>> from coevo.evolution import evolve
        >>> from coevo.evolution.evaluation import Evaluator
        >>> from coevo.recipes import read_experiment
        >>> from coevo.run import create_run
        >>> small = ["gp.population=4", "gp.generations=2", "gp.tournament=2", "evaluation.games=1"]
        >>> run = create_run(Path("runs/small"), read_experiment("smoke", small))
        >>> with Evaluator(run.config, workers=1, backend="threads") as evaluator:
        ...     evolve(run, evaluator, lambda _: None)
        >>> curves = table("runs/small")
        >>> best = curves.query("robot == 'r0' and measure == 'fitness' and statistic == 'best'")
        >>> best["value"].tolist() == run.generations.query("robot == 'r0'")["fitness_best"].tolist()
        True
    """
    opened = open_runs(runs)
    frames = [_of_run(run, name) for name, run in zip(run_names(opened), opened, strict=True)]
    return pd.concat(frames, ignore_index=True)


class _Row(NamedTuple):
    generation: int
    robot: str
    measure: str
    statistic: str
    value: float


def _of_run(run: Run, name: str) -> pd.DataFrame:
    individuals = run.individuals
    if individuals.empty:
        raise InputError(f"{run.path} has no finished generation yet; go on with 'coevo resume {run.path}'")
    numbers = {robot: role for role, robot in run.evolving.items()}
    rows = []
    for key, population in individuals.groupby(["generation", "robot"], sort=False):
        generation, robot = cast("tuple[int, str]", key)
        functions = run.game.function_set(numbers[robot])
        record = read_record(numbers[robot], robot, population, run.game.counts, functions.terminals)
        rows += [_Row(generation, robot, *one) for one in _of_record(record, functions, run.config.evaluation.games)]
    frame = pd.DataFrame(rows, columns=_Row._fields)
    frame.insert(0, "run", name)
    return frame


def _of_record(record: GenerationRecord, functions: FunctionSet, games: int) -> Iterator[tuple[str, str, float]]:
    """Yield measure, statistic and value of one robot's individuals in one generation."""
    sizes = {"depth": record.depth, "nodes": record.nodes}
    best, worst = record.order[0], record.order[-1]
    for measure, values in {"fitness": record.fitness, **record.counts, **sizes, **_uses(record)}.items():
        known = values[~np.isnan(values)]
        numbers = (values[best], known.mean() if len(known) else np.nan, values[worst])
        for statistic, number in zip(STATISTICS, numbers, strict=True):
            yield measure, statistic, float(number)
    measured = measures_of(record, functions, games)  # passes are a count, which is there
    for measure in ["diversity_trees", "diversity_tops", *([] if record.rounds is None else ["repeatability"])]:
        yield measure, "mean", measured[measure]


def _uses(record: GenerationRecord) -> dict[str, NDArray[np.float64]]:
    """Return the share of each terminal in each individual's decisions, (individuals,); NaN where it made none."""
    total = np.sum(list(record.chosen.values()), axis=0)
    return {
        f"use_{name}": np.divide(steps, total, out=np.full(len(steps), np.nan), where=total > 0)
        for name, steps in record.chosen.items()
    }


def choose(curves: pd.DataFrame, measures: Sequence[str] = (), statistics: Sequence[str] = STATISTICS) -> pd.DataFrame:
    """Return the rows of some measures, in their order, and some statistics.

    Args:
        curves: of ``table``.
        measures: names; ``use`` and ``diversity`` mean all that begin so; by default all measures that every run has.
        statistics: of ``STATISTICS``.

    Raises:
        InputError: no run has such a measure, or not all runs have it, or not with such a statistic.
    """
    chosen = [one for name in measures or _shared(curves) for one in _named(name, curves)]
    found = curves[curves["measure"].isin(chosen) & curves["statistic"].isin(statistics)]
    if found.empty:
        raise InputError(f"{' and '.join(chosen)} have the statistic mean only, not {' or '.join(statistics)}")
    rank = {name: number for number, name in enumerate(dict.fromkeys(chosen))}
    order = found["measure"].map(rank).argsort(kind="stable")
    return found.iloc[order].reset_index(drop=True)


def _named(name: str, curves: pd.DataFrame) -> list[str]:
    known, shared = [str(one) for one in dict.fromkeys(curves["measure"])], _shared(curves)
    families = [family for family in _FAMILIES if any(one.startswith(f"{family}_") for one in known)]
    meant = [one for one in known if one == name or (name in families and one.startswith(f"{name}_"))]
    if not meant:
        words = [*known, *families]
        raise InputError(f"there is no measure {name!r}.{nearest_name(name, words)} Measures: {', '.join(words)}")
    lacking = next((one for one in meant if one not in shared), None)
    if lacking is not None:
        having = set(curves["run"][curves["measure"] == lacking])
        other = next(run for run in curves["run"] if run not in having)
        raise InputError(
            f"{min(having)} has the measure {lacking!r}, {other} has not; all of them have: {', '.join(shared)}"
        )
    return meant


def overview(curves: pd.DataFrame) -> list[str]:
    """Return what to look at first: fitness, what the game counts, depth and nodes, as far as all runs have them."""
    besides = ("repeatability", *(f"{family}_" for family in _FAMILIES))
    return [name for name in _shared(curves) if not name.startswith(besides)]


def _shared(curves: pd.DataFrame) -> list[str]:
    """Return the measures that all runs have, in their order."""
    runs = [set(part["measure"]) for _, part in curves.groupby("run", sort=False)]
    return [str(name) for name in dict.fromkeys(curves["measure"]) if all(name in have for have in runs)]


def summary(curves: pd.DataFrame, groups: Mapping[str, str] | None = None, estimator: str = "mean") -> pd.DataFrame:
    """Return the curves of groups of runs: an estimate over the runs of each, with its interval.

    Args:
        curves: of ``table`` or ``choose``.
        groups: the group of each run by the run's name (``analysis.groups.group_names``); by default all are one.
        estimator: of ``coevo.statistics.ESTIMATORS``.

    Returns:
        Columns ``group``, ``generation``, ``robot``, ``measure``, ``statistic``, ``value``, ``low``, ``high`` and
        ``runs``: how many runs have come so far. ``low`` and ``high`` are a 95 % interval over runs, NaN of one run.

    Example:
        >>> import pandas as pd
        >>> from analysis.curves import COLUMNS, summary
        >>> curves = pd.DataFrame([(f"seed{n}", 0, "r0", "goals", "best", 3.0 + n) for n in range(3)], columns=COLUMNS)
        >>> found = summary(curves).iloc[0]
        >>> print(f"{found['value']:.1f} [{found['low']:.1f}, {found['high']:.1f}] of {found['runs']} runs")
        4.0 [1.5, 6.5] of 3 runs
    """
    of_run = curves["run"].map(dict.fromkeys(curves["run"], "all runs") if groups is None else dict(groups))
    frames = []
    for group, part in curves.groupby(of_run, sort=False):
        wide = part.set_index([*_CELL, "run"])["value"].unstack("run")  # noqa: PD010 - nothing to aggregate
        wide = wide.loc[pd.MultiIndex.from_frame(part[_CELL].drop_duplicates())]
        frame = wide.index.to_frame(index=False)
        frame.insert(0, "group", group)
        frames.append(frame.assign(**_estimates(wide.to_numpy(np.float64), estimator)))
    return pd.concat(frames, ignore_index=True)


def _estimates(cells: NDArray[np.float64], estimator: str) -> dict[str, NDArray[np.float64] | NDArray[np.int64]]:
    """Return the columns of ``summary`` from (cells, runs), NaN where a run has no number."""
    known = ~np.isnan(cells)
    runs = known.sum(axis=1)
    found = np.full((3, len(cells)), np.nan)
    for count in np.unique(runs[runs > 0]):
        rows = runs == count
        values = cells[rows][known[rows]].reshape(-1, count).T
        found[:, rows] = bootstrap_interval(values, estimator)
    found[1:, runs < 2] = np.nan
    return {"value": found[0], "low": found[1], "high": found[2], "runs": runs}
