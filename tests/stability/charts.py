"""Line chart as SVG, for the report: a band, the expected value, and series over steps."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from catoptra_protocol.optics.numerics import Floats

_WIDTH, _HEIGHT, _LEFT, _BOTTOM = 460, 220, 30, 24


def line_chart(series: Mapping[str, Floats], *, band: tuple[float, float], expected: float) -> str:
    """SVG of (n,) series by CSS colour, on axes that start at 0."""
    steps = len(next(iter(series.values())))
    top = float(np.ceil(1.08 * max(values.max() for values in series.values())))
    low, high = (_y(value, top) for value in band)
    grid = "".join(_grid_line(value, top) for value in np.linspace(0.0, top, 5))
    lines = "".join(
        f'<polyline fill="none" stroke="{colour}" stroke-width="1.8" stroke-linejoin="round" '
        f'points="{_points(values, top)}"/>'
        for colour, values in series.items()
    )
    return (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" width="100%" role="img">{grid}'
        f'<rect x="{_LEFT}" y="{high:.1f}" width="{_WIDTH - _LEFT}" height="{low - high:.1f}" '
        'fill="#2e6fbb" opacity="0.13"/>'
        f'<line x1="{_LEFT}" x2="{_WIDTH}" y1="{_y(expected, top):.1f}" '
        f'y2="{_y(expected, top):.1f}" stroke="#2e6fbb" stroke-dasharray="3 3" opacity="0.7"/>'
        f'{lines}<text x="{_LEFT}" y="{_HEIGHT - 6}">step 1</text>'
        f'<text x="{_WIDTH}" y="{_HEIGHT - 6}" text-anchor="end">step {steps}</text></svg>'
    )


def _grid_line(value: float, top: float) -> str:
    y = _y(value, top)
    return (
        f'<line x1="{_LEFT}" x2="{_WIDTH}" y1="{y:.1f}" y2="{y:.1f}" stroke="#e9ebef"/>'
        f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>'
    )


def _points(values: Floats, top: float) -> str:
    x = np.linspace(_LEFT, _WIDTH - 2, len(values))
    return " ".join(f"{a:.1f},{_y(float(b), top):.1f}" for a, b in zip(x, values, strict=True))


def _y(value: float, top: float) -> float:
    return 8.0 + (1.0 - value / top) * (_HEIGHT - _BOTTOM - 8.0)
