"""coevo ancestry."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from coevo.console import note, output_options, show, table

if TYPE_CHECKING:
    from analysis.ancestry import Ancestry

__all__ = ["ancestry"]


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--robot", default=None, help="Which robot; by default the first that evolves.")
@click.option("--generation", type=click.IntRange(min=0), help="By default the last that is finished.")
@click.option("--rank", type=click.IntRange(min=0), help="0 is the best.  [default: the champion]")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Write a picture (.svg, .png, .html), or the table of all ancestors (.csv).",
)
@output_options
def ancestry(
    *,
    folder: Path,
    robot: str | None,
    generation: int | None,
    rank: int | None,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Show where a tree of a run came from: its ancestors, and when each of its nodes came into being.

    By default that of the champion: the best of the last generation, or the one that was chosen once more.

    \b
    Example: coevo ancestry runs/smoke-seed0 --robot r1
             coevo ancestry runs/smoke-seed0 --out family.svg
    """
    from analysis.ancestry import ancestors, sentences, summary
    from analysis.charts import altair, check_out
    from coevo.game import prepare
    from coevo.run import open_run
    from coevo.usage import used_tree

    if out is not None:
        check_out(out)
        if out.suffix.lower() != ".csv":
            altair()
    run = open_run(folder)
    prepare(run.config, lambda text: note(text, quiet=quiet))
    used = used_tree(run, robot, generation, rank)
    found = ancestors(run, used.robot, used.generation, used.index, node_steps=used.usage.node_steps)
    if out is not None:
        _write(out, found)
    told = summary(found)
    rows = [
        [f"{of['operator']} in generation {of['generation']}", str(of["nodes"]), str(of["in_use"]), f"{of['use']:.1%}"]
        for of in told["origins"]
    ]
    shown = table(["its nodes came from", "nodes", "in use", "share of use"], rows)
    written = "" if out is None else f"\n\nWritten: {out}"
    text = "\n".join([*sentences(told, used.rank, used.again), "", shown]) + written
    again = None if used.again is None else used.again[0]
    show({"run": str(run.path), "rank": used.rank, "fitness_again": again, **told}, text, as_json=as_json)


def _write(out: Path, found: Ancestry) -> None:
    from analysis.charts import save

    if out.suffix.lower() == ".csv":
        save(None, found.ancestors, out)
        return
    from analysis.ancestry.charts import ancestry_chart

    save(ancestry_chart(found), found.ancestors, out)
