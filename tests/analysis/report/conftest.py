"""Runs whose reports are looked at."""

from __future__ import annotations

import pytest

from analysis.report import make_report
from coevo.run import create_run


@pytest.fixture(scope="session")
def eight_generations(small_settings, go_on, tmp_path_factory):
    """Return a finished run of eight generations, enough for a diagnosis; only to be read."""
    settings = small_settings("gp.generations=8", "seed=4")
    return go_on(create_run(tmp_path_factory.mktemp("eight") / "run", settings))


@pytest.fixture(scope="session")
def reported(eight_generations, tmp_path_factory):
    """Return the file of a report of one run, and what it says in short."""
    page, told = make_report([eight_generations], workers=2, backend="threads", tell=lambda _: None)
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(page, encoding="utf-8")
    return path, told


@pytest.fixture(scope="session")
def compared(small_settings, go_on, tmp_path_factory):
    """Return the file of a report of four runs in two groups, what it says in short, and the runs."""
    folder = tmp_path_factory.mktemp("four")
    runs = [
        go_on(create_run(folder / f"{kind}-{seed}", small_settings(f"seed={seed}", f"fitness.kind={kind}")))
        for kind in ("fixed", "varying")
        for seed in (0, 1)
    ]
    page, told = make_report(runs, workers=2, backend="threads", tell=lambda _: None)
    path = folder / "report.html"
    path.write_text(page, encoding="utf-8")
    return path, told, runs
