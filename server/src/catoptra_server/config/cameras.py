"""The ordinary cameras of a robot's section: items of `Cameras=` (UT2004) and `AddParts=` (UDK)."""

from __future__ import annotations

from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.mounting import mount_of
from catoptra_server.config.settings import Settings
from catoptra_server.robot.description import CameraDescription

_CLASSES = ("robotcamera", "usarcamera", "camera")
# What a flat picture can still show.
_WIDEST_RAD = 3.0


def is_camera(struct: Settings) -> bool:
    """Return whether an item is an ordinary camera's."""
    return struct.text("ItemClass").rpartition(".")[2].lower() in _CLASSES


def read_camera(file: IniFile, robot: Settings, struct: Settings) -> CameraDescription:
    """Return the camera of an item; its class's section says what UDK's does: radians."""
    section = file.section(struct.text("ItemClass"))
    least = section.number("CameraMinFOV", 0.3491, at_least=0.01, at_most=_WIDEST_RAD)
    most = section.number("CameraMaxFOV", 2.0944, at_least=least, at_most=_WIDEST_RAD)
    return CameraDescription(
        name=struct.word("ItemName"),
        mount=mount_of(robot, struct),
        width_px=section.integer("ResolutionX", 320, at_least=1, at_most=8192),
        height_px=section.integer("ResolutionY", 240, at_least=1, at_most=8192),
        fov_rad=section.number(
            "CameraFOV", min(max(1.3963, least), most), at_least=least, at_most=most
        ),
        min_fov_rad=least,
        max_fov_rad=most,
    )
