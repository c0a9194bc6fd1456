"""Change of a cell of 2 x 2 pixels by motion, over the largest second difference of sharp pixels
around: what `render/trace/kernel/src/blur_plan.c` takes for a bound.

Run: .venv/bin/python tests/measurements/even_slopes.py [PATTERNS=4000]

Edges, ramps, corners and lines of 0.3 to 3 px of any direction and place are seen by 2 x 2 or 3 x 3
samples a pixel, and move by up to 3 px and a part of a sample, as much before as after.
"""

from __future__ import annotations

import sys

import numpy as np

from catoptra_protocol.optics.numerics import Floats

INSTANTS = 65


def draw_pattern(rng: np.random.Generator, x: Floats, y: Floats) -> Floats:
    """Light at places, in pixels from the middle of the cell, of a random pattern from 0 to 1."""
    kind = rng.integers(4)
    turn, other = rng.uniform(0.0, 2.0 * np.pi, 2)
    offsets = rng.uniform(-3.0, 3.0, 2)
    first = x * np.cos(turn) + y * np.sin(turn) + offsets[0]
    second = x * np.cos(other) + y * np.sin(other) + offsets[1]
    light: Floats = (first > 0.0).astype(np.float64)
    if kind == 1:
        light = np.clip(first / rng.uniform(0.3, 6.0), 0.0, 1.0)
    elif kind == 2:
        light = light * (second > 0.0)
    elif kind == 3:
        light = (np.abs(first) < 0.5 * rng.uniform(0.3, 3.0)).astype(np.float64)
    return light


def find_ratio(rng: np.random.Generator) -> float:
    """Largest change of the cell over the largest second difference around; 0 without a change."""
    samples = int(rng.integers(2, 4))
    length, way = rng.uniform(0.0, 3.0 + 1.0 / samples), rng.uniform(0.0, 2.0 * np.pi)
    # Pixels around the cell of which differences are taken.
    reach = 1 if 0.5 * length + 0.5 * (samples - 1) / samples <= 1.0 else 2
    side = 2 + 2 * reach
    within = (np.arange(side * samples) + 0.5) / samples - 0.5 * side
    y, x = np.meshgrid(within, within, indexing="ij")
    seed = int(rng.integers(2**31))
    phases = np.linspace(-0.5, 0.5, INSTANTS)
    weights = np.r_[0.5, np.ones(INSTANTS - 2), 0.5] / (INSTANTS - 1)

    def see(phase: float) -> Floats:
        moved = phase * length * np.cos(way), phase * length * np.sin(way)
        light = draw_pattern(np.random.default_rng(seed), x + moved[0], y + moved[1])
        pixels: Floats = light.reshape(side, samples, side, samples).mean(axis=(1, 3))
        return pixels

    sharp = see(0.0)
    blurred: Floats = np.tensordot(weights, np.stack([see(phase) for phase in phases]), axes=1)
    middle, inner = slice(reach, reach + 2), sharp[1:-1, 1:-1]
    change = np.abs(blurred - sharp)[middle, middle].max()
    pairs = (
        sharp[1 + i : side - 1 + i, 1 + k : side - 1 + k]
        + sharp[1 - i : side - 1 - i, 1 - k : side - 1 - k]
        for i, k in ((0, 1), (1, 0), (1, 1), (1, -1))
    )
    bend = max(np.abs(pair - 2.0 * inner).max() for pair in pairs)
    if change < 1e-9:
        return 0.0
    return float(change / bend) if bend else np.inf


def main() -> None:
    """Print the largest ratio, and its quantiles."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 4000
    rng = np.random.default_rng(1)
    ratios = np.array([find_ratio(rng) for _ in range(count)])
    parts = ", ".join(f"{np.quantile(ratios, q):.3f}" for q in (0.5, 0.99, 0.999))
    print(f"{count} patterns: largest {ratios.max():.3f}; quantiles of 50, 99, 99.9 %: {parts}")


if __name__ == "__main__":
    main()
