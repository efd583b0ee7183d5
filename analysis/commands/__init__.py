"""Commands that read runs; each hangs on ``coevo`` by an entry point."""

from analysis.commands.tournament import tournament

__all__ = ["tournament"]
