"""Compare generations on games that evolution has not seen.

For each run the best tree of each robot plays; a run counts once, so the interval over runs says what another seed
would give. Against an opponent that evolves too, goals alone say little: the best teams of the first and the last
generation then also meet each other's opponents.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd

from coevo.config import RunSettings
from coevo.console import output_options, show, table
from coevo.contest import LineUp, champions, evolving_teams, line_up
from coevo.errors import InputError
from coevo.game import SoccerGame
from coevo.run import Run, open_run
from coevo.seeds import RunStream, game_seeds
from coevo.statistics import mean_interval

__all__ = ["gain_intervals", "gains_table", "unseen", "unseen_table"]

_ALONE = "last against first generation"


def unseen_table(runs: Sequence[Run], *, games: int, seed: int) -> pd.DataFrame:
    """Return what the best trees of the first and of the last generation of each run do in unseen games.

    Args:
        runs: of soccer, each with a finished generation.
        games: of each row; all rows of a run, and of runs with one setting, play the same ones.
        seed: of these games.

    Returns:
        A row a run and line-up. ``run``: its folder. ``who``, for people; ``first_side`` and ``second_side``: the
        generation that plays for the first team that evolves and for the other (-1 where none does).
        ``goals``, ``low``, ``high``: share of games that the first side wins, and its interval over games (Student's t,
        cut at 0 and 1). ``lost``: share that it loses. ``passes`` a game, of all robots together. ``steps`` a game.
        ``first_robots``, ``second_robots``: their names.

    Raises:
        InputError: a run is about another game, or has no finished generation.
    """
    return pd.DataFrame([row for run in runs for row in _rows(run, games, seed)])


def _rows(run: Run, games: int, seed: int) -> list[dict[str, Any]]:
    if not isinstance(run.config, RunSettings):
        raise InputError(f"{run.path} is about another game; this compares games of soccer")
    if run.finished < 1:
        raise InputError(f"{run.path} has no finished generation yet; go on with 'coevo resume {run.path}'")
    game, seeds = run.game, game_seeds(seed, RunStream.UNSEEN, count=games)
    assert isinstance(game, SoccerGame)
    sides = evolving_teams(game)
    names = [", ".join(role.name for role in game.roles if role.evolves and role.team == side) for side in sides]
    teams = {generation: champions(run, generation) for generation in (0, run.finished - 1)}
    return [
        {
            "run": str(run.path),
            "who": who,
            "first_side": pair[0],
            "second_side": pair[1] if len(sides) > 1 else -1,
            **_played(game, [teams[pair[k]][side] for k, side in enumerate(sides)], sides[0], seeds),
            "first_robots": names[0],
            "second_robots": names[1] if len(sides) > 1 else "",
        }
        for who, pair in _pairs(names, run.finished - 1).items()
    ]


def _pairs(names: Sequence[str], last: int) -> Mapping[str, tuple[int, int]]:
    """Return which generation plays for the first side and which for the second, by what people call it."""
    pairs = {"generation 0": (0, 0), f"generation {last}": (last, last)}
    if len(names) > 1:
        pairs[f"last {names[0]} / first {names[1]}"] = (last, 0)
        pairs[f"first {names[0]} / last {names[1]}"] = (0, last)
    return pairs


def _played(game: SoccerGame, parts: Sequence[LineUp], side: int, seeds: np.ndarray[Any, Any]) -> dict[str, float]:
    played = game.play(line_up(game, *parts), seeds)
    goals, low, high = mean_interval((played.winner == side).astype(float))
    return {
        "goals": goals,
        "low": max(0.0, low),
        "high": min(1.0, high),
        "lost": float(((played.winner >= 0) & (played.winner != side)).mean()),
        "passes": float(played.counts["passes"].sum(axis=1).mean()),
        "steps": float(played.counts["steps"][:, 0].mean()),
    }


def gains_table(unseen_games: pd.DataFrame) -> pd.DataFrame:
    """Return by how much the last generation is ahead of the first: a row a run and comparison.

    Args:
        unseen_games: of ``unseen_table``.

    Returns:
        ``run``, ``gain`` (which comparison) and ``value``: the difference of goals less lost goals a game, for the side
        that ``gain`` names; the other side is the first generation's in both terms.
    """
    rows = []
    for run, of_run in unseen_games.groupby("run", sort=False):
        ahead = (of_run["goals"] - of_run["lost"]).to_numpy()
        rows.append((run, _ALONE, ahead[1] - ahead[0]))
        if len(of_run) > 2:
            first, second = of_run[["first_robots", "second_robots"]].iloc[0]
            rows.append((run, f"{first}: last against first, same first {second}", ahead[2] - ahead[0]))
            rows.append((run, f"{second}: last against first, same first {first}", ahead[0] - ahead[3]))
    return pd.DataFrame(rows, columns=["run", "gain", "value"])


def gain_intervals(gains: pd.DataFrame) -> pd.DataFrame:
    """Return the mean of each gain over runs: ``gain``, ``mean``, ``low``, ``high`` (Student's t), ``runs``.

    Args:
        gains: of ``gains_table``.
    """
    rows = [
        (gain, *mean_interval(found.to_numpy()), len(found))
        for gain, found in gains.groupby("gain", sort=False)["value"]
    ]
    return pd.DataFrame(rows, columns=["gain", "mean", "low", "high", "runs"])


@click.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--games", type=click.IntRange(min=1), default=1000, show_default=True)
@click.option("--seed", type=click.IntRange(min=0, max=2**63 - 1), default=1, show_default=True)
@output_options
def unseen(*, folders: tuple[Path, ...], games: int, seed: int, as_json: bool, quiet: bool) -> None:
    """Play unseen games between the best trees of the first and of the last generation of each run.

    \b
    Example: coevo reproduce unseen runs/two-learners-seed0 runs/two-learners-seed1
    """
    del quiet  # it shows no progress
    found = unseen_table([open_run(folder) for folder in dict.fromkeys(folders)], games=games, seed=seed)
    intervals = gain_intervals(gains_table(found))
    data = {
        "games": games,
        "seed": seed,
        "teams": [
            {
                **{name: row[name] for name in ("run", "who")},
                "goals": [row[name] for name in ("goals", "low", "high")],
                **{name: row[name] for name in ("lost", "passes", "steps")},
            }
            for row in found.to_dict("records")
        ],
        "gains": {row["gain"]: [row["mean"], row["low"], row["high"]] for row in intervals.to_dict("records")},
    }
    show(data, _text(found, intervals), as_json=as_json)


def _text(found: pd.DataFrame, intervals: pd.DataFrame) -> str:
    rows = [
        [
            Path(row["run"]).name,
            row["who"],
            f"{row['goals']:.3f} [{row['low']:.3f}, {row['high']:.3f}]",
            f"{row['lost']:.3f}",
            f"{row['passes']:.2f}",
            f"{row['steps']:.0f}",
        ]
        for row in found.to_dict("records")
    ]
    lines = [table(["run", "who", "goals a game [95 %]", "lost", "passes", "steps"], rows)]
    for row in intervals.to_dict("records"):
        lines.append(f"gain in goals minus lost goals a game, {row['gain']}:")
        over = f"[{row['low']:+.3f}, {row['high']:+.3f}] over {row['runs']} runs" if row["runs"] > 1 else "in 1 run"
        lines.append(f"  {row['mean']:+.3f} {over}")
    return "\n".join(lines)
