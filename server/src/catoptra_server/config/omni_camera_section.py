"""Omnidirectional camera of a robot's section: the three groups of elements of the paper.

`StaticMeshes` has the mirror, `CamTexActors` the effective viewpoint with its texture clients,
`Cameras` the capture camera at the pinhole. Source: Schmits & Visser 2009, section 3.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors import Mirror
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.capture_section import (
    MAX_SIDE_PX,
    read_min_frame_interval_s,
    read_picture,
    read_render_settings,
    reserve_view,
)
from catoptra_server.config.effect_settings import read_effect_settings
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.lens_camera_items import is_lens_camera
from catoptra_server.config.mirror_section import (
    PINHOLE_TOLERANCE_M,
    approximate_viewpoint,
    read_mirror,
    read_rim_deg,
    read_surface,
)
from catoptra_server.config.mounting import require_on_robot
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.texture_client_sections import read_texture_clients
from catoptra_server.config.unknown_names import is_own_section
from catoptra_server.render.render_settings import (
    MirrorSurface,
    PerPixel,
    require_mesh_viewpoint,
)
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES, MemoryBudget
from catoptra_server.simulation.robot_description import OmniCameraDescription

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
