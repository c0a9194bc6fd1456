"""Perspective cameras of a robot's section: items of `Cameras=` (UT2004) and `AddParts=` (UDK)."""

from __future__ import annotations

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.config.effect_settings import read_lens_effect_settings
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.mounting import read_mount
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.frames.plan.plans import perspective_view_size
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES, MemoryBudget
from catoptra_server.simulation.robot_description import PerspectiveCameraDescription

_CLASSES = ("robotcamera", "usarcamera", "camera")
# 172 degrees. A flat image plane ends at 180, where tan(fov / 2) is infinite.
_MAX_FOV_RAD = 3.0


def is_perspective_camera(item: SectionReader) -> bool:
    """Whether an item's class is a perspective camera of UT2004 or UDK."""
    return item.get_str("ItemClass").rpartition(".")[2].lower() in _CLASSES


def read_perspective_camera(
    file: IniFile,
    robot: SectionReader,
    item: SectionReader,
    *,
    limit_bytes: int = DEFAULT_LIMIT_BYTES,
) -> PerspectiveCameraDescription:
    """Camera of an item, with field of view, resolution and effects of the section of its class.

    Defaults and units (radians) are those of UDK's DefaultUSAR.ini.

    Raises:
        ConfigError: for a value out of range, or a view that takes more than `limit_bytes`.
    """
    section = file.get_section(item.get_str("ItemClass"))
    min_fov_rad = section.get_float("CameraMinFOV", 0.3491, min_value=0.01, max_value=_MAX_FOV_RAD)
    max_fov_rad = section.get_float(
        "CameraMaxFOV", 2.0944, min_value=min_fov_rad, max_value=_MAX_FOV_RAD
    )
    description = PerspectiveCameraDescription(
        name=item.get_wire_name("ItemName"),
        mount=read_mount(robot, item),
        width_px=section.get_int("ResolutionX", 320, min_value=1, max_value=8192),
        height_px=section.get_int("ResolutionY", 240, min_value=1, max_value=8192),
        fov_rad=section.get_float(
            "CameraFOV",
            # UDK's default, moved into the zoom range where the section narrows that alone.
            min(max(1.3963, min_fov_rad), max_fov_rad),
            min_value=min_fov_rad,
            max_value=max_fov_rad,
        ),
        min_fov_rad=min_fov_rad,
        max_fov_rad=max_fov_rad,
        effects=read_lens_effect_settings(section),
    )
    camera = PerspectiveCamera(description.width_px, description.height_px, description.fov_rad)
    MemoryBudget(limit_bytes).reserve(
        perspective_view_size(camera, has_effects=bool(description.effects.settings)).num_bytes,
        where=section.find_location("ResolutionX"),
        key=f"{section.name}.ResolutionX",
        value=f"{camera.width_px} x {camera.height_px} px",
        remedy="fewer pixels",
    )
    return description
