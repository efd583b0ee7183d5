"""The generation loop: play, score, save, breed."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from coevo.evolution.champions import judge_again
from coevo.evolution.evaluation import Evaluator, Match
from coevo.evolution.grouping import Groups, groups_of, line_ups
from coevo.evolution.opponents import frozen_codes
from coevo.evolution.population import Individual, codes_of, first_population, origins_of, parents_of
from coevo.evolution.variation import breed
from coevo.fitness import Scorer
from coevo.game import Played, creations
from coevo.levels import Levels
from coevo.records import Checkpoint, GenerationRecord, Origins
from coevo.run import Run
from coevo.soundness import require_sound, restore
from coevo.tree import FunctionSet, Program, compile_program
from coevo.tree.program import measure

__all__ = ["GenerationReport", "evolve"]


@dataclass(frozen=True)
class GenerationReport:
    """How a generation went.

    generation: its number, from 0. games: how many were played in it.
    best, mean: fitness by name of role.
    playing_seconds, other_seconds: time spent on games, and on breeding and files.
    level: on which it was played, None if there are none.
    """

    generation: int
    games: int
    best: Mapping[str, float]
    mean: Mapping[str, float]
    playing_seconds: float
    other_seconds: float
    level: int | None = None


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
    population: _Population, groups: NDArray[np.int64], outcomes: Sequence[Played]
) -> dict[str, NDArray[np.int64]]:
    """Return for each terminal (population,), how often each individual chose it in the games that count for it."""
    each = np.zeros((len(groups), len(population.terminals)), np.int64)
    for index, (program, own) in enumerate(zip(population.programs, groups, strict=True)):
        leaves = program.codes < 0
        for group in own:
            np.add.at(each[index], -1 - program.codes[leaves], outcomes[group].leaf_steps[population.role][leaves])
    return dict(zip(population.terminals, each.T, strict=True))


def _record(
    population: _Population,
    name: str,
    groups: Groups,
    outcomes: Sequence[Played],
    sums: Mapping[str, NDArray[np.int64]],
    score: Callable[[Mapping[str, NDArray[np.int64]]], NDArray[np.float64]],
) -> GenerationRecord:
    """Score every individual by the games that count for it."""
    own = groups.of(population.role)
    by_round = {measure: values[own, population.role] for measure, values in sums.items()}
    counts = {measure: values.sum(axis=1) for measure, values in by_round.items()}
    times = own.shape[1]
    # As much as if all rounds had been like this one: so any fitness is on its own scale, a sum over games or not.
    rounds = [score({measure: times * values[:, r] for measure, values in by_round.items()}) for r in range(times)]
    return GenerationRecord(
        population.role,
        name,
        population.codes,
        own[:, 0],
        fitness=score(counts),
        counts=counts,
        depth=population.depth,
        nodes=np.array([len(tree) for tree in population.codes], np.int64),
        origins=population.origins,
        chosen=_chosen(population, own, outcomes),
        rounds=np.stack(rounds, axis=1) if times > 1 else None,
    )


def _next(run: Run, record: GenerationRecord, generation: int) -> list[Individual]:
    """Return the population of one role that follows its generation."""
    settings, functions = run.config, run.game.function_set(record.role)
    parents = parents_of(record.codes, record.fitness, record.depth, functions)
    return breed(
        parents,
        settings.gp,
        functions,
        seed=settings.seed,
        generation=generation,
        robot=record.role,
        table=creations(settings.gp, run.game)[record.role].table,
    )


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
            role: first_population(settings.gp, functions[role], seed=settings.seed, robot=role, creation=creation)
            for role, creation in creations(settings.gp, run.game).items()
        }
        return _checkpoint(0, first, functions)
    records = run.records(generation)
    following = {record.role: _next(run, record, generation) for record in records}
    return _checkpoint(generation + 1, following, functions)


class _Best:
    """The best of each role in each finished generation, as programs: those that may be guests."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._kept: dict[tuple[int, int], Program] = {}

    def keep(self, generation: int, records: Sequence[GenerationRecord]) -> None:
        for record in records:
            codes, functions = record.codes[record.order[0]], self._run.game.function_set(record.role)
            self._kept[record.role, generation] = compile_program(codes, functions)

    def __call__(self, role: int, generation: int) -> Program:
        if (role, generation) not in self._kept:  # it was played before the run was stopped
            self.keep(generation, self._run.records(generation))
        return self._kept[role, generation]


def _matches(
    run: Run,
    generation: int,
    groups: Groups,
    populations: Sequence[_Population],
    best: _Best,
    frozen: Mapping[int, Program],
) -> list[Match]:
    teams = line_ups(groups, {population.role: population.programs for population in populations}, best, frozen)
    return [Match(*match) for match in zip(teams, groups.seeds_of_all(run.config.seed, generation), strict=True)]


def _contemporary(groups: Groups, outcomes: Sequence[Played]) -> list[Played]:
    """Return what happened in the groups without guests; in all, where each has some."""
    alone = np.flatnonzero((groups.guests == -1).all(axis=1)).tolist()
    return [outcomes[group] for group in alone or range(len(outcomes))]


def evolve(
    run: Run,
    evaluator: Evaluator,
    report: Callable[[GenerationReport], None],
    tell: Callable[[str], None] = lambda _: None,
) -> None:
    """Bring a run to its last generation, from wherever it is, and judge its last champions again if it asks for that.

    Args:
        run: new, or interrupted at any instant. One of which something is not as it was written is refused.
        evaluator: plays the games.
        report: called after each generation, when it is safe on disk.
        tell: receives a line before what takes long after the last.

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
    require_sound(run)
    restore(run)
    functions = {role: game.function_set(role) for role in run.evolving}
    opponents = frozen_codes(settings, game)
    frozen = {role: compile_program(codes, functions[role]) for role, codes in opponents.items()}
    state = run.checkpoint() or _rebuild(run, functions)
    best = _Best(run)
    levels = Levels(settings, game, run.level_records(state.generation))
    if state.generation == 0:
        levels.try_out(run.folders)
    while state.generation < settings.gp.generations:
        began = time.perf_counter()
        generation = state.generation
        populations = [
            _Population(role, codes, state.origins[role], functions[role]) for role, codes in state.populations.items()
        ]
        groups = groups_of(settings, game.roles, generation)
        matches = _matches(run, generation, groups, populations, best, frozen)
        playing = time.perf_counter()
        outcomes = list(evaluator.play(matches, levels.settings))
        played = time.perf_counter()
        sums = _summed(outcomes, game.counts)
        records = [
            _record(of, run.evolving[of.role], groups, outcomes, sums, partial(scorer, generation=generation))
            for of in populations
        ]
        state = Checkpoint(generation + 1, state.populations, state.origins)  # the last one stays as it is
        if generation + 1 < settings.gp.generations:
            following = {r.role: _next(run, r, generation) for r in records}
            state = _checkpoint(generation + 1, following, functions)
        level = levels.observe(_contemporary(groups, outcomes))
        run.save_generation(generation, records, level)
        run.save_checkpoint(state)
        best.keep(generation, records)
        report(
            GenerationReport(
                generation,
                games=len(groups) * groups.games,
                best={r.robot: float(r.fitness.min()) for r in records},
                mean={r.robot: float(r.fitness.mean()) for r in records},
                playing_seconds=played - playing,
                other_seconds=time.perf_counter() - played + (playing - began),
                level=None if level is None else level.level,
            )
        )
    if not run.is_finished:
        judge_again(run, evaluator, tell)
