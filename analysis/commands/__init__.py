"""Commands that read runs; each hangs on ``coevo`` by an entry point."""

from analysis.commands.ancestry import ancestry
from analysis.commands.baselines import baselines
from analysis.commands.curves import curves
from analysis.commands.report import report
from analysis.commands.settlements import settlements
from analysis.commands.tournament import tournament

__all__ = ["ancestry", "baselines", "curves", "report", "settlements", "tournament"]
