"""The ordinary cameras of a robot's section: items of `Cameras=` (UT2004) and `AddParts=` (UDK)."""

from __future__ import annotations

from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.mounting import read_mount
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.robot.robot_description import PerspectiveCameraDescription

_CLASSES = ("robotcamera", "usarcamera", "camera")
# What a flat picture can still show.
_MAX_FOV_RAD = 3.0


def is_perspective_camera(item: SectionReader) -> bool:
    """Return whether an item is an ordinary camera's."""
    return item.get_str("ItemClass").rpartition(".")[2].lower() in _CLASSES


def read_perspective_camera(
    file: IniFile, robot: SectionReader, item: SectionReader
) -> PerspectiveCameraDescription:
    """Return the camera of an item; its class's section says what UDK's does: radians."""
    section = file.get_section(item.get_str("ItemClass"))
    least = section.get_float("CameraMinFOV", 0.3491, min_value=0.01, max_value=_MAX_FOV_RAD)
    most = section.get_float("CameraMaxFOV", 2.0944, min_value=least, max_value=_MAX_FOV_RAD)
    return PerspectiveCameraDescription(
        name=item.get_wire_name("ItemName"),
        mount=read_mount(robot, item),
        width_px=section.get_int("ResolutionX", 320, min_value=1, max_value=8192),
        height_px=section.get_int("ResolutionY", 240, min_value=1, max_value=8192),
        fov_rad=section.get_float(
            "CameraFOV", min(max(1.3963, least), most), min_value=least, max_value=most
        ),
        min_fov_rad=least,
        max_fov_rad=most,
    )
