"""How long the parts of a game and of a generation take: `make bench`. Without benchmarks, that they run at all."""

from __future__ import annotations

import time

import numpy as np
import pytest

from coevo.bench import bookkeeping
from coevo.config import RunSettings
from coevo.evolution.evaluation import Evaluator
from coevo.evolution.population import codes_of, first_population
from coevo.evolution.variation import breed
from coevo.game import Arena, function_set
from coevo.recipes import read_settings
from coevo.run import Run
from coevo.seeds import game_seeds
from coevo.soccer.camera import FEATURES, camera_params, make_retina, object_count, see
from coevo.soccer.drive import action_set
from coevo.soccer.physics import physics_params, replay
from coevo.soccer.world import World
from coevo.tree.program import compile_program

STEPS, GAMES = 300, 20


@pytest.fixture(scope="module")
def settings():
    return read_settings(RunSettings, "three-learners")


@pytest.fixture(scope="module")
def team(settings):
    """Return the programs of three random trees of the dissertation's size."""
    found = []
    for robot in range(3):
        functions = function_set(robot, 3)
        trees = first_population(settings.gp, functions, seed=1, robot=robot)
        largest = max((codes_of(tree, functions) for tree in trees), key=len)
        found.append(compile_program(largest, functions))
    return found


def start():
    state = np.zeros((4, 6))
    state[:, :3] = (4.9, 1.0, 2.8), (3.0, 3.5, -0.2), (7.0, 2.3, 3.1), (4.0, 1.2, 0.0)
    return state


def test_physics_alone(benchmark, settings):
    """300 steps of three robots and the ball."""
    world, params = World(settings.world, 3), physics_params(settings.world)
    actions = action_set(settings.world.robot).commands
    held = np.random.default_rng(1).integers(0, len(actions), (STEPS // 10, 3)).repeat(10, axis=0)
    states = np.zeros((STEPS, 4, 6))
    benchmark(replay, world.handles, params, start(), actions[held], states)
    assert np.all(np.ptp(states[:, :3, 0], axis=0) > 0.0)


def test_one_look(benchmark, settings):
    """All that one robot of three sees."""
    features, areas = np.zeros((object_count(3), FEATURES)), np.zeros(object_count(3))
    benchmark(see, camera_params(settings.world), start(), 1, 0, make_retina(settings.world), features, areas)
    assert np.count_nonzero(areas) >= 2


def test_the_games_of_one_team(benchmark, settings, team):
    """20 games between trees: physics, cameras, state estimates, tables and trees."""
    arena = Arena(settings)
    seeds = game_seeds(1, count=GAMES)
    outcome = benchmark(arena.play, team, seeds)
    assert outcome.steps.shape == (GAMES,)
    assert outcome.skill_steps.sum() == 3 * outcome.steps.sum()


def test_the_variation_of_a_generation(benchmark, settings):
    """80 children by tournament, crossover, reproduction and mutation."""
    functions = function_set(0, 3)
    parents = first_population(settings.gp, functions, seed=1, robot=0)
    rng = np.random.default_rng(1)
    for parent in parents:
        parent.fitness.values = float(rng.random()), parent.height
    children = benchmark(breed, parents, settings.gp, functions, seed=1, generation=0, robot=0)
    assert len(children) == settings.gp.population
    best = min(parents, key=lambda parent: parent.fitness.values)
    assert np.array_equal(codes_of(children[0], functions), codes_of(best, functions))


def burn(seconds):
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass


def test_the_share_of_a_generation_that_is_not_games_is_told_apart(monkeypatch):
    """Time that is burnt between games and files is told of where it was burnt."""
    small = ("gp.population=4", "gp.tournament=2", "evaluation.games=1", "game.time_limit_steps=30")
    save, play = Run.save_checkpoint, Evaluator.play

    def slow_save(run, checkpoint):
        burn(0.2)
        save(run, checkpoint)

    def slow_play(evaluator, matches, settings=None):
        burn(0.6)
        yield from play(evaluator, matches, settings)

    monkeypatch.setattr(Run, "save_checkpoint", slow_save)
    monkeypatch.setattr(Evaluator, "play", slow_play)
    found = bookkeeping(["smoke"], 2, small)["smoke"]
    assert found["games_cpu_seconds"] == pytest.approx(0.6, rel=0.3)
    assert found["other_cpu_seconds"] == pytest.approx(0.2, rel=0.5)
    assert found["share"] == pytest.approx(0.25, abs=0.1)
