"""coevo report."""

from __future__ import annotations

from pathlib import Path

import click

from coevo.console import note, output_options, show, worker_options

__all__ = ["report"]


@click.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="By default report.html, in the run's folder; of several runs, in the current one.",
)
@worker_options
@output_options
def report(
    *, folders: tuple[Path, ...], out: Path | None, workers: int, backend: str, as_json: bool, quiet: bool
) -> None:
    """Write one offline page about a run: what came of it, curves, progress, trees, ancestry, games to watch.

    Several runs are compared: those that differ in the seed alone are one group.

    \b
    Example: coevo report runs/three-learners-seed0
             coevo report runs/three-learners-seed* --out comparison.html
    """
    from analysis.charts import altair, check_out
    from analysis.groups import open_runs
    from analysis.report import make_report
    from coevo.errors import InputError
    from coevo.evolution.evaluation import check_backend
    from coevo.files import write_whole

    check_backend(backend)
    altair()
    runs = open_runs(folders)
    path = out or (runs[0].path / "report.html" if len(runs) == 1 else Path("report.html"))
    check_out(path, (".html", ".htm"))
    page, told = make_report(runs, workers=workers, backend=backend, tell=lambda text: note(text, quiet=quiet))
    try:
        write_whole(path, page.encode())
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}; choose another --out") from None
    show({"report": str(path), **told}, "\n\n".join([*told["short"], f"Written: {path}"]), as_json=as_json)
