"""coevo inspect, coevo play."""

from __future__ import annotations

import hashlib
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click
import numpy as np

from coevo.console import Count, emit, note, output_options, table
from coevo.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from coevo.game import Game
    from coevo.run import Run
    from coevo.stage import Trace
    from coevo.tree import Tree
    from coevo.tree.rules import Rule
    from coevo.usage import UsedTree

__all__ = ["inspect", "play"]

_SHOWN = 5000  # games; all of them are in memory until they are written


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--robot", default=None, help="Which robot; by default the first that evolves.")
@click.option("--generation", type=click.IntRange(min=0), help="By default the last that is finished.")
@click.option("--rank", type=click.IntRange(min=0), help="0 is the best.  [default: the champion]")
@click.option("--simplified", is_flag=True, help="Show the simplified tree, which does the same.")
@click.option("--format", "kind", type=click.Choice(["text", "json", "dot", "svg"]), default="text", show_default=True)
@click.option("--all", "whole", is_flag=True, help="Show every node, folding nothing.")
@click.option(
    "--fold",
    type=click.FloatRange(0.0, 1.0),
    help="Fold branches that carried less than this share of the steps.  [default: 0.005]",
)
@output_options
def inspect(
    *,
    folder: Path,
    robot: str | None,
    generation: int | None,
    rank: int | None,
    simplified: bool,
    kind: str,
    whole: bool,
    fold: float | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Say what a robot of a run does, and show its tree with how often each branch was used.

    Branches that were never used, or hardly ever, are folded, and those whose questions never mattered.

    \b
    Example: coevo inspect runs/smoke-seed0 --robot r1 --simplified
             coevo inspect runs/smoke-seed0 --robot r1 --simplified --format svg > tree.svg
    """
    from coevo.game import prepare
    from coevo.portrait import portrait
    from coevo.run import open_run
    from coevo.tree.draw import as_dot, as_text
    from coevo.tree.fold import FOLD
    from coevo.usage import used_tree

    if whole and fold is not None:
        raise InputError("--all folds nothing and --fold says what to fold; give one of them")
    run = open_run(folder)
    prepare(run.config, lambda text: note(text, quiet=quiet))
    used = used_tree(run, robot, generation, rank)
    tree, smaller = used.tree, used.simplified
    shown, steps = (smaller, used.simplified_steps) if simplified else (tree, used.usage.node_steps)
    share = None if whole else FOLD if fold is None else fold
    if as_json or kind == "json":
        emit(_told(used))
    elif kind == "dot":
        click.echo(as_dot(shown, steps, fold=share, terminals=used.functions.terminals))
    elif kind == "svg":
        click.echo(used.picture(share, simplified=simplified))
    else:
        click.echo(f"{used.title}: fitness {used.fitness:.4f}\n")
        play_more = shlex.join(["coevo", "play", str(folder), "--generation", str(used.generation), "--games", "1000"])
        click.echo(f"{portrait(used, play_more)}\n")
        click.echo(f"the tree: depth {tree.depth}, nodes {tree.nodes}")
        click.echo(f"simplified: depth {smaller.depth}, nodes {smaller.nodes}")
        click.echo(f"\n{as_text(shown, steps, fold=share)}")


def _told(used: UsedTree) -> dict[str, Any]:
    """Return a tree and its use as plain data."""
    from coevo.portrait import portrait, questions

    def plain(rules: Sequence[Rule]) -> list[dict[str, Any]]:
        return [{"when": rule.when, "terminal": rule.terminal, "share": rule.share} for rule in rules]

    fitness = used.generation_fitness
    return {
        "robot": used.robot,
        "generation": used.generation,
        "rank": used.rank,
        "tree": str(used.tree),
        "depth": used.tree.depth,
        "nodes": used.tree.nodes,
        "fitness": used.fitness,
        "fitness_again": None if used.again is None else used.again[0],
        "generation_fitness": {
            "individuals": len(fitness),
            "best": float(fitness.min()),
            "mean": float(fitness.mean()),
            "worst": float(fitness.max()),
        },
        "simplified": {
            "tree": str(used.simplified),
            "depth": used.simplified.depth,
            "nodes": used.simplified.nodes,
        },
        "skill_use": used.usage.skill_use,
        "descriptions": dict(used.functions.descriptions),
        "questions": questions(used),
        "rules": plain(used.rules),
        "rules_in_use": plain(used.rules_in_use),
        "text": portrait(used),
        "node_steps": [int(count) for count in used.usage.node_steps],
        "never_used": int((used.usage.node_steps == 0).sum()),
        "steps": used.usage.steps,
    }


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--generation", type=click.IntRange(min=0), help="By default the last that is finished.")
@click.option("--games", type=Count(), help="How many new games between the best.  [default: 20]")
@click.option(
    "--seed",
    type=click.IntRange(min=0, max=2**63 - 1),
    help="Of new games; they are never those of evolution.  [default: 1]",
)
@click.option(
    "--group", type=click.IntRange(min=0), help="Instead: the games that a group played in evolution, once more."
)
@click.option("--game", type=click.IntRange(min=0), help="With --group: only this one of its games, from 0 on.")
@click.option("--trace", type=click.Path(path_type=Path), help="Write every step to a CSV file.")
@click.option("--video", type=click.Path(path_type=Path), help="Write a replay: .mp4, .gif or .html.")
@output_options
def play(
    *,
    folder: Path,
    generation: int | None,
    games: int | None,
    seed: int | None,
    group: int | None,
    game: int | None,
    trace: Path | None,
    video: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Play games between the best trees of a generation and say what happened.

    With --group these are the games that evolution played with the trees of a group, step for step; the column group of
    individuals.parquet says in which each individual was, or was first.

    \b
    Example: coevo play runs/smoke-seed0 --games 100 --seed 7
             coevo play runs/smoke-seed0 --games 3 --video replay.html
             coevo play runs/smoke-seed0 --generation 2 --group 5 --game 0 --video replay.html
    """
    from coevo.config import RunSettings
    from coevo.game import prepare
    from coevo.replay import check_video
    from coevo.run import open_run
    from coevo.usage import last_generation

    if trace is not None and video is not None and trace.absolute() == video.absolute():
        raise InputError(f"--trace and --video cannot both be {trace}; give two names")
    if games is not None and games > _SHOWN and (trace is not None or video is not None):
        raise InputError(f"--trace and --video show {_SHOWN} games at most, got --games {games}")
    run = open_run(folder)
    generation = last_generation(run) if generation is None else generation
    if group is None and game is None:
        bill = _new_games(run, generation, 20 if games is None else games, 1 if seed is None else seed)
    else:
        bill = _old_games(run, generation, group, game, games, seed)
    if video is not None:
        check_video(video)
    prepare(run.config, lambda text: note(text, quiet=quiet))
    if isinstance(run.config, RunSettings):
        counts, steps, digest = _play_soccer(bill, trace, video)
    elif trace is not None or video is not None:
        raise InputError("--trace and --video show games of soccer; this run is about another game")
    else:
        counts, steps, digest = _play(bill)
    robots = [role.name for role in run.game.roles]
    result: dict[str, Any] = {"games": len(bill.seeds), "generation": generation, **bill.about}
    result |= {name: dict(zip(robots, values.tolist(), strict=True)) for name, values in counts.items()}
    result |= {"digest": digest} if steps is None else {"steps": steps, "digest": digest}
    if as_json:
        emit(result)
        return
    told = "" if steps is None else f", {steps} steps"
    click.echo(f"{bill.said}{told}:")
    rows = [[robot, *(str(values[number]) for values in counts.values())] for number, robot in enumerate(robots)]
    click.echo(table(["robot", *counts], rows))
    for path in (trace, video):
        if path is not None:
            click.echo(f"Written: {path}")


class _Bill(NamedTuple):
    """What is played: which game, trees, seeds and titles; what that is called, in words and as data."""

    game: Game
    trees: list[Tree | None]
    seeds: NDArray[np.uint64]
    titles: list[str]
    name: str
    said: str
    about: dict[str, int]


def _new_games(run: Run, generation: int, games: int, seed: int) -> _Bill:
    from coevo.usage import champions_in_words, play_seeds

    who = champions_in_words(run, generation)
    names = [run.evolving.get(role) for role in range(len(run.game.roles))]
    return _Bill(
        run.game,
        [None if name is None else run.champion_tree(name, generation) for name in names],
        play_seeds(seed, games),
        [f"game {number + 1} of {games}" for number in range(games)],
        f"{run.config.name}: {who}",
        f"{games} games between {who} (seed {seed})",
        {"seed": seed},
    )


def _old_games(
    run: Run, generation: int, group: int | None, game: int | None, games: int | None, seed: int | None
) -> _Bill:
    from coevo.usage import group_trees, seeds_of_group

    if group is None:
        raise InputError(f"--game {game} is one of the games of a group: say which with --group")
    for option, value in (("--seed", seed), ("--games", games)):
        if value is not None:
            raise InputError(
                f"--group plays the games of evolution again, whose seeds and number are the run's; leave out {option}"
            )
    trees, seeds = group_trees(run, generation, group), seeds_of_group(run, generation, group, game)
    name = f"group {group} of generation {generation}"
    return _Bill(
        run.game_of(generation),
        trees,
        seeds,
        [f"game {number}" for number in (range(len(seeds)) if game is None else [game])],
        f"{run.config.name}: {name}",
        f"the {len(seeds)} games of {name}" if game is None else f"game {game} of {name}",
        {"group": group} if game is None else {"group": group, "game": game},
    )


def _play(bill: _Bill) -> tuple[dict[str, NDArray[np.int64]], int | None, str]:
    """Return what was counted of each role in all games together, and a digest of all that happened."""
    from coevo.game import programs_of

    game = bill.game
    played = game.play(programs_of(game, bill.trees), bill.seeds)
    digest = hashlib.sha256(np.ascontiguousarray(played.winner, "<i8").tobytes())
    for name in game.counts:
        digest.update(np.ascontiguousarray(played.counts[name], "<i8").tobytes())
    return {name: played.counts[name].sum(axis=0) for name in game.counts}, None, digest.hexdigest()


def _play_soccer(
    bill: _Bill, trace: Path | None, video: Path | None
) -> tuple[dict[str, NDArray[np.int64]], int | None, str]:
    """Return what was counted as ``_play`` does, the number of steps, and a digest of all trajectories."""
    from coevo.game import SoccerGame, programs_of
    from coevo.replay import game_recording, trace_digest, write_trace, write_video

    game = bill.game
    assert isinstance(game, SoccerGame)
    programs = programs_of(game, bill.trees)
    shown = trace is not None or video is not None
    traces, outcomes = [], []

    def each() -> Iterator[Trace]:
        for seed in bill.seeds:
            outcome, seen = game.arena.trace(programs, seed)
            if not np.isfinite(seen.states).all():
                raise InputError("bodies left the numbers: a setting of the world is too extreme to be played by")
            outcomes.append(game.played(outcome).counts)
            if shown:  # a trace is a tenth of a megabyte
                traces.append(seen)
            yield seen

    digest = trace_digest(each(), len(bill.seeds))
    if shown:
        trees = game.trees_of(bill.trees)
        recording = game_recording(game.settings, traces, trees=trees, name=bill.name, titles=bill.titles)
        if trace is not None:
            write_trace(trace, recording)
        if video is not None:
            write_video(video, recording)
    counts = {name: np.sum([of_game[name][0] for of_game in outcomes], axis=0) for name in game.counts}
    return counts, int(counts.pop("steps")[0]), digest
