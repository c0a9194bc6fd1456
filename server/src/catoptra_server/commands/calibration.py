"""`catoptra-server calibration`: a robot's camera as calibration files of other programs.

Every format that describes the camera well enough is written, and CALIBRATION.md about all.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from catoptra_protocol.calibration.calibration_folder import REPORT_NAME, write_calibration
from catoptra_protocol.calibration.exports import DEFAULT_MAX_RESIDUAL_PX
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.robot_file import read_robot
from catoptra_server.runtime.options import CommandParser
from catoptra_server.simulation.robot_description import OmniCameraDescription, RobotDescription

_EXIT_FAILURE = 2


def main(arguments: Sequence[str]) -> int:
    """Run the command; return the exit status, 0, or 2 after a message for a failure."""
    parsed = _build_parser().parse_args(arguments)
    try:
        robot, _ = read_robot(find_configuration("robots", parsed.robot))
        omni = find_camera(robot, parsed.camera)
        written = write_calibration(
            omni.camera,
            parsed.out,
            name=omni.name,
            picture=Picture(parsed.picture),
            max_residual_px=parsed.max_residual_px,
            robot_from_mirror=omni.robot_from_mirror.rotation,
        )
    except (CatoptraError, OSError) as error:
        print(f"catoptra-server calibration: {error}", file=sys.stderr)
        return _EXIT_FAILURE
    for line in written:
        print(line)
    return 0


def _build_parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        prog="catoptra-server calibration",
        description="Write a robot's omnidirectional camera as calibration files of other "
        f"programs, and {REPORT_NAME} about them.",
    )
    parser.add_argument("--robot", required=True, help="robot file, or the name of a bundled one")
    parser.add_argument("--camera", default="", help="name of the camera; default: the first")
    parser.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="folder, made if absent"
    )
    parser.add_argument("--picture", choices=[picture.value for picture in Picture],
        default=Picture.FLIPPED.value, help="hand of the pictures that the files describe; "
        "default: flipped, which all formats are made for")  # fmt: skip
    parser.add_argument("--max-residual-px", type=float, metavar="PX",
        default=DEFAULT_MAX_RESIDUAL_PX, help="largest difference of a file from the camera, "
        f"anywhere in the image; default: {DEFAULT_MAX_RESIDUAL_PX:g}")  # fmt: skip
    return parser


def find_camera(robot: RobotDescription, name: str) -> OmniCameraDescription:
    """An omnidirectional camera of a robot by name; the first for an empty one.

    Raises:
        CatoptraError: The robot has no such camera.
    """
    for omni in robot.omni_cameras:
        if not name or omni.name.lower() == name.lower():
            return omni
    if not robot.omni_cameras:
        raise CatoptraError(f"{robot.class_name} has no omnidirectional camera")
    names = ", ".join(omni.name for omni in robot.omni_cameras)
    raise CatoptraError(f"{robot.class_name} has no omnidirectional camera {name}: it has {names}")
