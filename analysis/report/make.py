"""From runs to a page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from analysis.report.gather import find_out
from analysis.report.one import sections_of, title_of
from analysis.report.page import render
from analysis.report.words import in_short
from coevo.evolution.evaluation import Evaluator
from coevo.game import prepare
from coevo.run import Run

__all__ = ["make_report"]


def make_report(
    runs: Sequence[Run], *, workers: int, backend: str, tell: Callable[[str], None]
) -> tuple[str, dict[str, Any]]:
    """Return the page about one run, or that compares several, and what it says in short as data.

    Args:
        runs: each with a finished generation.
        workers, backend: of the games that are played for it.
        tell: receives lines about what is being done.

    Raises:
        InputError: a run has no finished generation, or a chart cannot be made.
    """
    (run,) = runs
    prepare(run.config, tell)
    with Evaluator(run.config, workers=workers, backend=backend, folders=run.folders) as evaluator:
        findings = find_out(run, evaluator, tell)
    tell("Drawing ...")
    title, under = title_of(run)
    short = in_short(run, findings.judged, findings.diagnoses, findings.left)
    return render(title, under, sections_of(findings, ""), f"Made by coevo from {run.path}."), {"short": short}
