"""Commands that other packages add as entry points, so that coevo itself never imports behaviors or analysis."""

from __future__ import annotations

import importlib.metadata
from typing import Any

import click

from coevo.errors import InputError, nearest_name

__all__ = ["PluggedGroup"]


class PluggedGroup(click.Group):
    """Commands of its own, and those that packages add as entry points.

    Args:
        entry_points: the name of the group of entry points.
        **settings: those of ``click.Group``.
    """

    def __init__(self, *args: Any, entry_points: str, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self._entry_points = entry_points

    def _added(self) -> importlib.metadata.EntryPoints:
        return importlib.metadata.entry_points(group=self._entry_points)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands, its own first."""
        own = super().list_commands(ctx)
        return [*own, *sorted({point.name for point in self._added()} - set(own))]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command by its name, loaded from where it is."""
        command = super().get_command(ctx, cmd_name)
        if command is None:
            for point in self._added():
                if point.name == cmd_name:
                    loaded: click.Command = point.load()
                    return loaded
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that is asked for.

        Raises:
            InputError: there is no such command; the nearest is offered.
        """
        if args and not args[0].startswith("-") and self.get_command(ctx, args[0]) is None:
            known = self.list_commands(ctx)
            name = " ".join([*ctx.command_path.split()[1:], args[0]])
            raise InputError(
                f"there is no command {name!r}.{nearest_name(args[0], known)} Commands: {', '.join(known)}"
            )
        return super().resolve_command(ctx, args)
