"""What cameras leave out of baked light and sky, at 20 poses in each shipped world, whose light is
baked whatever its file says: .venv/bin/python tests/measurements/left_out_light.py [POSES]
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from helpers.configs import WORLDS
from helpers.left_out_light import LeftOut, draw_poses


def main(num_poses: int = 20) -> None:
    """Print a line for each world and rule, and one for each effect alone."""
    for path in sorted(WORLDS.glob("*.ini")):
        for max_change, share in ((1.0, 1.0), (2.0, 0.01), (250.0, 1.0)):
            poses = [*draw_poses(path.stem, num_poses, max_change=max_change, visible_share=share)]
            states = ", ".join(
                f"{name} on at {sum(pose.decisions[name].enabled for pose in poses)}"
                for name in poses[0].decisions
            )
            print(
                f"{path.stem:20} MaxChange {max_change:g} VisibleShare {share:4g}: {states}; "
                f"differences {max(pose.largest for pose in poses):g}, "
                f"above 1 in {100.0 * max(pose.visible_share for pose in poses):.2g} %",
                flush=True,
            )
            if max_change == 1.0:
                _print_alone(poses)


def _print_alone(poses: Sequence[LeftOut]) -> None:
    """Print what each effect changes alone beside what is stated."""
    for name in poses[0].decisions:
        pairs = [(pose.stated(name), pose.contributions[name]) for pose in poses]
        # Pictures are rounded to whole levels.
        num_short = sum(true > stated + 1.0 for stated, true in pairs)
        nearest = min(pairs, key=lambda pair: pair[0] - pair[1])
        print(
            f"{'':20} {name:11} stated {min(pairs)[0]:.1f} to {max(pairs)[0]:.1f}, "
            f"true at most {max(true for _, true in pairs):.0f}; nearest "
            f"{nearest[0]:.1f} >= {nearest[1]:.0f}; too small at {num_short} of {len(poses)}",
            flush=True,
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
