"""Last champions of runs against those of other runs: which way of evolving makes the better teams?

Each run's champions of a side meet the other side's of every run, its own too. So all are judged by the same opponents,
and from the same starts.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import msgspec
import numpy as np
import pandas as pd

from coevo.config import ForeignSettings, RunSettings
from coevo.contest import LineUp, champions, evolving_teams, line_up
from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator, Match
from coevo.run import Run
from coevo.seeds import RunStream, game_seeds

__all__ = ["cross_play", "same_game"]

# How a run evolves and what it is compared with, which says nothing about the game: contests are played by the recipe's
# own settings, whatever its levels.
_HOW = {"name", "seed", "gp", "fitness", "evaluation", "levels", "hand_typed"}


def same_game(runs: Sequence[Run]) -> bool:
    """Return whether runs are about the same game, played with the same skills, so that their champions can meet.

    Skills are the same by their digests, wherever they lay when a run was begun; so is the code of a game of one's own.
    """
    return len({_about(run) for run in runs}) == 1


def _about(run: Run) -> bytes:
    config = run.config
    assert isinstance(config, (RunSettings, ForeignSettings))
    parts = {name: value for name, value in msgspec.to_builtins(config).items() if name not in _HOW}
    digests = _digests(run)
    if isinstance(config, RunSettings):
        parts["skills"] |= {name: of for name, of in digests.get("skills", {}).items() if parts["skills"].get(name)}
    else:
        module = str(config.game["kind"]).partition(":")[0]
        parts["module"] = digests.get("own_modules", {}).get(f"{module}.py")
    return msgspec.json.encode(parts, order="sorted")


def _digests(run: Run) -> dict[str, dict[str, str]]:
    """Return the digests of the skills and modules that a run was begun with, as far as it tells."""
    try:
        told = json.loads(run.environment)
    except ValueError:  # a run of an older version has none, and nothing by which to see that it was spoilt
        return {}
    return {name: of for name in ("skills", "own_modules") if isinstance(of := told.get(name), dict)}


def cross_play(runs: Sequence[Run], names: Sequence[str], evaluator: Evaluator, *, games: int) -> pd.DataFrame:
    """Let the last champions of runs meet.

    Args:
        runs: of the same game, each with a finished generation.
        names: of the runs.
        evaluator: plays, for any of the runs.
        games: of each pair.

    Returns:
        a row a side and pair: ``side`` (names of its robots), ``run``, ``met``, ``share`` of games that the side won. A
        team that plays alone meets nobody: ``met`` is then the number of a set of starts.

    Raises:
        InputError: the runs are about different games.
    """
    if not same_game(runs):
        raise InputError("champions of different games cannot meet; give runs of the same game, world and skills")
    game, root = runs[0].game, runs[0].config.seed
    last = [champions(run, run.finished - 1) for run in runs]
    teams = evolving_teams(game)
    pairs = [(team, a, b) for team in teams for a in range(len(runs)) for b in range(len(runs))]
    blocks = [game_seeds(root, RunStream.CROSS, block, count=games) for block in range(len(runs))]
    matches = []
    for team, a, b in pairs:
        others: list[LineUp] = [part for other, part in last[b].items() if other != team]
        block = b if len(teams) == 1 else (a + b) % len(runs)  # whoever has no other side plays from the same starts
        matches.append(Match(line_up(game, last[a][team], *others), blocks[block]))
    rows = []
    for (team, a, b), played in zip(pairs, evaluator.play(matches), strict=True):
        side = ", ".join(game.roles[role].name for role in last[a][team])
        met = str(b) if len(teams) == 1 else names[b]
        rows.append((side, names[a], met, float(np.mean(played.winner == team))))
    return pd.DataFrame(rows, columns=["side", "run", "met", "share"])
