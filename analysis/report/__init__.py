"""One offline page about a run, or about several."""

from analysis.report.make import make_report

__all__ = ["make_report"]
