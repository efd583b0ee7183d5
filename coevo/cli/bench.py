"""coevo bench."""

from __future__ import annotations

import click

from coevo.console import emit, note, output_options, table

__all__ = ["bench"]


@click.command()
@click.option(
    "--games",
    type=click.IntRange(min=4),
    default=60,
    show_default=True,
    help="How many compiled games to time.",
)
@click.option("--plain-games", type=click.IntRange(min=1), default=3, show_default=True, help="How many plain games.")
@click.option(
    "--bookkeeping",
    "generations",
    type=click.IntRange(min=1, max=50),
    help="Instead: what of so many generations of each preset, at full size, is not games.",
)
@output_options
def bench(*, games: int, plain_games: int, generations: int | None, as_json: bool, quiet: bool) -> None:
    """Measure the speed of games on this machine, as ratios within one run.

    \b
    Example: coevo bench --games 200
             coevo bench --bookkeeping 2
    """
    from coevo.bench import PRESETS, bookkeeping, measure

    if generations is not None:
        shares: dict[str, dict[str, float]] = {}
        for name in PRESETS:
            note(f"Evolving {name}, generations 0 to {generations} ...", quiet=quiet)
            shares |= bookkeeping([name], generations)
        if as_json:
            emit(shares)
        else:
            click.echo(_bookkeeping(shares))
        return
    result = measure(games, plain_games, tell=lambda text: note(text, quiet=quiet))
    if as_json:
        emit(result)
        return
    for label, text in (
        ("compiled games", "{games_per_second:10.1f} games/s on one core, {microseconds_per_step:.2f} us a step"),
        ("their physics alone", "{pure_physics_microseconds_per_step:10.2f} us a step"),
        ("a whole game costs", "{ratio_to_pure_physics:10.2f} times its physics"),
        ("plain pymunk + OpenCV", "{plain_loop_games_per_second:10.3f} games/s"),
        ("compiled games are", "{speedup_over_plain_loop:10.0f} times as fast as that"),
        ("two workers are", "{two_workers_speedup:10.2f} times as fast as one"),
        ("variation and files", "{bookkeeping_share:10.1%} of a generation at full size"),
        ("compiling anew takes", "{compiling_cpu_seconds:10.1f} CPU seconds"),
        ("start from the cache", "{cached_start_seconds:10.2f} s until games can begin"),
    ):
        click.echo(f"{label:22s} {text.format(**result)}")


def _bookkeeping(shares: dict[str, dict[str, float]]) -> str:
    """Return what of a generation is not games, a line a preset."""
    header = ["of a generation", "games [CPU s]", "the rest [CPU s]", "share", "with two workers", "the rest [s]"]
    rows = [
        [
            name,
            f"{of['games_cpu_seconds']:.2f}",
            f"{of['other_cpu_seconds']:.3f}",
            f"{of['share']:.1%}",
            f"{of['share_of_two_workers']:.1%}",
            f"{of['other_seconds']:.3f}",
        ]
        for name, of in shares.items()
    ]
    return f"{table(header, rows)}\n(the rest: breeding, scoring and files; CPU time within one process)"
