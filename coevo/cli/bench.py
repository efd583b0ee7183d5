"""coevo bench."""

from __future__ import annotations

import click

from coevo.console import emit, note, output_options

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
@output_options
def bench(*, games: int, plain_games: int, as_json: bool, quiet: bool) -> None:
    """Measure the speed of games on this machine, as ratios within one run.

    \b
    Example: coevo bench --games 200
    """
    from coevo.bench import measure

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
