"""A game whose results are known: the strength of a tree is the number of its first leaf."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from coevo.config import ForeignSettings, check
from coevo.evolution import evolve
from coevo.evolution.evaluation import Evaluator
from coevo.run import create_run, open_run

LADDER = """
import numpy as np
from coevo.game import Played, Role
from coevo.tree import FunctionSet

class Ladder:
    counts = ("points",)

    def __init__(self, teams, skill, luck):
        self.roles = tuple(Role(f"p{team}", team) for team in range(teams))
        self.skill, self.luck = skill, luck

    def function_set(self, role):
        return FunctionSet(("IF_odd",), tuple(f"s{k}" for k in range(8)))

    def play(self, programs, seeds):
        strength = np.array([-1 - int(p.codes[p.codes < 0][0]) for p in programs])
        noise = np.array([np.random.default_rng(seed).random(len(programs)) for seed in seeds])
        score = self.skill * strength + self.luck * noise
        best = score == score.max(axis=1, keepdims=True)
        winner = np.where(best.sum(axis=1) == 1, best.argmax(axis=1), -1)
        points = {"points": np.round(1000 * score).astype(np.int64)}
        leaves = []
        for p in programs:
            steps = np.zeros(len(p.codes), np.int64)
            steps[np.flatnonzero(p.codes < 0)[0]] = len(seeds)
            leaves.append(steps)
        return Played(points, winner.astype(np.int64), leaves)

def make(table):
    return Ladder(table["teams"], table["skill"], table["luck"])

def points(measures, **now):
    return -measures["points"].astype(float)
"""


@pytest.fixture(scope="session")
def small_run(small_run, tmp_path_factory):
    """Return a copy of the finished small run, into which results are written: that of all other tests is only read."""
    return open_run(Path(shutil.copytree(small_run.path, tmp_path_factory.mktemp("kept") / "run")))


@pytest.fixture
def begun(go_on):
    """Return a function that stops a run after its first generation."""

    def stop(_):
        raise KeyboardInterrupt

    def bring(run):
        with pytest.raises(KeyboardInterrupt):
            go_on(run, report=stop)
        return open_run(run.path)

    return bring


@pytest.fixture(scope="session")
def ladder(tmp_path_factory):
    """Return a function that evolves the ladder: of some teams, by skill and luck."""

    def run_of(teams, *, skill=1.0, luck=0.0, generations=4, population=12, games=2, **evaluation: object):
        folder = tmp_path_factory.mktemp("ladder")
        (folder / "ladder.py").write_text(LADDER, encoding="utf-8")
        settings = check(
            ForeignSettings,
            {
                "name": "ladder",
                "game": {"kind": "ladder:make", "teams": teams, "skill": skill, "luck": luck},
                "fitness": {"kind": "ladder:points"},
                "gp": {"population": population, "generations": generations, "tournament": 2},
                "evaluation": {"games": games, **evaluation},
            },
            "ladder",
        )
        run = create_run(folder / "run", settings, (folder,))
        with Evaluator(run.config, workers=1, backend="threads", folders=run.folders) as evaluator:
            evolve(run, evaluator, lambda _: None)
        return open_run(run.path)

    return run_of


@pytest.fixture(scope="session")
def ladder_run(ladder):
    """Return a finished run of the ladder between two teams."""
    return ladder(2)
