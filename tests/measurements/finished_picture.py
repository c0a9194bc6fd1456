"""Differences of the pictures with effects by their criteria from those with all effects, in all
light: .venv/bin/python tests/measurements/finished_picture.py [SIDE_PX]

With --sheet FILE instead: the pictures of the field, rescue and the corridor at night (a 25th of
the light), by day and at noon (four times as much), at one exposure. With --sheet FILE clean those
of the corridor and of the arena, above without and below with effects.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from PIL import Image

from helpers.finished_pictures import draw_pair, find_differences

Draw = Callable[..., tuple[Any, Any]]
WORLDS = ("corridor", "four_legged_2006", "incidence_rings", "legacy", "rescue", "warehouse")
SITUATIONS = (
    *((factor, None) for factor in (1e-4, 1e-3, 0.1, 1.0, 8.0)),
    *((factor, gain) for factor in (1e-3, 0.1, 1.0) for gain in (10.0, 1000.0)),
)


def main(side_px: int = 240) -> None:
    """Print a line for each world and light."""
    for world in WORLDS:
        for factor, max_gain in SITUATIONS:
            pair = draw_pair(world, factor, width_px=side_px, max_gain=max_gain)
            differences = find_differences(pair)
            control = "exposure" if max_gain is None else f"automatic to {max_gain:g}"
            off = [one.effect for one in pair[0].effect_decisions if not one.enabled]
            print(
                f"{world:18} light x {factor:<7g} {control:18} worst {differences.max():5.0f}, "
                f"above 2: {int((differences > 2).sum()):6d} px; off: {len(off)}",
                flush=True,
            )


def draw_sheet(path: str, rows: Sequence[tuple[str, Draw]], side_px: int = 240) -> None:
    """Write the pictures of worlds, a row each, at night, by day and at noon."""
    pictures = [
        [
            draw(world, factor, width_px=side_px, exposure=factor)[0].image.rgb
            for factor in (0.04, 1.0, 4.0)
        ]
        for world, draw in rows
    ]
    sheet = np.concatenate([np.concatenate(row, axis=1) for row in pictures])
    Image.fromarray(sheet).save(path)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--sheet"]:
        rows = [(world, draw_pair) for world in ("four_legged_2006", "rescue", "corridor")]
        if sys.argv[3:] == ["clean"]:
            clean = partial(draw_pair, is_clean=True)
            rows = [(world, draw) for world in ("corridor", "arena") for draw in (clean, draw_pair)]
        draw_sheet(sys.argv[2], rows)
    else:
        main(*map(int, sys.argv[1:]))
