"""A game whose every result can be worked out: who wins is looked up by situation and by what everybody chooses."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from coevo.config import ForeignSettings, check
from coevo.evolution.evaluation import Evaluator
from coevo.game import make_game

LOOKED_UP = """
import numpy as np
from coevo.game import Played, Role
from coevo.tree import FunctionSet

CONDITIONS = ("IF_dark", "IF_wet")

class LookedUp:
    counts = ("won",)

    def __init__(self, winners, teams):
        self.winners = np.array(winners)  # by dark, wet, and what each role chooses
        self.roles = tuple(Role(f"p{k}", team) for k, team in enumerate(teams))

    def function_set(self, role):
        return FunctionSet(CONDITIONS, ("x", "y"))

    def play(self, programs, seeds):
        steps = [np.zeros(len(p.codes), np.int64) for p in programs]
        winner = np.zeros(len(seeds), np.int64)
        for k, seed in enumerate(seeds):
            now = [int(seed) & 1, int(seed) >> 1 & 1]  # seeds are random bits
            chosen = []
            for p, of in zip(programs, steps):
                node = 0
                while p.codes[node] >= 0:
                    node = node + 1 if now[p.codes[node]] else p.second[node]
                of[node] += 1
                chosen.append(-1 - int(p.codes[node]))
            winner[k] = self.winners[(*now, *chosen)]
        won = np.array([[w == role.team for role in self.roles] for w in winner], np.int64)
        return Played({"won": won}, winner, steps)

def make(table):
    return LookedUp(table["winners"], table["teams"])
"""


class Known:
    """The game of some winners, by dark, wet and the choice of each role, with what its teams are worth exactly."""

    def __init__(self, folder, winners, teams) -> None:
        (folder / "lookedup.py").write_text(LOOKED_UP, encoding="utf-8")
        self.winners = np.asarray(winners)
        game = {"kind": "lookedup:make", "winners": self.winners.tolist(), "teams": list(teams)}
        self.settings = check(ForeignSettings, {"game": game}, "looked up")
        self.folders = (folder,)
        self.game = make_game(self.settings, self.folders)

    def evaluator(self):
        return Evaluator(self.settings, workers=1, backend="threads", folders=self.folders)

    def worth(self, trees, team):
        """Return the share of games that a team wins, by all situations."""
        won = []
        for now in itertools.product((0, 1), repeat=2):
            true = {name for name, holds in zip(("IF_dark", "IF_wet"), now, strict=True) if holds}
            chosen = []
            for _, tree in sorted(trees.items()):
                node = 0
                while tree.second[node]:
                    node = node + 1 if tree.names[node] in true else tree.second[node]
                chosen.append(("x", "y").index(tree.names[node]))
            won.append(self.winners[(*now, *chosen)] == team)
        return float(np.mean(won))


@pytest.fixture
def known(tmp_path):
    """Return a function that makes a ``Known`` game of winners and of the team of each role."""
    return lambda winners, teams: Known(tmp_path, winners, teams)
