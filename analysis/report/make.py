"""From runs to a page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from analysis.report.gather import find_out
from analysis.report.one import sections_of, title_of
from analysis.report.page import render
from analysis.report.several import compare, sections_of_several
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
    made = "Made by coevo. Everything on this page is in it: nothing is loaded from elsewhere."
    for run in runs:
        prepare(run.config, tell)
    if len(runs) > 1:
        compared = compare(runs, workers=workers, backend=backend, tell=tell)
        tell("Drawing ...")
        sections, short = sections_of_several(compared)
        title = f"{len(runs)} runs: {', '.join(dict.fromkeys(compared.groups.values()))}"
        return render(title, ", ".join(compared.names), sections, made), {"runs": len(runs), "short": short}
    (run,) = runs
    with Evaluator(run.config, workers=workers, backend=backend, folders=run.folders) as evaluator:
        findings = find_out(run, evaluator, tell)
    tell("Drawing ...")
    title, under = title_of(run)
    short = in_short(run, findings.judged, findings.dynamics, findings.left)
    return render(title, under, sections_of(findings), made), {"runs": 1, "short": short}
