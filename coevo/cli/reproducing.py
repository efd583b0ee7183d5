"""coevo reproduce: the tables and figures of the documentation, made again."""

from __future__ import annotations

import click

from coevo.cli.plugins import PluggedGroup

__all__ = ["reproduce"]


@click.group(cls=PluggedGroup, entry_points="coevo.reproduce")
def reproduce() -> None:
    """Make a table or a figure of the documentation again.

    \b
    Example: coevo reproduce skills --seeds 2
             coevo reproduce chapter3 chapter3/short --sets 2 --out runs/short
             coevo reproduce chapter3-report runs/short
    """
