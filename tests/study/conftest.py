"""What tests of studies share: a study file of small runs, and workers that are this process."""

from __future__ import annotations

import pytest

from coevo.study import cores
from coevo.study.folder import open_study
from coevo.study.plan import read_plan
from coevo.study.task import do, task_of

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


def write_study(path, head='recipes = ["smoke"]\nseeds = 2', vary=VARIED, settings=SET):
    """Write a study of small runs and return its path."""
    path.write_text(f"{head}\n{settings}\n{vary}", encoding="utf-8")
    return path


@pytest.fixture
def study_file(tmp_path):
    """Return a function that writes a study of small runs and returns its path."""
    return lambda *parts, name="mine.toml", **named: write_study(tmp_path / name, *parts, **named)


@pytest.fixture(scope="session")
def finished_study(tmp_path_factory):
    """Return a function that does a study of small runs, one after the other in this process; it returns the folder."""

    def finish(vary=VARIED, settings=SET):
        path = tmp_path_factory.mktemp("finished")
        folder = open_study(path / "out", read_plan(str(write_study(path / "mine.toml", vary=vary, settings=settings))))
        tasks = [task_of(folder, run) for run in folder.plan.runs]
        folder.write_tables({done.name: done.row for done in map(do, tasks)}, {})
        folder.close()
        return path / "out"

    return finish


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
