"""`catoptra-server calibration`: a robot's camera as calibration files of other programs.

Every format that describes the camera well enough is written, and CALIBRATION.md about all.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial

from catoptra_protocol.calibration.calibration_folder import (
    REPORT_NAME,
    add_calibration_options,
    write_calibration,
)
from catoptra_protocol.command_line import CommandParser
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.names import list_names
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.robot_file import read_robot
from catoptra_server.simulation.robot_description import OmniCameraDescription, RobotDescription


def main(arguments: Sequence[str]) -> int:
    """Run the command."""
    parsed = _build_parser().parse_args(arguments)
    # Nothing is drawn: a view may take any memory.
    robot, _ = read_robot(parsed.robot, limit_bytes=sys.maxsize)
    omni = find_camera(robot, parsed.camera)
    written = write_calibration(
        omni.camera,
        parsed.out,
        name=omni.name,
        picture=Picture(parsed.picture),
        max_residual_px=parsed.max_residual_px,
        robot_from_mirror=omni.robot_from_mirror.rotation,
    )
    for line in written:
        print(line)
    return 0


def _build_parser() -> CommandParser:
    parser = CommandParser(
        "catoptra-server calibration",
        "Write a robot's omnidirectional camera as calibration files of other programs, and "
        f"{REPORT_NAME} about them.",
    )
    add = parser.add_argument
    add("--robot", required=True, type=partial(find_configuration, "robots"), metavar="FILE",
        help="robot file, or the name of a bundled one")  # fmt: skip
    add("--camera", default="", metavar="NAME", help="name of the camera (default: the first)")
    add_calibration_options(parser)
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
    names = list_names(name, (omni.name for omni in robot.omni_cameras))
    raise CatoptraError(f"{robot.class_name} has no omnidirectional camera {name}: it has {names}")
