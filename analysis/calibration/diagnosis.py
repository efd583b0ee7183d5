"""How often the diagnosis errs: on matrices it was tuned on, on others, and on games whose dynamics are known."""

from __future__ import annotations

from collections import Counter
from typing import Any

import click

from analysis.calibration.dynamics import SETS, cases
from analysis.progress import LABELS, diagnose
from coevo.console import Progress, output_options, show, table
from coevo.statistics import share_interval

__all__ = ["confusion", "diagnosis"]


def confusion(which: str, kind: str, count: int, *, seed: int) -> dict[str, Any]:
    """Diagnose matrices of one kind and count the answers.

    Args:
        which: of `analysis.calibration.dynamics.SETS`; kind, count, seed: as in `cases`.

    Returns:
        ``set``, ``kind``, ``cases``; ``named`` and ``alone``: share of cases whose labels have the kind, and have it
        only, with their 95 % intervals; ``labels``: how often each set of labels was given; ``families``: for each
        form its cases and those with the kind alone.
    """
    answers: Counter[str] = Counter()
    families: dict[str, list[int]] = {}
    named = alone = 0
    for family, wins in cases(which, kind, count, seed=seed):
        labels = diagnose(wins).labels
        answers[" + ".join(label for label in LABELS if label in labels)] += 1
        named += kind in labels
        alone += labels == {kind}
        of_family = families.setdefault(family, [0, 0])
        of_family[0] += 1
        of_family[1] += labels == {kind}
    return {
        "set": which,
        "kind": kind,
        "cases": count,
        "named": [named / count, *share_interval(named, count)],
        "alone": [alone / count, *share_interval(alone, count)],
        "labels": dict(answers.most_common()),
        "families": {name: {"cases": total, "alone": right} for name, (total, right) in families.items()},
    }


@click.command()
@click.option(
    "--cases", "count", type=click.IntRange(min=1), default=200, show_default=True, help="Matrices of each kind."
)
@click.option("--seed", type=click.IntRange(min=0, max=2**63 - 1), default=1, show_default=True)
@output_options
def diagnosis(*, count: int, seed: int, as_json: bool, quiet: bool) -> None:
    """Print how often the diagnosis of a run names the dynamics of matrices that are known.

    \b
    Example: coevo reproduce diagnosis
             coevo reproduce diagnosis --cases 50 --seed 2
    """
    data: list[dict[str, Any]] = []
    with Progress(len(SETS) * len(LABELS), quiet=quiet) as progress:
        for which in SETS:
            for kind in LABELS:
                data.append(confusion(which, kind, count, seed=seed))
                progress.step(f"{which}: {kind}", done=len(data))
    rows = []
    for found in data:
        wrong = [f"{labels} {times}" for labels, times in found["labels"].items() if labels != found["kind"]]
        shares = ["{:.3f} [{:.3f}, {:.3f}]".format(*found[what]) for what in ("named", "alone")]
        rows.append([found["set"], found["kind"], str(found["cases"]), *shares, ", ".join(wrong)])
    header = ["matrices", "kind", "cases", "named [95 %]", "named alone [95 %]", "otherwise"]
    show({"seed": seed, "kinds": data}, table(header, rows), as_json=as_json)
