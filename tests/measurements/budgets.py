"""Frames under a time budget: whether they keep it, and whether their times were predicted.

Run: .venv/bin/python tests/measurements/budgets.py [--budgets 4 8 16 32] [--worlds NAME ...]

A server in real time for each bundled world and each of two robots: the paper's camera without
effects, and the shipped real camera with all of its own. For each budget a driving robot's frames
are requested one after the other, 130 to let the plan settle, then 60 whose median counts: within a
fifth of the budget, or the server said that no plan meets it. A prediction is right within 25 %.
Servers are reached over the stream alone, so that the script survives any change inside; each has a
cost cache of its own. Decision: SPEC 9.5, and what frames/frame_plan.py records.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from catoptra_client.frame import Frame
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.server_process import connect_stream, start_server
from catoptra_protocol.stream.requests import ImageEncoding

WORLDS = tuple(
    path.stem for path in sorted((Path(__file__).parents[2] / "configs/worlds").glob("*.ini"))
)
ROBOTS = {"p2at_omni": "off", "p2at_omni_real": "on"}
WHEELS_RAD_S = (1.0, 1.5)
SETTLE_FRAMES, FRAMES = 130, 60
OVERRUN, TOLERANCE = 1.2, 0.25


class Row(NamedTuple):
    """Frames of one budget."""

    world: str
    effects: str
    budget_ms: float
    median_ms: float
    predicted_ms: float
    is_met: bool
    """Whether the server said that the target is met."""

    @property
    def keeps_budget(self) -> bool:
        """Whether the frames keep the budget, or the server said that they cannot."""
        return self.median_ms <= OVERRUN * self.budget_ms or not self.is_met

    @property
    def is_predicted(self) -> bool:
        """Whether the prediction is right within a quarter."""
        return abs(self.predicted_ms / self.median_ms - 1.0) <= TOLERANCE


def measure(world: str, robot: str, budgets_ms: list[float]) -> Iterator[Row]:
    """Yield the rows of one server."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        arguments = ("--robot", robot, "--world", world, "--control-port", "0", "--image-port", "0")
        with (
            start_server(arguments, log_file=Path(folder, "log")) as address,
            connect_stream(address, timeout_s=120.0) as client,
        ):
            start = next((pose.name for pose in client.get_start_poses()), None)
            client.spawn(client.get_status().class_names[0], start_pose=start)
            client.drive(*WHEELS_RAD_S)
            name = client.get_state().robots[0].name
            for budget_ms in budgets_ms:
                client.set_accuracy(budget_ms=budget_ms)
                numbers = summarize([*request_frames(client, name)][-FRAMES:])
                # Without arguments: the plan after the last frame.
                is_met = client.set_accuracy().target_met
                yield Row(world, ROBOTS[robot], budget_ms, *numbers, is_met)


def request_frames(client: StreamClient, name: str) -> Iterator[Frame]:
    """Yield frames, one requested after the other."""
    for _ in range(SETTLE_FRAMES + FRAMES):
        yield client.get_frame(encoding=ImageEncoding.RAW, robot=name)


def summarize(frames: list[Frame]) -> tuple[float, float]:
    """Median and predicted milliseconds of frames."""
    times = [sum((frame.stage_ms or {}).values()) for frame in frames]
    predicted = statistics.median(frame.predicted_ms or 0.0 for frame in frames)
    return statistics.median(times), predicted


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--budgets", type=float, nargs="+", default=[4.0, 8.0, 16.0, 32.0])
    parser.add_argument("--worlds", nargs="+", default=WORLDS, choices=WORLDS)
    parsed = parser.parse_args()
    rows: list[Row] = []
    print(f"{'world':18} effects budget  median predicted")
    for world in parsed.worlds:
        for robot in ROBOTS:
            for row in measure(world, robot, parsed.budgets):
                rows.append(row)
                notes = ("" if row.keeps_budget else " OVER", "" if row.is_predicted else " off")
                met = "" if row.is_met else " (no plan meets it)"
                print(
                    f"{row.world:18} {row.effects:7} {row.budget_ms:6g} {row.median_ms:7.1f} "
                    f"{row.predicted_ms:9.1f}{''.join(notes)}{met}",
                    flush=True,
                )
    kept, predicted = sum(row.keeps_budget for row in rows), sum(row.is_predicted for row in rows)
    print(f"{kept} of {len(rows)} keep the budget; {predicted} are predicted within 25 %")


if __name__ == "__main__":
    main()
