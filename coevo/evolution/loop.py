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
from coevo.evolution.population import Individual, breed, codes_of, first_population, individual_of
from coevo.fitness import Scorer
from coevo.game import Played
from coevo.records import Checkpoint, GenerationRecord
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
    """One role's individuals as codes and programs."""

    def __init__(self, role: int, codes: Sequence[NDArray[np.uint8]], functions: FunctionSet) -> None:
        self.role, self.codes = role, codes
        measured = [measure(tree, functions) for tree in codes]
        self.programs = [program for program, _ in measured]
        self.depth = np.array([depth for _, depth in measured], np.int64)


def _summed(outcomes: Sequence[Played], counts: Sequence[str]) -> dict[str, NDArray[np.int64]]:
    """Return for each count (groups, roles), summed over the games of each group."""
    return {name: np.array([played.counts[name].sum(axis=0) for played in outcomes]) for name in counts}


def _record(
    population: _Population,
    name: str,
    individual_of_group: NDArray[np.int64],
    sums: Mapping[str, NDArray[np.int64]],
    scorer: Scorer,
    generation: int,
) -> GenerationRecord:
    """Score every individual by its group's games."""
    group = np.empty_like(individual_of_group)
    group[individual_of_group] = np.arange(len(group))
    counts = {measure: values[group, population.role] for measure, values in sums.items()}
    nodes = np.array([len(tree) for tree in population.codes], np.int64)
    fitness = scorer(counts, generation)
    return GenerationRecord(population.role, name, population.codes, group, fitness, counts, population.depth, nodes)


def _next_codes(
    record: GenerationRecord, settings: EvolutionSettings, functions: FunctionSet, generation: int
) -> list[NDArray[np.uint8]]:
    parents: list[Individual] = []
    for codes, fitness, depth in zip(record.codes, record.fitness.tolist(), record.depth.tolist(), strict=True):
        parent = individual_of(codes, functions)
        parent.fitness.values = (fitness, float(depth))
        parents.append(parent)
    children = breed(parents, settings.gp, functions, seed=settings.seed, generation=generation, robot=record.role)
    return [codes_of(child, functions) for child in children]


def _rebuild(run: Run, functions: Mapping[int, FunctionSet]) -> Checkpoint:
    """Return what comes after the last finished generation, from the individuals alone."""
    settings, generation = run.config, run.finished - 1
    if generation < 0:
        first = {
            role: [
                codes_of(tree, functions[role])
                for tree in first_population(settings.gp, functions[role], seed=settings.seed, robot=role)
            ]
            for role in run.evolving
        }
        return Checkpoint(0, first)
    populations = {
        record.role: _next_codes(record, settings, functions[record.role], generation)
        for record in run.records(generation)
    }
    return Checkpoint(generation + 1, populations)


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
        populations = [_Population(role, codes, functions[role]) for role, codes in state.populations.items()]
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
            _record(population, game.roles[population.role].name, groups[:, i], sums, scorer, generation)
            for i, population in enumerate(populations)
        ]
        following = {r.role: r.codes for r in records}
        if generation + 1 < settings.gp.generations:
            following = {r.role: _next_codes(r, settings, functions[r.role], generation) for r in records}
        run.save_generation(generation, records)
        state = Checkpoint(generation + 1, following)
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
