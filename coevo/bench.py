"""How fast games are on this machine, always as ratios within one run."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from coevo.compiled import start_costs
from coevo.config import EvolutionSettings, RunSettings
from coevo.evolution.evaluation import Evaluator, Match
from coevo.evolution.loop import GenerationReport, evolve
from coevo.evolution.population import random_teams
from coevo.game import Played, SoccerGame, programs_of, warm_up
from coevo.plain import PlainGame
from coevo.recipes import read_settings
from coevo.run import create_run
from coevo.seeds import RunStream, game_seeds
from coevo.soccer.drive import action_set
from coevo.soccer.physics import physics_params, replay
from coevo.soccer.world import World

__all__ = ["PRESETS", "bookkeeping", "measure"]

PRESETS = ("two-learners", "stationary-opponent", "three-learners")

_GROUP = 20  # games of one grouping
_ROUNDS = 5
_START = "from coevo.bench import _settings; from coevo.game import warm_up; warm_up(_settings(), print)"


def _settings() -> RunSettings:
    return read_settings(RunSettings, "three-learners")


def measure(games: int, plain_games: int, *, tell: Callable[[str], None]) -> dict[str, Any]:
    """Time games of the three-learners preset between random trees of the dissertation's size.

    Args:
        games: compiled games in each round.
        plain_games: games of the plain loop, which are also played compiled.
        tell: receives a line before each part.
    """
    settings = _settings()
    robots = len(settings.players)
    warm_up(settings, tell)
    game = SoccerGame(settings)
    arena = game.arena
    teams = random_teams(game, settings.gp, seed=0, teams=max(1, games // _GROUP))
    programs = [programs_of(game, team) for team in teams]
    seeds = [game_seeds(0, RunStream.BENCH, group, count=_GROUP) for group in range(len(teams))]

    tell("Timing compiled games and their physics alone ...")
    # The same games once more, for the commands that their physics is replayed with.
    traces = [[arena.trace(team, seed)[1] for seed in random] for team, random in zip(programs, seeds, strict=True)]
    commands = action_set(settings.world.robot).commands
    rolls = [(trace.states[0], commands[trace.actions]) for group in traces for trace in group]
    world, physics = World(settings.world, robots), physics_params(settings.world)
    states = np.empty((settings.game.time_limit_steps, robots + 1, 6))
    game_times, physics_times, steps = [], [], 0
    for _ in range(_ROUNDS):
        began = time.perf_counter()
        outcomes = [arena.play(team, random) for team, random in zip(programs, seeds, strict=True)]
        game_times.append(time.perf_counter() - began)
        steps = sum(int(outcome.steps.sum()) for outcome in outcomes)
        began = time.perf_counter()
        for start, order in rolls:
            replay(world.handles, physics, start, order, states)
        physics_times.append(time.perf_counter() - began)
    count = len(rolls)
    game_us = float(np.median(game_times)) / steps * 1e6
    physics_us = float(np.median(physics_times)) / steps * 1e6

    tell(f"Playing {plain_games} games in the plain loop ...")
    plain = PlainGame(settings, camera="opencv")
    plain_seconds, compiled_seconds = 0.0, 0.0
    for i in range(plain_games):
        team = i % len(teams)
        began = time.perf_counter()
        plain_outcome, _ = plain.play(teams[team], seeds[team][i])
        plain_seconds += (time.perf_counter() - began) / int(plain_outcome.steps[0])
        began = time.perf_counter()
        outcome = arena.play(programs[team], seeds[team][i : i + 1])
        compiled_seconds += (time.perf_counter() - began) / int(outcome.steps[0])

    tell("Timing one and two workers, and whole generations ...")
    two_workers, bookkeeping = _workers(settings)
    tell("Compiling the games anew, and starting from the cache ...")
    compiling, cached_start = start_costs(_START)
    return {
        "games_per_second": count / float(np.median(game_times)),
        "microseconds_per_step": game_us,
        "pure_physics_microseconds_per_step": physics_us,
        "ratio_to_pure_physics": float(np.median(np.array(game_times) / np.array(physics_times))),
        "plain_loop_games_per_second": plain_games / (plain_seconds * steps / count),
        "speedup_over_plain_loop": plain_seconds / compiled_seconds,
        "two_workers_speedup": two_workers,
        "bookkeeping_share": bookkeeping,
        "compiling_cpu_seconds": compiling,
        "cached_start_seconds": cached_start,
        "mean_steps": steps / count,
        "games": count,
        "plain_games": plain_games,
    }


def _workers(settings: RunSettings) -> tuple[float, float]:
    """Return how much faster two threads are than one, and the share of a generation that is not games."""
    gp = msgspec.structs.replace(settings.gp, generations=2)
    settings = msgspec.structs.replace(settings, gp=gp)
    seconds: dict[int, list[float]] = {1: [], 2: []}
    shares: list[float] = []
    for workers in (1, 2, 1, 2):
        with tempfile.TemporaryDirectory() as folder:
            run = create_run(Path(folder) / "run", settings)
            with Evaluator(settings, workers=workers, backend="threads") as evaluator:

                def report(of: Any, workers: int = workers) -> None:
                    seconds[workers].append(of.playing_seconds)
                    if workers == 2:
                        shares.append(of.other_seconds / (of.playing_seconds + of.other_seconds))

                evolve(run, evaluator, report)
    # The first generation breeds and the last does not: take those that breed.
    return float(np.median(np.array(seconds[1]) / np.array(seconds[2]))), float(np.median(shares[0::2]))


class _EnoughError(Exception):
    """What was to be measured is measured."""


class _Timed(Evaluator):
    """Plays in this process alone, and counts the CPU seconds of it."""

    def __init__(self, settings: EvolutionSettings) -> None:
        super().__init__(settings, workers=1, backend="threads")
        self.cpu_seconds = 0.0

    def play(self, matches: Iterable[Match], settings: EvolutionSettings | None = None) -> Iterator[Played]:
        """Yield what happened in each match, when all are played."""
        began = time.process_time()
        outcomes = list(super().play(matches, settings))
        self.cpu_seconds += time.process_time() - began
        yield from outcomes


def bookkeeping(presets: Sequence[str], generations: int, changes: Sequence[str] = ()) -> dict[str, dict[str, float]]:
    """Measure what of a generation is not games, by preset: breeding, scoring, files.

    CPU time of one process is compared with CPU time of the same, so that it matters little what else the machine does.

    Args:
        presets: names of recipes of soccer.
        generations: how many of each, from the second on: the first loads libraries.
        changes: settings to replace.

    Returns:
        For each preset CPU seconds of a generation's games and of the rest, the share of the rest with one worker and
        with two, who play twice as fast at best, and the seconds that the rest took on the clock, the disk included.
    """
    return {name: _bookkeeping(read_settings(RunSettings, name, changes), generations) for name in presets}


def _bookkeeping(settings: RunSettings, generations: int) -> dict[str, float]:
    warm_up(settings, lambda _: None)
    told: list[
        tuple[float, float, float]
    ] = []  # after each generation: CPU seconds, those of games, other on the clock
    with tempfile.TemporaryDirectory() as folder, _Timed(settings) as evaluator:

        def report(of: GenerationReport) -> None:
            told.append((time.process_time(), evaluator.cpu_seconds, of.other_seconds))
            if len(told) > generations:
                raise _EnoughError

        with suppress(_EnoughError):
            evolve(create_run(Path(folder) / "run", settings), evaluator, report)
    count = len(told) - 1
    games = (told[-1][1] - told[0][1]) / count
    other = (told[-1][0] - told[0][0]) / count - games
    return {
        "games_cpu_seconds": games,
        "other_cpu_seconds": other,
        "share": other / (games + other),
        "share_of_two_workers": other / (games / 2.0 + other),
        "other_seconds": sum(clock for _, _, clock in told[1:]) / count,
    }
