"""The generation loop: play, score, save, breed."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coevo.config import RunSettings
from coevo.evolution.evaluation import Evaluator
from coevo.evolution.grouping import random_groups
from coevo.evolution.population import Individual, breed, codes_of, first_population, individual_of
from coevo.fitness import score
from coevo.game import Outcome
from coevo.run import COUNTS, Checkpoint, GenerationRecord, Run
from coevo.tree import FunctionSet, Program, function_set
from coevo.tree.program import measure

__all__ = ["GenerationReport", "evolve"]


@dataclass(frozen=True)
class GenerationReport:
    """How a generation went.

    generation: its number, from 0. games: how many were played in it.
    best, mean: fitness by name of robot.
    playing_seconds, other_seconds: time spent on games, and on breeding and files.
    """

    generation: int
    games: int
    best: Mapping[str, float]
    mean: Mapping[str, float]
    playing_seconds: float
    other_seconds: float


class _Population:
    """One robot's individuals as codes and programs."""

    def __init__(self, robot: int, codes: Sequence[NDArray[np.uint8]], functions: FunctionSet) -> None:
        self.robot, self.codes, self.functions = robot, codes, functions
        measured = [measure(tree, functions) for tree in codes]
        self.programs = [program for program, _ in measured]
        self.depth = np.array([depth for _, depth in measured], np.int64)

    def record(
        self, settings: RunSettings, generation: int, groups: NDArray[np.int64], outcomes: list[Outcome]
    ) -> GenerationRecord:
        """Score every individual by its group's games."""
        team = settings.players[self.robot].team
        counts = {name: np.zeros(len(self.codes), np.int64) for name in COUNTS}
        group_of = np.zeros(len(self.codes), np.int64)
        for group, outcome in enumerate(outcomes):
            individual = groups[group]
            group_of[individual] = group
            counts["goals"][individual] = outcome.goals_of(team)
            counts["lost"][individual] = outcome.goals_of(1 - team)
            counts["kicks"][individual] = outcome.kicks[:, self.robot].sum()
            counts["collisions"][individual] = outcome.collisions[:, self.robot].sum()
            counts["steps"][individual] = outcome.steps.sum()
        fitness = score(
            settings.fitness,
            counts,
            games=settings.evaluation.games,
            generation=generation,
            generations=settings.gp.generations,
        )
        nodes = np.array([len(tree) for tree in self.codes], np.int64)
        return GenerationRecord(self.robot, self.codes, group_of, fitness, counts, self.depth, nodes)


def _next_codes(
    record: GenerationRecord, settings: RunSettings, functions: FunctionSet, generation: int
) -> list[NDArray[np.uint8]]:
    parents: list[Individual] = []
    for codes, fitness, depth in zip(record.codes, record.fitness.tolist(), record.depth.tolist(), strict=True):
        parent = individual_of(codes, functions)
        parent.fitness.values = (fitness, float(depth))
        parents.append(parent)
    children = breed(parents, settings.gp, functions, seed=settings.seed, generation=generation, robot=record.robot)
    return [codes_of(child, functions) for child in children]


def _rebuild(run: Run, functions: Mapping[int, FunctionSet]) -> Checkpoint:
    """Return what comes after the last finished generation, from the individuals alone."""
    settings, generation = run.config, run.finished - 1
    if generation < 0:
        first = {
            robot: [
                codes_of(tree, functions[robot])
                for tree in first_population(settings.gp, functions[robot], seed=settings.seed, robot=robot)
            ]
            for robot in run.evolving
        }
        return Checkpoint(0, first)
    populations = {
        record.robot: _next_codes(record, settings, functions[record.robot], generation)
        for record in run.records(generation)
    }
    return Checkpoint(generation + 1, populations)


def evolve(run: Run, evaluator: Evaluator, report: Callable[[GenerationReport], None]) -> None:
    """Bring a run to its last generation, from wherever it is.

    Args:
        run: new, or interrupted at any instant.
        evaluator: plays the games.
        report: called after each generation, when it is safe on disk.
    """
    settings = run.config
    run.save_environment()
    robots = len(settings.players)
    functions = {robot: function_set(robot, robots) for robot in run.evolving}
    state = run.checkpoint() or _rebuild(run, functions)
    while state.generation < settings.gp.generations:
        began = time.perf_counter()
        generation = state.generation
        populations = [_Population(robot, codes, functions[robot]) for robot, codes in state.populations.items()]
        groups = random_groups(settings.gp.population, len(populations), seed=settings.seed, generation=generation)
        teams: list[list[Program | None]] = []
        for row in groups:
            members: list[Program | None] = [None] * robots
            for population, individual in zip(populations, row, strict=True):
                members[population.robot] = population.programs[individual]
            teams.append(members)
        playing = time.perf_counter()
        outcomes = list(evaluator.play(generation, teams))
        played = time.perf_counter()
        records = [p.record(settings, generation, groups[:, i], outcomes) for i, p in enumerate(populations)]
        following = {r.robot: r.codes for r in records}
        if generation + 1 < settings.gp.generations:
            following = {r.robot: _next_codes(r, settings, functions[r.robot], generation) for r in records}
        run.save_generation(generation, records)
        state = Checkpoint(generation + 1, following)
        run.save_checkpoint(state)
        report(
            GenerationReport(
                generation,
                games=len(outcomes) * settings.evaluation.games,
                best={f"r{r.robot}": float(r.fitness.min()) for r in records},
                mean={f"r{r.robot}": float(r.fitness.mean()) for r in records},
                playing_seconds=played - playing,
                other_seconds=time.perf_counter() - played + (playing - began),
            )
        )
