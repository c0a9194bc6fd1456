"""What cameras leave out of baked light and sky, at 20 poses in each shipped world, whose light is
baked whatever its file says: .venv/bin/python tests/measurements/left_out_light.py [POSES]
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from helpers.configs import WORLDS
from helpers.left_out_light import draw_poses


def main(num_poses: int = 20) -> None:
    """Print a line for each world and rule."""
    for path in sorted(WORLDS.glob("*.ini")):
        for max_change, share in ((1.0, 1.0), (2.0, 0.01), (250.0, 1.0)):
            poses = [*draw_poses(path.stem, num_poses, max_change=max_change, visible_share=share)]
            states = ", ".join(
                f"{name} on at {sum(pose.decisions[name].enabled for pose in poses)}"
                for name in poses[0].decisions
            )
            bounds = ", ".join(f"{one.bound:.3g}" for one in poses[0].decisions.values())
            print(
                f"{path.stem:20} MaxChange {max_change:g} VisibleShare {share:4g}: {states}; "
                f"bounds {bounds}; differences {max(pose.largest for pose in poses):g}, "
                f"above 1 in {100.0 * max(pose.visible_share for pose in poses):.2g} %; "
                f"without both {max(pose.contribution for pose in poses):g}",
                flush=True,
            )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
