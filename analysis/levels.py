"""The levels of an environment that co-evolves (6.5), generation by generation."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import pandas as pd

from analysis.charts import altair
from coevo.complexity import values_at
from coevo.errors import InputError
from coevo.folder import read_lines
from coevo.levels import level_lines
from coevo.run import Run

if TYPE_CHECKING:
    import altair as alt

__all__ = ["level_chart", "level_table", "level_words"]


def level_table(run: Run) -> pd.DataFrame:
    """Return ``levels.csv`` without its last row, which tells the end: a row a finished generation.

    Raises:
        InputError: it cannot be read, or the run has no levels.
    """
    path = run.path / "levels.csv"
    try:
        lines = read_lines(path)
        wanted = level_lines(run.config, run.game, run.level_records(run.finished))
        if lines[: len(wanted)] != wanted:
            remedy = f"delete it; 'coevo resume {run.path}' makes it anew"
            raise InputError(f"{path} is damaged: its rows are not those that were written; {remedy}")
        table = pd.read_csv(io.StringIO("\n".join(wanted)))
    except (ValueError, OSError) as error:
        raise InputError(f"cannot read {path}: {error}") from None
    return table[table["event"] != "end"]


def level_words(run: Run, table: pd.DataFrame) -> str:
    """Return in a sentence how far the levels came, and what is played on which.

    Args:
        run: with levels.
        table: of ``level_table``.
    """
    levels = run.config.levels
    assert levels is not None
    last = int(table["level"].iloc[-1])
    moves = [f"{word} {int((table['event'] == word).sum())} times" for word in ("raised", "lowered")]
    values = ", ".join(f"{key} = {value}" for key, value in values_at(levels, last).items())
    return (
        f"The levels of evolution ended at {last} of 0 to {levels.levels - 1} ({values}): {' and '.join(moves)}. What"
        " trees did in evolution, and champions that play again, are on the level of their generation; contests,"
        " tournaments and games to watch are played by the recipe's own settings."
    )


def level_chart(table: pd.DataFrame) -> alt.TopLevelMixin:
    """Return a chart of the level, and below it the shares of decided games that each team won.

    Args:
        table: of ``level_table``.

    Raises:
        InputError: altair is not installed.
    """
    vega = altair()
    x = vega.X("generation:Q", title="generation", axis=vega.Axis(tickMinStep=1))
    size = {"width": 460, "height": 120}
    level = vega.Y("level:Q", title="level", axis=vega.Axis(tickMinStep=1))
    steps = vega.Chart(table[["generation", "level"]]).mark_line(interpolate="step", point=True).encode(x=x, y=level)
    won = [name for name in table.columns if name.startswith("won_")]
    long = table.melt("generation", won, "team", "share").dropna()
    long["team"] = "team " + long["team"].str.removeprefix("won_")
    share = vega.Y("share:Q", title="decided games won", axis=vega.Axis(format=".0%"), scale=vega.Scale(domain=[0, 1]))
    lines = vega.Chart(long).mark_line().encode(x=x, y=share, color=vega.Color("team:N", title=None))
    chart: alt.TopLevelMixin = vega.vconcat(steps.properties(**size), lines.properties(**size)).resolve_scale(
        x="shared"
    )
    return chart
