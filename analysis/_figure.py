"""Line charts with bands as SVG, which any browser shows: no plotting library is needed."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Line", "line_chart"]

_COLOURS = ("#1d4ed8", "#c2410c", "#047857", "#7c3aed", "#be185d", "#525252")
_WIDTH, _HEIGHT, _LEFT, _RIGHT, _TOP, _BOTTOM = 760, 400, 64, 36, 40, 48
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_TICKS = 6


@dataclass(frozen=True)
class Line:
    """A named line.

    x, y: (points,), broken where y is not a number. low, high: (points,) bounds of a band around it, None for none.
    """

    name: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    low: NDArray[np.float64] | None = None
    high: NDArray[np.float64] | None = None


def _ticks(low: float, high: float) -> list[float]:
    """Return round numbers that part a range."""
    rough = (high - low) / _TICKS
    scale = 10.0 ** np.floor(np.log10(rough))
    step = next(scale * s for s in _STEPS if scale * s >= rough * (1.0 - 1e-9))
    return [float(tick) for tick in np.arange(np.ceil(low / step), np.floor(high / step + 1e-9) + 1) * step]


def _pieces(y: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    """Return where the numbers between those that are none stand."""
    known = np.isfinite(y)
    parts = np.split(np.arange(len(y)), np.flatnonzero(~known))
    return [shown for shown in (part[known[part]] for part in parts) if len(shown)]


def line_chart(
    lines: Sequence[Line], *, title: str, x_label: str, y_label: str, marks: Sequence[tuple[float, str]] = ()
) -> str:
    """Return an SVG picture; ``marks``: places on the x axis where something begins, and its name.

    The y axis begins at 0 unless a line goes below.
    """
    xs = np.concatenate([line.x for line in lines])
    ys = np.concatenate([part for line in lines for part in (line.y, line.low, line.high) if part is not None])
    x_low, x_high = float(xs.min()), float(xs.max())
    y_low, y_high = min(0.0, float(np.nanmin(ys))), float(np.nanmax(ys)) * 1.02
    x_high = x_high if x_high > x_low else x_low + 1.0
    y_high = y_high if y_high > y_low else y_low + 1.0

    def place(x: float, y: float) -> tuple[float, float]:
        across = _LEFT + (x - x_low) / (x_high - x_low) * (_WIDTH - _LEFT - _RIGHT)
        return across, _HEIGHT - _BOTTOM - (y - y_low) / (y_high - y_low) * (_HEIGHT - _TOP - _BOTTOM)

    def points(x: NDArray[np.float64], y: NDArray[np.float64]) -> str:
        pairs = (place(float(a), float(b)) for a, b in zip(x, y, strict=True))
        return " ".join(f"{across:.1f},{down:.1f}" for across, down in pairs)

    def text(across: float, down: float, words: str, anchor: str = "middle", turn: str = "") -> str:
        return f'<text x="{across:.1f}" y="{down:.1f}" text-anchor="{anchor}"{turn}>{html.escape(words)}</text>'

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" font-size="12">',
        "<style>text { font-family: sans-serif }</style>",
        '<rect width="100%" height="100%" fill="white"/>',
        text(0.5 * _WIDTH, 18, title),
        text(0.5 * (_LEFT + _WIDTH), _HEIGHT - 10, x_label),
        text(14, 0.5 * _HEIGHT, y_label, turn=f' transform="rotate(-90 14 {0.5 * _HEIGHT:.0f})"'),
    ]
    for tick in _ticks(y_low, y_high):
        across, down = place(x_low, tick)
        parts.append(f'<path d="M{across:.1f} {down:.1f}H{_WIDTH - _RIGHT}" stroke="#e5e5e5"/>')
        parts.append(text(across - 6, down + 4, f"{tick:g}", "end"))
    for tick in _ticks(x_low, x_high):
        across, down = place(tick, y_low)
        parts.append(text(across, down + 16, f"{tick:g}"))
    for x, name in marks:
        across, _ = place(x, y_low)
        parts.append(f'<path d="M{across:.1f} {_TOP}V{_HEIGHT - _BOTTOM}" stroke="#a3a3a3" stroke-dasharray="4 3"/>')
        parts.append(text(across + 4, _TOP - 4, name, "start"))
    for k, line in enumerate(lines):
        colour = _COLOURS[k % len(_COLOURS)]
        if line.low is not None and line.high is not None:
            around = f"{points(line.x, line.high)} {points(line.x[::-1], line.low[::-1])}"
            parts.append(f'<polygon points="{around}" fill="{colour}" opacity="0.15"/>')
        for piece in _pieces(line.y):
            drawn = points(line.x[piece], line.y[piece])
            parts.append(f'<polyline points="{drawn}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
        down = _TOP + 12 + 16 * k
        parts.append(f'<rect x="{_WIDTH - 170}" y="{down}" width="14" height="4" fill="{colour}"/>')
        parts.append(text(_WIDTH - 150, down + 7, line.name, "start"))
    return "\n".join([*parts, "</svg>", ""])
