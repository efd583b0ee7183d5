"""What tests of studies share: a study file of small runs, and workers that are this process."""

from __future__ import annotations

import pytest

from coevo.study import cores
from coevo.study.task import do

# Runs of about a second.
SET = """
[set]
"gp.population" = 6
"gp.generations" = 3
"gp.tournament" = 2
"gp.creation_depth_max" = 4
"evaluation.games" = 2
"game.time_limit_steps" = 90
"""
VARIED = '[vary]\n"fitness.kind" = ["fixed", "varying"]\n'


@pytest.fixture
def study_file(tmp_path):
    """Return a function that writes a study of small runs and returns its path."""

    def write(head='recipes = ["smoke"]\nseeds = 2', vary=VARIED, settings=SET, name="mine.toml"):
        path = tmp_path / name
        path.write_text(f"{head}\n{settings}\n{vary}", encoding="utf-8")
        return path

    return write


@pytest.fixture
def here(monkeypatch):
    """Do tasks in this process instead of others; return the names of those that were done."""
    done = []

    def in_turn(tasks, _workers):
        for task in tasks:
            done.append(task.name)
            yield do(task)

    monkeypatch.setattr(cores, "on_cores", in_turn)
    return done
