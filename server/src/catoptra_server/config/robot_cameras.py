"""Omnidirectional camera of a robot's section: the three groups of elements of the paper.

`StaticMeshes` has the mirror, `CamTexActors` the effective viewpoint with its texture clients,
`Cameras` the capture camera at the pinhole. Source: Schmits & Visser 2009, section 3.

Perspective cameras of a robot's section: items of `Cameras=` (UT2004) and `AddParts=` (UDK).
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors import Mirror
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.camera_sections import (
    MAX_SIDE_PX,
    read_effect_settings,
    read_lens_effect_settings,
    read_min_frame_interval_s,
    read_mount,
    read_picture,
    read_render_settings,
    read_texture_clients,
    require_on_robot,
    reserve_view,
)
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.known_names import is_own_section
from catoptra_server.config.mirrors_and_lenses import (
    PINHOLE_TOLERANCE_M,
    approximate_viewpoint,
    is_lens_camera,
    read_mirror,
    read_rim_deg,
    read_surface,
)
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.frames.plan.plans import perspective_view_size
from catoptra_server.render.render_settings import (
    MirrorSurface,
    PerPixel,
    require_mesh_viewpoint,
)
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES, MemoryBudget
from catoptra_server.simulation.robot_description import (
    OmniCameraDescription,
    PerspectiveCameraDescription,
)

# Directions in real files have four digits: 1.5708 for a right angle.
_AXIS_TOLERANCE_RAD = 1e-3
# Up into the mirror, forward at the top of the image.
_LOOKING_UP = (0.0, 1.5708, 3.1416)


def read_omni_camera(
    file: IniFile, section: SectionReader, *, limit_bytes: int = DEFAULT_LIMIT_BYTES
) -> OmniCameraDescription | None:
    """Camera of a robot's section; None where CamTexActors names no viewpoint.

    Args:
        file: file with the sections of the camera's groups.
        section: the robot's section.
        limit_bytes: memory that the camera's view may take.

    Raises:
        ConfigError: for a capture camera off the pinhole, an impossible mirror, a missing group, or
            a view larger than the limit.
    """
    clients = section.get_structs("CamTexActors")
    if not clients:
        _require_no_parts(file, section)
        return None
    if not clients[0].get_str("ItemName"):  # as in USARSim: no name, no camera
        clients[0].ignore_all()
        return None
    # USARSim spawns one viewpoint. Class and Parent name an emitter and a pillar, without a shape
    # here; both are read only to count as known.
    viewpoint = clients[0]
    viewpoint.get_str("ItemClass", "")
    viewpoint.get_str("Parent", "")
    mirror_item = _find_child(section, "StaticMeshes", viewpoint)
    capture_item = _find_child(section, "Cameras", viewpoint)
    mirror_settings = file.get_section(mirror_item.get_str("ItemClass"))
    capture = file.get_section(capture_item.get_str("ItemClass"))
    mirror = read_mirror(mirror_item, mirror_settings)
    camera, central_error_px = approximate_viewpoint(
        mirror_settings, _read_camera_model(mirror, mirror_settings, capture, capture_item)
    )
    texture_clients = read_texture_clients(file)
    description = OmniCameraDescription(
        name=capture_item.get_wire_name("ItemName"),
        camera=camera,
        robot_from_mirror=_read_viewpoint_pose(viewpoint),
        texture_clients=texture_clients,
        render_settings=read_render_settings(
            capture,
            surface=_read_surface(camera, mirror_settings),
            # Faces share an atlas and one size.
            face_size_px=max(client.size_px for client in texture_clients),
            central_error_px=central_error_px,
        ),
        min_frame_interval_s=read_min_frame_interval_s(capture),
        capture_fov_rad=_capture_fov(camera),
        effects=read_effect_settings(capture, has_viewpoint=mirror.is_central),
    )
    reserve_view(description, capture, MemoryBudget(limit_bytes))
    return description


def _require_no_parts(file: IniFile, section: SectionReader) -> None:
    """Raise ConfigError for a mirror or a capture camera without a viewpoint to be mounted on."""
    for key in ("StaticMeshes", "Cameras"):
        for item in section.get_structs(key):
            if is_own_section(item.get_str("ItemClass", "")) and not is_lens_camera(file, item):
                viewpoint = item.get_str("Parent", "") or "OmniCam"
                raise section.make_error(
                    "CamTexActors",
                    expected=f"the viewpoint that {item.get_str('ItemName', 'an item')} of {key} "
                    f'is mounted on, such as (ItemName="{viewpoint}",Position=(X=0,Y=0,Z=-0.45)); '
                    "it is missing",
                )


def _find_child(section: SectionReader, key: str, viewpoint: SectionReader) -> SectionReader:
    """Item of a list that is mounted on the effective viewpoint."""
    name = viewpoint.get_str("ItemName")
    for item in section.get_structs(key):
        if item.get_str("Parent", "").lower() == name.lower():
            return item
    raise section.make_error(
        key, expected=f'an item with Parent="{name}", mounted on the viewpoint'
    )


def _read_surface(camera: OmniCamera, settings: SectionReader) -> MirrorSurface:
    surface = read_surface(settings)
    if isinstance(surface, PerPixel):
        return surface
    try:
        require_mesh_viewpoint(camera)
    except DomainError as error:
        key = "Polygons" if settings.has_key("Polygons") else "Sectors"
        raise settings.make_error(key, expected=str(error)) from error
    return surface


def _read_viewpoint_pose(viewpoint: SectionReader) -> Pose:
    direction = viewpoint.get_vector("Direction", (0.0, 0.0, 0.0))
    position = viewpoint.get_vector("Position")
    require_on_robot(viewpoint, "Position", position)
    return Pose.from_rpy(position, direction)


def _read_camera_model(
    mirror: Mirror, settings: SectionReader, capture: SectionReader, item: SectionReader
) -> OmniCamera:
    _require_at_pinhole(mirror, item)
    rim = read_rim_deg(settings)
    try:
        camera = camera_with_inscribed_rim(
            mirror,
            width_px=capture.get_int("ResolutionX", 360, min_value=1, max_value=MAX_SIDE_PX),
            height_px=capture.get_int("ResolutionY", 360, min_value=1, max_value=MAX_SIDE_PX),
            rim_rad=math.radians(rim),
            image_up_azimuth_rad=_image_up_azimuth(item),
            picture=read_picture(capture, Picture.MIRRORED),
        )
    except DomainError as error:
        raise settings.make_error("RimAngle", expected=f"a possible value: {error}") from error
    return camera


def _require_at_pinhole(mirror: Mirror, item: SectionReader) -> None:
    """Raise ConfigError for a capture camera off the pinhole or the axis, which is not central."""
    direction = item.get_vector("Direction", _LOOKING_UP)
    forward = Pose.from_rpy((0, 0, 0), direction).rotation[:, 0]
    if np.linalg.norm(forward - (0.0, 0.0, -1.0)) > _AXIS_TOLERANCE_RAD:
        raise item.make_error("Direction", expected="a pitch Y=1.5708, looking up into the mirror")
    if not item.has_key("Position"):  # at the pinhole, then
        return
    position = np.asarray(item.get_vector("Position"))
    # A parabolic mirror's pinhole is at infinity: an orthographic camera anywhere on the axis.
    if math.isinf(mirror.pinhole_distance_m):
        off = float(np.hypot(position[0], position[1]))
        pinhole = "on the axis (X=0,Y=0)"
    else:
        off = float(np.linalg.norm(position - (0.0, 0.0, mirror.pinhole_distance_m)))
        pinhole = f"(X=0,Y=0,Z={mirror.pinhole_distance_m:g}), the mirror's second focus"
    if off > PINHOLE_TOLERANCE_M:
        raise item.make_error(
            "Position",
            expected=f"the pinhole {pinhole}, or no Position; it is {1e3 * off:.3g} mm off",
        )


def _image_up_azimuth(item: SectionReader) -> float:
    """Azimuth in the mirror frame, radians, of the direction at the top of the image."""
    direction = item.get_vector("Direction", _LOOKING_UP)
    rotation = Pose.from_rpy((0, 0, 0), direction).rotation
    up = -rotation[:, 2]
    azimuth = math.atan2(float(up[1]), float(up[0]))
    # 1.5708 in a file means a quarter turn exactly: the residual of 4e-6 rad would rotate the image
    # and break the symmetry of the faces.
    quarters = azimuth / (0.5 * math.pi)
    nearest = round(quarters)
    near = abs(quarters - nearest) < 1e-4
    return (nearest % 4) * 0.5 * math.pi if near else azimuth


def _capture_fov(camera: OmniCamera) -> float:
    """Field of view of the capture camera over the rim, radians; 0 for an orthographic camera."""
    if math.isinf(camera.mirror.pinhole_distance_m):
        return 0.0
    r, z = camera.mirror.surface_point(np.array(camera.rim_t))
    return 2.0 * math.atan2(float(r), camera.mirror.pinhole_distance_m - float(z))


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
