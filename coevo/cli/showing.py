"""coevo inspect, coevo play."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from coevo.console import emit, note, output_options, table

if TYPE_CHECKING:
    from coevo.run import Run
    from coevo.tree import Program

__all__ = ["inspect", "play"]


def _last(run: Run, generation: int | None) -> int:
    return max(run.finished - 1, 0) if generation is None else generation


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--robot", default=None, help="Which robot; by default the first that evolves.")
@click.option("--generation", type=click.IntRange(min=0), help="By default the last that is finished.")
@click.option("--rank", type=click.IntRange(min=0), default=0, show_default=True, help="0 is the best.")
@click.option("--simplified", is_flag=True, help="Show the simplified tree, which does the same.")
@click.option("--format", "kind", type=click.Choice(["text", "json", "dot", "svg"]), default="text", show_default=True)
@output_options
def inspect(
    *,
    folder: Path,
    robot: str | None,
    generation: int | None,
    rank: int,
    simplified: bool,
    kind: str,
    as_json: bool,
    quiet: bool,
) -> None:
    """Show a tree of a run, its fitness, and how often each branch and skill was used.

    \b
    Example: coevo inspect runs/smoke-seed0 --robot r1 --simplified
             coevo inspect runs/smoke-seed0 --robot r1 --simplified --format svg > tree.svg
    """
    from coevo.run import open_run
    from coevo.tree import simplify
    from coevo.tree.draw import as_dot, as_svg, as_text
    from coevo.usage import merge_usage, tree_usage

    run = open_run(folder)
    robot = robot or f"r{run.evolving[0]}"
    generation = _last(run, generation)
    tree = run.tree(robot, generation, rank)
    row = run.record(generation, robot).iloc[rank]
    usage = tree_usage(run, generation, int(row["group"]), robot, lambda text: note(text, quiet=quiet))
    smaller = simplify(tree)
    shown, steps = (smaller, merge_usage(tree, usage.node_steps, smaller)) if simplified else (tree, usage.node_steps)
    if as_json or kind == "json":
        emit(
            {
                "robot": robot,
                "generation": generation,
                "rank": rank,
                "tree": str(tree),
                "depth": tree.depth,
                "nodes": tree.nodes,
                "fitness": float(row["fitness"]),
                "simplified": {"tree": str(smaller), "depth": smaller.depth, "nodes": smaller.nodes},
                "skill_use": usage.skill_use,
                "node_steps": [int(count) for count in usage.node_steps],
                "steps": usage.steps,
            }
        )
    elif kind == "dot":
        click.echo(as_dot(shown, steps))
    elif kind == "svg":
        click.echo(as_svg(shown, steps))
    else:
        use = ", ".join(f"{name} {share:.1%}" for name, share in usage.skill_use.items())
        click.echo(f"{robot}, generation {generation}, rank {rank}: fitness {row['fitness']:.4f}")
        click.echo(f"the tree: depth {tree.depth}, nodes {tree.nodes}")
        click.echo(f"simplified: depth {smaller.depth}, nodes {smaller.nodes}")
        click.echo(f"skills used: {use}")
        click.echo(f"\n{as_text(shown, steps)}")


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--generation", type=click.IntRange(min=0), help="By default the last that is finished.")
@click.option("--games", type=click.IntRange(min=1), default=20, show_default=True)
@click.option(
    "--seed",
    type=click.IntRange(min=0, max=2**63 - 1),
    default=1,
    show_default=True,
    help="Of the games; they are never those of evolution.",
)
@click.option("--trace", type=click.Path(path_type=Path), help="Write every step to a CSV file.")
@click.option("--video", type=click.Path(path_type=Path), help="Write a replay: .mp4, .gif or .html.")
@output_options
def play(
    *,
    folder: Path,
    generation: int | None,
    games: int,
    seed: int,
    trace: Path | None,
    video: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Play games between the best trees of a generation and say what happened.

    \b
    Example: coevo play runs/smoke-seed0 --games 100 --seed 7
             coevo play runs/smoke-seed0 --games 3 --video replay.html
    """
    from coevo.game import Arena, warm_up
    from coevo.replay import trace_digest, write_trace, write_video
    from coevo.run import open_run
    from coevo.usage import play_seeds

    run = open_run(folder)
    generation = _last(run, generation)
    programs = best_programs(run, generation)
    warm_up(run.config, lambda text: note(text, quiet=quiet))
    arena = Arena(run.config)
    played = [arena.trace(programs, random) for random in play_seeds(seed, games)]
    outcomes, traces = [outcome for outcome, _ in played], [trace for _, trace in played]
    if trace is not None:
        write_trace(trace, run.config, traces)
    if video is not None:
        write_video(video, run.config, traces)
    scorers = np.array([int(outcome.scorer[0]) for outcome in outcomes])
    robots = range(len(run.config.players))
    teams = [player.team for player in run.config.players]
    result: dict[str, Any] = {
        "games": games,
        "generation": generation,
        "seed": seed,
        "goals": {f"r{i}": int((scorers == teams[i]).sum()) for i in robots},
        "lost": {f"r{i}": int((scorers == 1 - teams[i]).sum()) for i in robots},
        "kicks": {f"r{i}": int(sum(outcome.kicks[0, i] for outcome in outcomes)) for i in robots},
        "collisions": {f"r{i}": int(sum(outcome.collisions[0, i] for outcome in outcomes)) for i in robots},
        "passes": {f"r{i}": int(sum(outcome.passes[0, i] for outcome in outcomes)) for i in robots},
        "steps": int(sum(outcome.steps[0] for outcome in outcomes)),
        "digest": trace_digest(traces),
    }
    if as_json:
        emit(result)
        return
    click.echo(f"{games} games between the best of generation {generation} (seed {seed}), {result['steps']} steps:")
    names = ("goals", "lost", "kicks", "passes", "collisions")
    click.echo(table(["robot", *names], [[f"r{i}", *(str(result[name][f"r{i}"]) for name in names)] for i in robots]))
    for path in (trace, video):
        if path is not None:
            click.echo(f"Written: {path}")


def best_programs(run: Run, generation: int) -> list[Program | None]:
    """Return the programs of the best trees of a generation, None for robots that stand."""
    from coevo.tree import compile_program, function_set, tree_codes

    robots = len(run.config.players)
    programs: list[Program | None] = [None] * robots
    for robot in run.evolving:
        functions = function_set(robot, robots)
        programs[robot] = compile_program(tree_codes(run.tree(f"r{robot}", generation), functions), functions)
    return programs
