"""What tests of the command line share: a small recipe, and what is asked of everything that a command says."""

from __future__ import annotations

import json
import shutil

import pytest

from coevo.game import function_set
from coevo.run import create_run
from coevo.tree import compile_program, tree_codes


@pytest.fixture
def small_recipe(small_settings, tmp_path):
    """Return the path of the small experiment as a recipe."""
    path = tmp_path / "small.toml"
    create_run(tmp_path / "made", small_settings())
    shutil.move(tmp_path / "made" / "config.toml", path)
    return path


@pytest.fixture(scope="session")
def refused():
    """Return a function that checks that wrong input is told in one or two plain lines, and returns them."""

    def of(said, *parts):
        assert said.code == 2, said.err
        assert said.out == ""
        assert "Traceback" not in said.err
        _, mark, message = f"\n{said.err}".rpartition("\ncoevo: ")
        assert mark, said.err
        assert len(message.strip().split("\n")) <= 2, message
        for part in parts:
            assert part in message
        return message

    return of


@pytest.fixture(scope="session")
def cut_short():
    """Return a function that makes a finished run look as if it had been killed after some generations."""

    def of(run, generations):
        for path in sorted((run / "individuals.parquet").iterdir())[generations:]:
            path.unlink()
        (run / "checkpoint.npz").unlink()

    return of


@pytest.fixture(scope="session")
def one_object():
    """Return a function that gives the one JSON object on standard output."""

    def of(said):
        assert said.code == 0, said.err
        data = json.loads(said.out)
        assert isinstance(data, dict)
        return data

    return of


@pytest.fixture(scope="session")
def best_programs():
    """Return a function that gives the programs of the best of a generation."""

    def programs(run, generation):
        robots = len(run.config.players)
        functions = [function_set(robot, robots) for robot in range(robots)]
        trees = [run.tree(f"r{robot}", generation) for robot in range(robots)]
        return [compile_program(tree_codes(tree, of), of) for tree, of in zip(trees, functions, strict=True)]

    return programs
