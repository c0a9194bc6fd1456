"""Rows of pictures against means of 64 sharp frames about their own times.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/shutter_rows.py [WORLD ...]

Prints, by world, motion and shutter, rolling or not, of the shipped real camera at 640 x 480 px,
the quantiles of 99 % and 99.9 % of the mirror's pixels in each 15th row, and the share of them
beyond 2 and 8 grey levels. The light of the frames is summed before the well clips it once.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from helpers.finished_pictures import real_camera_in
from helpers.rolled_rows import (
    MOTIONS,
    SHUTTERS,
    WORLDS,
    find_row_differences,
    moving_state,
    open_moving_rays,
)


def main(*worlds: str) -> None:
    """Print a line for each world, motion and shutter."""
    omni = real_camera_in("corridor").robots[0].omni_camera
    assert omni is not None
    for world in worlds or WORLDS:
        with open_moving_rays(world, omni.camera) as (rays, pose):
            for motion in MOTIONS:
                state = moving_state(pose, motion)
                for name, shutter in SHUTTERS.items():
                    found = find_row_differences(rays, omni.camera, state, shutter)
                    inner, outer = np.quantile(found, (0.99, 0.999))
                    beyond = [f"{100.0 * (found > level).mean():.2f} %" for level in (2.0, 8.0)]
                    print(
                        f"{world:18} {motion:20} {name:18} 99 %: {inner:6.2f}, "
                        f"99.9 %: {outer:6.2f}; beyond 2: {beyond[0]}, 8: {beyond[1]}",
                        flush=True,
                    )


if __name__ == "__main__":
    main(*sys.argv[1:])
