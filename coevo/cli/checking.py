"""coevo check."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from coevo.console import output_options, show
from coevo.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from coevo.soundness import Finding

__all__ = ["check"]


@click.command()
@click.argument("folders", nargs=-1, required=True, metavar="DIR...", type=click.Path(path_type=Path))
@output_options
def check(*, folders: tuple[Path, ...], as_json: bool, quiet: bool) -> None:
    """Tell whether all files of a run are as they were written, of a study whether those of all its runs are.

    The exit code is 0 if they are, and 1 if something is damaged, was changed or is lost.

    \b
    Example: coevo check runs/smoke-seed0
             coevo check runs/my-study --json
    """
    del quiet
    runs = list(_runs(folders))
    findings = [(path, finding) for path in runs for finding in _findings(path)]
    findings += [(path, finding) for path in folders if path not in runs for finding in _of_study(path)]
    wrong = [(path, finding) for path, finding in findings if finding.state == "damaged"]
    lacking = [(path, finding) for path, finding in findings if finding.state == "missing"]
    data = {
        "sound": not wrong,
        "runs": len(runs),
        "files": [{"run": str(path), **finding._asdict()} for path, finding in findings],
    }
    lines = [f"{of.state:8s} {path / of.name}{of.why and ': '}{of.why}" for path, of in [*wrong, *lacking]]
    said = f"{len(findings)} files of {len(runs)} run{'s' * (len(runs) != 1)}: "
    said += f"{len(wrong)} are damaged" if wrong else "all sound" if not lacking else "none is damaged"
    said += f", {len(lacking)} are missing and are made anew when they are needed" if lacking else ""
    show(data, "\n".join([*lines, said]), as_json=as_json)
    if wrong:
        raise click.exceptions.Exit(1)


def _runs(folders: tuple[Path, ...]) -> Iterator[Path]:
    """Yield the folders of runs and skills, of studies those within."""
    for folder in folders:
        kinds = "config.toml", "skill.npz", "team.json", "set.json"
        inner = [path.parent for kind in kinds for path in sorted(folder.glob(f"*/{kind}"))]
        inner = inner or [path.parent for path in sorted(folder.glob("*/*/set.json"))]
        if any((folder / kind).exists() for kind in kinds) or not inner:
            yield folder
        else:
            yield from inner


def _of_study(path: Path) -> list[Finding]:
    from coevo.study.folder import STUDY, check_study

    return check_study(path) if (path / STUDY).exists() else []


def _findings(path: Path) -> list[Finding]:
    from coevo.run import open_run
    from coevo.soundness import SUMMARIES, Finding, check_run, check_skill, check_summary
    from coevo.study.sets import check_set

    if not (path / "config.toml").exists() and (path / "skill.npz").exists():
        return check_skill(path)
    if (path / "set.json").exists():
        return check_set(path)
    for name in SUMMARIES:
        if (path / name).exists():
            return check_summary(path / name)
    try:
        run = open_run(path, altered=True)
    except InputError as error:
        if not (path / "config.toml").exists():
            raise
        return [Finding("config.toml", "damaged", str(error))]
    return check_run(run)
