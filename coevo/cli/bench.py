"""coevo bench."""

from __future__ import annotations

import click

from coevo.console import emit, note, output_options

__all__ = ["bench"]


@click.command()
@click.option("--games", type=click.IntRange(min=4), default=60, show_default=True, help="How many compiled games to time.")
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
    r = result
    click.echo(f"compiled games          {r['games_per_second']:10.1f} games/s on one core, {r['microseconds_per_step']:.2f} us a step")
    click.echo(f"their physics alone     {r['pure_physics_microseconds_per_step']:10.2f} us a step: a game costs {r['ratio_to_pure_physics']:.2f} times that")
    click.echo(f"plain pymunk + OpenCV   {r['plain_loop_games_per_second']:10.3f} games/s: compiled is {r['speedup_over_plain_loop']:.0f} times as fast")
    click.echo(f"two workers             {r['two_workers_speedup']:10.2f} times as fast as one")
    click.echo(f"variation and files     {r['bookkeeping_share']:10.1%} of a generation at full size")
    click.echo(f"start from the cache    {r['cached_start_seconds']:10.2f} s until games can begin")
