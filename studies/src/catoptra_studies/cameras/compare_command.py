"""The command `catoptra-studies compare`: which camera for a task, as a table and a picture."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from catoptra_protocol.errors import CatoptraError
from catoptra_server.config.bundled_files import find_configuration
from catoptra_server.config.camera_file import read_camera_files
from catoptra_studies.cameras.camera_comparison import DrivePlan, compare_cameras
from catoptra_studies.cameras.camera_stage import open_stage, stage_cameras
from catoptra_studies.cameras.comparison_report import format_comparison, write_comparison
from catoptra_studies.progress_display import open_progress, print_error, print_line

EXIT_FAILURE = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare cameras; return 0, or 2 after one line about the reason."""
    parsed = _make_parser().parse_args(arguments)
    try:
        parsed.output.mkdir(parents=True, exist_ok=True)
        files = read_camera_files(parsed.cameras.split(",") if parsed.cameras else ())
        cameras = stage_cameras(files, parsed.output, size_px=parsed.size)
        world_file = find_configuration("worlds", parsed.world)
        with open_progress() as progress, open_stage(cameras, world_file) as stage:
            plan = DrivePlan(
                world_file, stage.landmarks, parsed.runs, parsed.seed, parsed.output.resolve()
            )
            on_camera = progress.add_task("cameras", len(cameras))
            rows = compare_cameras(stage, plan, num_timed=parsed.frames, on_camera=on_camera)
        write_comparison(rows, parsed.output)
    except (CatoptraError, OSError) as error:
        print_error(f"catoptra-studies compare: {error}")
        return EXIT_FAILURE
    print_line(format_comparison(rows))
    if not plan.landmarks:
        print_line(f"{world_file} has no landmarks: nothing to localize by, so no drives")
    print_line(f"written: {parsed.output}")
    return 0


def _make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="catoptra-studies compare",
        description="Compare cameras on the same robot: resolution on the floor and at the "
        "horizon, blind zone, localization on the paper's route, and milliseconds a frame.",
    )
    add = parser.add_argument
    add("--cameras", default="", metavar="A,B",
        help="camera files or bundled names (default: all of configs/cameras)")  # fmt: skip
    add("--world", default="four_legged_2006", metavar="FILE",
        help="world ini, or a bundled name (default four_legged_2006)")  # fmt: skip
    add("--output", type=Path, default=Path("out/compare"), metavar="DIR",
        help="folder for comparison.csv, .json and .png (default out/compare)")  # fmt: skip
    add("--size", type=int, default=360, metavar="N",
        help="side of images, but of cameras calibrated in pixels (default 360)")  # fmt: skip
    add("--runs", type=int, default=3, metavar="N",
        help="drives with each camera, 0 for none (default 3)")  # fmt: skip
    add("--frames", type=int, default=9, metavar="N",
        help="frames of each camera that are timed (default 9)")  # fmt: skip
    add("--seed", type=int, default=0,
        help="seed of all random numbers: all results but the times follow from it")  # fmt: skip
    return parser
