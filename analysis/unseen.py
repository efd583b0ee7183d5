"""Compare generations on games that evolution has not seen.

For each run the best tree of each robot plays; a run counts once, so the interval over runs says what another seed
would give. Against an opponent that evolves too, goals alone say little: the best teams of the first and the last
generation then also meet each other's opponents.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from analysis.games import play
from coevo.config import RunSettings
from coevo.console import output_options, show, table
from coevo.errors import InputError
from coevo.game import SoccerGame
from coevo.run import Run, open_run
from coevo.statistics import mean_interval
from coevo.tree import Tree

__all__ = ["unseen"]


def _best(run: Run, generation: int) -> list[Tree | None]:
    return [run.tree(role.name, generation) if role.evolves else None for role in run.game.roles]


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
    rows: list[list[str]] = []
    data: list[dict[str, Any]] = []
    gains: dict[str, list[float]] = {}
    for folder in folders:
        run = open_run(folder)
        if not isinstance(run.config, RunSettings):
            raise InputError(f"{folder} is about another game; this compares games of soccer")
        game, last = SoccerGame(run.config), run.finished - 1
        first_trees, last_trees = _best(run, 0), _best(run, last)
        pairs = {"generation 0": first_trees, f"generation {last}": last_trees}
        teams = {role.team for role in run.game.roles if role.evolves}
        if len(teams) > 1:
            ours = [role.team == 0 for role in run.game.roles]
            pairs["last r0, r1 / first r2"] = [
                new if mine else old for new, old, mine in zip(last_trees, first_trees, ours, strict=True)
            ]
            pairs["first r0, r1 / last r2"] = [
                old if mine else new for new, old, mine in zip(last_trees, first_trees, ours, strict=True)
            ]
        share: dict[str, float] = {}
        for name, trees in pairs.items():
            outcome = play(game, trees, games=games, seed=seed)
            goals, lost = outcome.scorer == 0, outcome.scorer == 1
            share[name] = float(goals.mean() - lost.mean())
            mean, low, high = mean_interval(goals.astype(float))
            data.append(
                {
                    "run": str(folder),
                    "who": name,
                    "goals": [mean, low, high],
                    "lost": float(lost.mean()),
                    "passes": float(outcome.passes.sum(axis=1).mean()),
                    "steps": float(outcome.steps.mean()),
                }
            )
            rows.append(
                [
                    folder.name,
                    name,
                    f"{mean:.3f} [{low:.3f}, {high:.3f}]",
                    f"{lost.mean():.3f}",
                    f"{outcome.passes.sum(axis=1).mean():.2f}",
                    f"{outcome.steps.mean():.0f}",
                ]
            )
        names = list(pairs)
        gains.setdefault("last against first generation", []).append(share[names[1]] - share[names[0]])
        if len(teams) > 1:
            gains.setdefault("r0, r1: last against first, same first r2", []).append(share[names[2]] - share[names[0]])
            gains.setdefault("r2: last against first, same first r0, r1", []).append(share[names[0]] - share[names[3]])
    lines = [table(["run", "who", "goals a game [95 %]", "lost", "passes", "steps"], rows)]
    intervals = {name: mean_interval(found) for name, found in gains.items()}
    for name, (mean, low, high) in intervals.items():
        lines.append(f"gain in goals minus lost goals a game, {name}:")
        lines.append(f"  {mean:+.3f} [{low:+.3f}, {high:+.3f}] over {len(gains[name])} runs")
    told = {"games": games, "seed": seed, "teams": data, "gains": intervals}
    show(told, "\n".join(lines), as_json=as_json)
