"""What all charts share: one look, and one way to a file.

A chart is made of a tidy table that some function returned before; nothing is computed in a chart. altair describes it
in Vega-Lite; vl-convert makes pictures and offline pages of it, without a browser.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import pandas as pd

from coevo.errors import InputError
from coevo.files import write_whole

if TYPE_CHECKING:
    import altair as alt

__all__ = ["COLOURS", "SUFFIXES", "altair", "chart_bytes", "check_out", "line_chart", "save", "spec_of", "theme"]

# Okabe and Ito's, in an order in which neighbours differ in lightness too; black is left out for dark pages.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c8c8c")
SUFFIXES = (".svg", ".png", ".html", ".csv")
_DASHES = ([1, 0], [7, 3], [2, 2])
_SIZE = {"width": 640, "height": 300}  # of a chart of lines
# Right of the legend: fonts elsewhere may be wider than those that are measured here.
_PADDING = {"left": 5, "top": 5, "right": 24, "bottom": 5}
_SCALE = 2.0  # pixels of a PNG for each of the picture's


def altair() -> Any:
    """Return the module, or say how to get it.

    Raises:
        InputError: it is not installed.
    """
    missing = [name for name in ("altair", "vl_convert") if importlib.util.find_spec(name) is None]
    if missing:
        raise InputError(f"charts need {' and '.join(missing)}; install them with: pip install 'coevo[report]'")
    import altair as alt

    alt.data_transformers.disable_max_rows()
    return alt


def theme(*, dark: bool = False) -> dict[str, Any]:
    """Return the look of all charts, as a Vega-Lite config.

    Args:
        dark: for a dark page; the background is then the page's own.
    """
    ink, soft, line = ("#e8ecef", "#a3afb8", "#3a444b") if dark else ("#14191d", "#56616a", "#d9dee2")
    titles = {"titleColor": ink, "labelColor": soft, "labelFontSize": 11, "titleFontSize": 12}
    return {
        "background": "transparent" if dark else "white",
        "font": "sans-serif",
        "view": {"stroke": None},
        "axis": {**titles, "gridColor": line, "domainColor": soft, "tickColor": soft, "titleFontWeight": "normal"},
        "legend": {**titles, "labelFontSize": 12, "symbolStrokeWidth": 3, "symbolOpacity": 1.0},
        "header": {"labelColor": ink, "titleColor": ink, "labelFontSize": 12, "titleFontSize": 12},
        "title": {"color": ink, "subtitleColor": soft, "fontSize": 13, "fontWeight": "bold", "anchor": "start"},
        "text": {"color": ink},
        "range": {"category": list(COLOURS)},
        "line": {"strokeWidth": 1.8},
    }


def spec_of(chart: alt.TopLevelMixin) -> dict[str, Any]:
    """Return a chart as Vega-Lite, without a look."""
    spec: dict[str, Any] = chart.to_dict()
    spec.pop("config", None)
    return spec


def line_chart(
    table: pd.DataFrame, *, x: str, y: str, by: str, titles: tuple[str, str, str], marks: pd.DataFrame | None = None
) -> alt.LayerChart:
    """Return a chart of lines, broken where there is no number, with bands if the table has ``low`` and ``high``.

    Where there are more lines than colours, the second ones of a colour are dashed, the third ones dotted.

    Args:
        table: tidy. x, y, by: its columns; a line each value of ``by``.
        titles: of the chart, of the x axis and of the y axis.
        marks: places on the x axis where something begins, in a column of its name, and what it is in the next. Where a
            column ``kind`` says ``axis``, lines are coloured, and words a line lower.

    Raises:
        InputError: altair is not installed.
    """
    vega = altair()
    title, x_title, y_title = titles
    names = list(dict.fromkeys(table[by]))
    colours = [COLOURS[number % len(COLOURS)] for number in range(len(names))]
    dashes = [_DASHES[number // len(COLOURS) % len(_DASHES)] for number in range(len(names))]
    legend = vega.Legend(title=None, symbolType="stroke", symbolSize=300, symbolOpacity=1, labelLimit=300)
    colour = vega.Color(f"{by}:N", scale=vega.Scale(domain=names, range=colours), legend=legend, sort=None)
    look = {"color": colour}
    if len(names) > len(COLOURS):
        look["strokeDash"] = vega.StrokeDash(
            f"{by}:N", scale=vega.Scale(domain=names, range=dashes), legend=legend, sort=None
        )
    whole_numbers = {"tickMinStep": 1, "format": ",d"} if pd.api.types.is_integer_dtype(table[x]) else {}
    axis = vega.Axis(grid=False, tickCount=8, **whole_numbers)
    across = vega.X(f"{x}:Q", title=x_title, axis=axis, scale=vega.Scale(nice=False, zero=False))

    def up(column: str) -> Any:
        return vega.Y(f"{column}:Q", title=y_title)

    layers = []
    if "low" in table and bool((table["low"] < table["high"]).any()):
        bands = vega.Chart(table).mark_area(opacity=0.15)
        layers.append(bands.encode(x=across, y=up("low"), y2="high:Q", color=colour))
    layers.append(vega.Chart(table).mark_line().encode(x=across, y=up(y), **look))
    if marks is not None and len(marks):
        place, name = marks.columns[:2]
        at = vega.X(f"{place}:Q", title=x_title)
        is_axis = marks["kind"] == "axis" if "kind" in marks else marks[place].isna()
        for part, rule, word, down in ((~is_axis, "#8c8c8c", "#666666", -2), (is_axis, COLOURS[1], COLOURS[1], 12)):
            if part.any():
                base = vega.Chart(marks[part])
                layers.append(base.mark_rule(color=rule, strokeDash=[4, 3]).encode(x=at))
                words = base.mark_text(align="left", baseline="bottom", dx=3, dy=down, color=word)
                layers.append(words.encode(x=at, y=vega.value(0), text=f"{name}:N"))
    whole = vega.layer(*layers).properties(title=vega.TitleParams(title, offset=18), padding=_PADDING, **_SIZE)
    return cast("alt.LayerChart", whole)


def check_out(path: Path, suffixes: Sequence[str] = SUFFIXES) -> None:
    """Refuse a file that cannot be written, before the work that leads to it.

    Raises:
        InputError: its suffix is unknown, or there is no folder for it.
    """
    if path.suffix.lower() not in suffixes:
        raise InputError(f"expected a file ending in {', '.join(suffixes)}, got {path.name!r}")
    if path.is_dir():
        raise InputError(f"cannot write {path}: it is a folder; give the name of a file in it")
    if not path.parent.is_dir():
        raise InputError(f"cannot write {path}: there is no folder {path.parent}; make it first")


def chart_bytes(chart: alt.TopLevelMixin, suffix: str) -> bytes:
    """Return a chart as SVG, PNG or one offline HTML page.

    Args:
        chart: of altair.
        suffix: ``.svg``, ``.png`` or ``.html``.
    """
    altair()
    import vl_convert

    spec = {**spec_of(chart), "config": theme()}
    if suffix == ".png":
        png: bytes = vl_convert.vegalite_to_png(spec, scale=_SCALE)
        return png
    if suffix == ".html":
        return str(vl_convert.vegalite_to_html(spec, bundle=True)).encode()
    return _renumbered(str(vl_convert.vegalite_to_svg(spec))).encode()


def _renumbered(svg: str) -> str:
    """Return a picture whose clip paths are numbered from 1: Vega goes on counting from one picture to the next."""
    old = dict.fromkeys(re.findall(r'id="(clip\d+)"', svg))
    new = {name: f"clip{number}" for number, name in enumerate(old, start=1)}
    return re.sub(r'(id="|url\(#)(clip\d+)', lambda found: found[1] + new[found[2]], svg)


def save(chart: alt.TopLevelMixin | None, table: pd.DataFrame, path: Path) -> None:
    """Write a chart, or the table behind it, by the suffix of the file: whole or not at all.

    Args:
        chart: of altair; None if it is only the table that is written, which needs no altair.
        table: what ``.csv`` holds.
        path: ends in one of ``SUFFIXES``.

    Raises:
        InputError: the suffix is unknown, or the file cannot be written.
    """
    check_out(path)
    suffix = path.suffix.lower()
    if suffix == ".csv":
        data = table.to_csv(index=False).encode()
    else:
        assert chart is not None
        data = chart_bytes(chart, suffix)
    try:
        write_whole(path, data)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
