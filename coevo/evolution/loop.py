"""The generation loop: play, score, save, breed."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coevo.config import EvolutionSettings
from coevo.evolution.evaluation import Evaluator, Match, group_seeds
from coevo.evolution.grouping import random_groups
from coevo.evolution.population import Individual, breed, codes_of, first_population, origins_of, parents_of
from coevo.fitness import Scorer
from coevo.game import Played
from coevo.records import Checkpoint, GenerationRecord, Origins
from coevo.run import Run
from coevo.tree import FunctionSet, Program
from coevo.tree.program import measure

__all__ = ["GenerationReport", "evolve"]


@dataclass(frozen=True)
class GenerationReport:
    """How a generation went.

    generation: its number, from 0. games: how many were played in it.
    best, mean: fitness by name of role.
    playing_seconds, other_seconds: time spent on games, and on breeding and files.
    """

    generation: int
    games: int
    best: Mapping[str, float]
    mean: Mapping[str, float]
    playing_seconds: float
    other_seconds: float


class _Population:
    """One role's individuals as codes and programs, and where they came from."""

    def __init__(self, role: int, codes: Sequence[NDArray[np.uint8]], origins: Origins, functions: FunctionSet) -> None:
        self.role, self.codes, self.origins, self.terminals = role, codes, origins, functions.terminals
        measured = [measure(tree, functions) for tree in codes]
        self.programs = [program for program, _ in measured]
        self.depth = np.array([depth for _, depth in measured], np.int64)


def _summed(outcomes: Sequence[Played], counts: Sequence[str]) -> dict[str, NDArray[np.int64]]:
    """Return for each count (groups, roles), summed over the games of each group."""
    return {name: np.array([played.counts[name].sum(axis=0) for played in outcomes]) for name in counts}


def _chosen(
    population: _Population, group: NDArray[np.int64], outcomes: Sequence[Played]
) -> dict[str, NDArray[np.int64]]:
    """Return for each terminal (population,), how often each individual chose it in its group's games."""
    each = np.zeros((len(group), len(population.terminals)), np.int64)
    for index, (program, played) in enumerate(zip(population.programs, (outcomes[g] for g in group), strict=True)):
        leaves = program.codes < 0
        np.add.at(each[index], -1 - program.codes[leaves], played.leaf_steps[population.role][leaves])
    return dict(zip(population.terminals, each.T, strict=True))


def _record(
    population: _Population,
    name: str,
    individual_of_group: NDArray[np.int64],
    outcomes: Sequence[Played],
    sums: Mapping[str, NDArray[np.int64]],
    scorer: Scorer,
    generation: int,
) -> GenerationRecord:
    """Score every individual by its group's games."""
    group = np.empty_like(individual_of_group)
    group[individual_of_group] = np.arange(len(group))
    counts = {measure: values[group, population.role] for measure, values in sums.items()}
    return GenerationRecord(
        population.role,
        name,
        population.codes,
        group,
        fitness=scorer(counts, generation),
        counts=counts,
        depth=population.depth,
        nodes=np.array([len(tree) for tree in population.codes], np.int64),
        origins=population.origins,
        chosen=_chosen(population, group, outcomes),
    )


def _next(
    record: GenerationRecord, settings: EvolutionSettings, functions: FunctionSet, generation: int
) -> list[Individual]:
    parents = parents_of(record.codes, record.fitness, record.depth, functions)
    return breed(parents, settings.gp, functions, seed=settings.seed, generation=generation, robot=record.role)


def _checkpoint(
    generation: int, populations: Mapping[int, Sequence[Individual]], functions: Mapping[int, FunctionSet]
) -> Checkpoint:
    """Return what is kept of the populations of the next generation."""
    codes = {role: [codes_of(one, functions[role]) for one in members] for role, members in populations.items()}
    return Checkpoint(generation, codes, {role: origins_of(members) for role, members in populations.items()})


def _rebuild(run: Run, functions: Mapping[int, FunctionSet]) -> Checkpoint:
    """Return what comes after the last finished generation, from the individuals alone."""
    settings, generation = run.config, run.finished - 1
    if generation < 0:
        first = {
            role: first_population(settings.gp, functions[role], seed=settings.seed, robot=role)
            for role in run.evolving
        }
        return _checkpoint(0, first, functions)
    records = run.records(generation)
    following = {record.role: _next(record, settings, functions[record.role], generation) for record in records}
    return _checkpoint(generation + 1, following, functions)


def _matches(settings: EvolutionSettings, generation: int, teams: Sequence[Sequence[Program | None]]) -> list[Match]:
    games = settings.evaluation.games
    return [
        Match(programs, group_seeds(settings.seed, generation, group, games)) for group, programs in enumerate(teams)
    ]


def evolve(run: Run, evaluator: Evaluator, report: Callable[[GenerationReport], None]) -> None:
    """Bring a run to its last generation, from wherever it is.

    Args:
        run: new, or interrupted at any instant.
        evaluator: plays the games.
        report: called after each generation, when it is safe on disk.

    Example:
        >>> from pathlib import Path
        >>> from coevo.evolution import evolve
        >>> from coevo.evolution.evaluation import Evaluator, Match, group_seeds
        >>> from coevo.recipes import read_experiment
        >>> from coevo.run import create_run
        >>> small = ["gp.population=4", "gp.generations=2", "gp.tournament=2", "evaluation.games=1"]
        >>> run = create_run(Path("runs/small"), read_experiment("smoke", small))
        >>> with Evaluator(run.config, workers=1, backend="threads") as evaluator:
        ...     evolve(run, evaluator, lambda report: print(report.generation, report.games))
        0 4
        1 4
        >>> len(run.individuals)  # generations, robots, individuals
        24
    """
    settings, game = run.config, run.game
    scorer = Scorer(settings, game.counts, run.folders)
    run.save_environment()
    functions = {role: game.function_set(role) for role in run.evolving}
    state = run.checkpoint() or _rebuild(run, functions)
    while state.generation < settings.gp.generations:
        began = time.perf_counter()
        generation = state.generation
        populations = [
            _Population(role, codes, state.origins[role], functions[role]) for role, codes in state.populations.items()
        ]
        groups = random_groups(settings.gp.population, len(populations), seed=settings.seed, generation=generation)
        teams: list[list[Program | None]] = []
        for row in groups:
            members: list[Program | None] = [None] * len(game.roles)
            for population, individual in zip(populations, row, strict=True):
                members[population.role] = population.programs[individual]
            teams.append(members)
        playing = time.perf_counter()
        outcomes = list(evaluator.play(_matches(settings, generation, teams)))
        played = time.perf_counter()
        sums = _summed(outcomes, game.counts)
        records = [
            _record(population, game.roles[population.role].name, groups[:, i], outcomes, sums, scorer, generation)
            for i, population in enumerate(populations)
        ]
        state = Checkpoint(generation + 1, state.populations, state.origins)  # the last one stays as it is
        if generation + 1 < settings.gp.generations:
            following = {r.role: _next(r, settings, functions[r.role], generation) for r in records}
            state = _checkpoint(generation + 1, following, functions)
        run.save_generation(generation, records)
        run.save_checkpoint(state)
        report(
            GenerationReport(
                generation,
                games=len(outcomes) * settings.evaluation.games,
                best={r.robot: float(r.fitness.min()) for r in records},
                mean={r.robot: float(r.fitness.mean()) for r in records},
                playing_seconds=played - playing,
                other_seconds=time.perf_counter() - played + (playing - began),
            )
        )
