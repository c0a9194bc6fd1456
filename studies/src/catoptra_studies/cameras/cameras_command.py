"""The command `catoptra-studies cameras`: a gallery of camera models in one world."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from catoptra_protocol.errors import CatoptraError
from catoptra_server.config.bundled_files import find_configuration
from catoptra_server.config.camera_file import read_camera_files
from catoptra_studies.cameras.camera_gallery import draw_gallery
from catoptra_studies.cameras.camera_stage import open_stage, stage_cameras
from catoptra_studies.progress_display import open_progress, print_error, print_line

EXIT_FAILURE = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the gallery; return 0, or 2 after one line about the reason."""
    parsed = _make_parser().parse_args(arguments)
    try:
        parsed.output.mkdir(parents=True, exist_ok=True)
        files = read_camera_files(parsed.cameras.split(",") if parsed.cameras else ())
        cameras = stage_cameras(files, parsed.output, size_px=parsed.size)
        world_file = find_configuration("worlds", parsed.world)
        with open_progress() as progress, open_stage(cameras, world_file) as stage:
            on_camera = progress.add_task("cameras", len(cameras))
            page = draw_gallery(stage, parsed.output, num_timed=parsed.frames, on_camera=on_camera)
    except (CatoptraError, OSError) as error:
        print_error(f"catoptra-studies cameras: {error}")
        return EXIT_FAILURE
    print_line(f"written: {page}")
    return 0


def _make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="catoptra-studies cameras",
        description="Draw all camera models in one world, with circles of equal angle, covered "
        "sphere, resolution by angle, domain, first fold and milliseconds a frame.",
    )
    add = parser.add_argument
    add("--cameras", default="", metavar="A,B",
        help="camera files or bundled names (default: all of configs/cameras)")  # fmt: skip
    add("--world", default="four_legged_2006", metavar="FILE",
        help="world ini, or a bundled name (default four_legged_2006)")  # fmt: skip
    add("--output", type=Path, default=Path("out/cameras"), metavar="DIR",
        help="folder for index.html, cameras.json and pictures (default out/cameras)")  # fmt: skip
    add("--size", type=int, default=640, metavar="N",
        help="side of images, but of cameras calibrated in pixels (default 640)")  # fmt: skip
    add("--frames", type=int, default=9, metavar="N",
        help="frames of each camera that are timed (default 9)")  # fmt: skip
    return parser
