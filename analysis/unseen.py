"""Compare generations on games that evolution has not seen.

    python -m analysis.unseen runs/two-learners-seed1 runs/two-learners-seed2 --games 1000

For each run the best tree of each robot plays; a run counts once, so the interval over runs says what another seed
would give. Against an opponent that evolves too, goals alone say little: the best teams of the first and the last
generation then also meet each other's opponents.
"""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from analysis._games import mean_interval, play
from coevo.console import table
from coevo.game import Arena
from coevo.run import Run, open_run
from coevo.tree import Tree

__all__ = ["main"]


def _best(run: Run, generation: int) -> list[Tree | None]:
    return [
        run.tree(f"r{robot}", generation) if player.control == "evolve" else None
        for robot, player in enumerate(run.config.players)
    ]


@click.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--games", default=1000, show_default=True)
@click.option("--seed", default=1, show_default=True)
def main(*, folders: tuple[Path, ...], games: int, seed: int) -> None:
    """Play unseen games between the best trees of the first and of the last generation of each run."""
    rows: list[list[str]] = []
    gains: dict[str, list[float]] = {}
    for folder in folders:
        run = open_run(folder)
        arena, last = Arena(run.config), run.finished - 1
        first_trees, last_trees = _best(run, 0), _best(run, last)
        pairs = {"generation 0": first_trees, f"generation {last}": last_trees}
        teams = {player.team for player in run.config.players if player.control == "evolve"}
        if len(teams) > 1:
            ours = [player.team == 0 for player in run.config.players]
            pairs["last r0, r1 / first r2"] = [
                new if mine else old for new, old, mine in zip(last_trees, first_trees, ours, strict=True)
            ]
            pairs["first r0, r1 / last r2"] = [
                old if mine else new for new, old, mine in zip(last_trees, first_trees, ours, strict=True)
            ]
        share: dict[str, float] = {}
        for name, trees in pairs.items():
            outcome = play(arena, trees, games=games, seed=seed)
            goals, lost = outcome.scorer == 0, outcome.scorer == 1
            share[name] = float(goals.mean() - lost.mean())
            mean, low, high = mean_interval(goals.astype(float))
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
    click.echo(table(["run", "who", "goals a game [95 %]", "lost", "passes", "steps"], rows))
    for name, found in gains.items():
        mean, low, high = mean_interval(np.array(found))
        click.echo(f"gain in goals minus lost goals a game, {name}:")
        click.echo(f"  {mean:+.3f} [{low:+.3f}, {high:+.3f}] over {len(found)} runs")


if __name__ == "__main__":
    main()
