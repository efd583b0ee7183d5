"""What tests of games share: settings of the presets, trees, and seeds."""

from __future__ import annotations

import numpy as np
import pytest

from coevo.config import GPSettings, RunSettings
from coevo.evolution.population import codes_of, first_population
from coevo.game import Arena, SoccerGame
from coevo.plain import PlainGame
from coevo.recipes import read_settings
from coevo.seeds import game_seeds
from coevo.tree import from_codes, parse
from coevo.tree.program import compile_program, tree_codes


def _controlled(settings):
    """Return which robots evolve."""
    return [player.control == "evolve" for player in settings.players]


def _settings_of(preset, *assignments):
    """Return the settings of a preset, with some replaced."""
    return read_settings(RunSettings, preset, assignments)


@pytest.fixture(scope="session")
def settings_of():
    """Return a function that gives the settings of a preset, with some replaced."""
    return _settings_of


def _programs(settings, trees):
    game, found = SoccerGame(settings), []
    for robot, tree in enumerate(trees):
        functions = game.function_set(robot)
        found.append(None if tree is None else compile_program(tree_codes(tree, functions), functions))
    return found


@pytest.fixture(scope="session")
def programs():
    """Return a function that makes the programs of trees, None for robots that stand."""
    return _programs


def _random_trees(settings, count, seed, depths=(1, 6)):
    """Return ``count`` teams of random trees, None for robots that stand."""
    gp = GPSettings(population=count, elite=0, creation_depth_min=depths[0], creation_depth_max=depths[1])
    game, columns = SoccerGame(settings), []
    for robot, evolves in enumerate(_controlled(settings)):
        functions = game.function_set(robot)
        trees = first_population(gp, functions, seed=seed, robot=robot)
        columns.append([from_codes(codes_of(tree, functions), functions) if evolves else None for tree in trees])
    return list(zip(*columns, strict=True))


@pytest.fixture(scope="session")
def random_trees():
    """Return a function that makes teams of random trees."""
    return _random_trees


def _the_same_tree(settings, text):
    return [parse(text) if evolves else None for evolves in _controlled(settings)]


@pytest.fixture(scope="session")
def the_same_tree():
    """Return a function that gives the same tree to all robots that evolve."""
    return _the_same_tree


def _seeds_of(*key, count):
    return game_seeds(*key, count=count)


@pytest.fixture(scope="session")
def seeds_of():
    """Return a function that makes seeds of games."""
    return _seeds_of


def _play_both(settings, trees, seeds):
    arena, plain = Arena(settings), PlainGame(settings)
    different, outcomes, traces = [], [], []
    for n, (team, seed) in enumerate(zip(trees, seeds, strict=True)):
        one, seen = arena.trace(_programs(settings, team), seed)
        two, expected = plain.play(team, seed, thoughts=True)
        equal = [
            np.array_equal(getattr(one, name), getattr(two, name))
            for name in ("steps", "scorer", "kicks", "collisions", "passes", "own_goals", "skill_steps")
        ]
        equal += [
            seen.states.tobytes() == expected.states.tobytes(),
            np.array_equal(seen.skills, expected.skills),
            np.array_equal(seen.actions, expected.actions),
            np.array_equal(seen.leaves, expected.leaves),
            np.array_equal(seen.perceived, expected.perceived),
        ]
        if not all(equal):
            different.append(n)
        outcomes.append(two)
        traces.append(expected)
    return different, outcomes, traces


@pytest.fixture(scope="session")
def play_both():
    """Return a function that plays games twice: which differ in anything, and outcomes and traces of the plain loop."""
    return _play_both
