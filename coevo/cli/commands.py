"""All commands, and what each way to end is told as."""

from __future__ import annotations

import os
import sys
from contextlib import suppress

import click

from coevo.cli.bench import bench
from coevo.cli.checking import check
from coevo.cli.evolving import evolve, resume
from coevo.cli.plugins import PluggedGroup
from coevo.cli.reproducing import reproduce
from coevo.cli.showing import inspect, play
from coevo.cli.studying import study
from coevo.errors import InputError

__all__ = ["cli", "run"]


@click.group(
    cls=PluggedGroup,
    entry_points="coevo.commands",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="coevo")
def cli() -> None:
    """Co-evolve teams of robots: trees that choose among learned skills, tried out in vision-based soccer.

    \b
    Begin with:
      coevo evolve smoke
      coevo report runs/smoke-seed0
      coevo inspect runs/smoke-seed0
      coevo play runs/smoke-seed0 --video game.html
    """


for _command in (evolve, resume, check, study, inspect, play, bench, reproduce):
    cli.add_command(_command)


def run() -> None:
    """Run the command line; the exit code is 0 done, 1 failed, 2 wrong input, 130 stopped."""
    try:
        code = cli.main(prog_name="coevo", standalone_mode=False)  # what Exit was raised with is returned
        if isinstance(code, int) and code:
            sys.exit(code)
    except InputError as error:
        click.echo(f"coevo: {error}", err=True)
        sys.exit(2)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        sys.exit(2)
    except click.ClickException as error:
        hint = ""
        if isinstance(error, click.UsageError) and error.ctx is not None:
            hint = f" See '{error.ctx.command_path} --help'."
        click.echo(f"coevo: {error.format_message()}{hint}", err=True)
        sys.exit(2)
    except click.Abort:
        raise KeyboardInterrupt from None
    except BrokenPipeError:  # the reader of our output has gone, such as 'head'
        _drop_output()
        sys.exit(1)
    except OSError as error:
        click.echo(f"coevo: cannot write the output: {error.strerror or error}", err=True)
        _drop_output()
        sys.exit(1)


def _drop_output() -> None:
    """Let Python end without trying once more to write what cannot be written."""
    with suppress(OSError, ValueError):  # it is closed, or no file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
