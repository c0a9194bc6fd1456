"""Omnidirectional camera of a robot's section: the three groups of elements of the paper.

`StaticMeshes` has the mirror, `CamTexActors` the effective viewpoint with its texture clients,
`Cameras` the capture camera at the pinhole. Source: Schmits & Visser 2009, section 3.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.mirrors import CentralMirror, HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.effect_settings import read_effect_settings
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.mounting import require_on_robot
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.memory_budget import DEFAULT_LIMIT_BYTES, MemoryBudget
from catoptra_server.planning.explicit_plan import requested_samples
from catoptra_server.planning.view_size import omni_view_size
from catoptra_server.robot.render_settings import (
    AccuracyTarget,
    MirrorSurface,
    PerPixel,
    RenderSettings,
)
from catoptra_server.robot.robot_description import OmniCameraDescription, TextureClient
from catoptra_server.scene.mirror_mesh import (
    Interpolation,
    Tessellation,
    tessellation_from_polygon_count,
)

# The paper's meshes end at 4096. A million take 0.3 GB while they are drawn into the lookup map.
_MAX_POLYGONS = 1_000_000
# 8192^2 raw pixels are 201 MB for a frame; the largest texture of OpenGL devices is not far above.
_MAX_SIDE_PX = 8192
# A capture camera so far off the pinhole (metres) displaces the image by 0.04 px at 360 px. Beyond
# that the camera is no longer central, which is the effect Misalignment, not a camera model.
_PINHOLE_TOLERANCE_M = 5e-5
# Directions in real files have four digits: 1.5708 for a right angle.
_AXIS_TOLERANCE_RAD = 1e-3


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
    mirror = _read_mirror(mirror_item, mirror_settings)
    camera = _read_camera_model(mirror, mirror_settings, capture, capture_item)
    description = OmniCameraDescription(
        name=capture_item.get_wire_name("ItemName"),
        camera=camera,
        robot_from_mirror=_read_viewpoint_pose(viewpoint),
        texture_clients=_read_texture_clients(file),
        render_settings=_read_render_settings(file, mirror_settings, capture),
        min_frame_interval_s=capture.get_float("FrameInterval", 0.0, min_value=0.0, max_value=60.0),
        capture_fov_rad=_capture_fov(camera),
        effects=read_effect_settings(capture),
    )
    _reserve_view(description, capture, MemoryBudget(limit_bytes))
    return description


def _reserve_view(
    omni: OmniCameraDescription, capture: SectionReader, memory: MemoryBudget
) -> None:
    """Raise ConfigError for a view that would take too much memory, before any is taken."""
    camera, settings = omni.camera, omni.render_settings
    size = omni_view_size(camera, settings, has_effects=bool(omni.effects.settings))
    samples = requested_samples(settings)
    faces = f", faces of {settings.face_size_px} px" if settings.face_size_px else ""
    memory.reserve(
        size.num_bytes,
        where=capture.find_location("ResolutionX"),
        key=f"{capture.name}.ResolutionX",
        value=f"{camera.width_px} x {camera.height_px} px, Samples={samples}{faces}",
        remedy="fewer pixels, Samples, or texels (TextureSize, FaceSamples)",
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


def _read_viewpoint_pose(viewpoint: SectionReader) -> Pose:
    direction = viewpoint.get_vector("Direction", (0.0, 0.0, 0.0))
    position = viewpoint.get_vector("Position")
    require_on_robot(viewpoint, "Position", position)
    return Pose.from_rpy(position, direction)


def _read_mirror(item: SectionReader, settings: SectionReader) -> CentralMirror:
    # The mesh's origin is the mirror's focus, which is the effective viewpoint.
    if any(
        abs(value) > _PINHOLE_TOLERANCE_M for value in item.get_vector("Position", (0.0, 0.0, 0.0))
    ):
        raise item.make_error(
            "Position", expected="(X=0,Y=0,Z=0): the viewpoint has the mesh's position"
        )
    item.get_vector("Direction", (0.0, 0.0, 0.0))
    item.get_str("ItemName")
    metres = settings.get_float("MetresPerUnit", 0.1, min_value=1e-9)
    match settings.name.rpartition(".")[2].lower():
        case "hyperbolicmirror":
            k = settings.get_float("K", min_value=2.0)
            c_m = settings.get_float("C", min_value=0.0) * metres
            # The bounds above are closed, the mirror's domain is open: K=2 and C=0 fail here.
            try:
                return HyperbolicMirror(k, c_m)
            except DomainError as error:
                raise settings.make_error(
                    "K" if k <= 2.0 else "C", expected=f"a possible value: {error}"
                ) from error
        case "parabolicmirror":
            radius = settings.get_float("HorizonRadius", min_value=1e-9)
            return ParabolicMirror(radius * metres)
    raise item.make_error(
        "ItemClass", expected="Catoptra.HyperbolicMirror or Catoptra.ParabolicMirror with a section"
    )


def _read_camera_model(
    mirror: CentralMirror, settings: SectionReader, capture: SectionReader, item: SectionReader
) -> OmniCamera:
    _require_at_pinhole(mirror, item)
    rim = settings.get_float("RimAngle", 120.0, min_value=1.0, max_value=179.0)
    try:
        return camera_with_inscribed_rim(
            mirror,
            width_px=capture.get_int("ResolutionX", 360, min_value=1, max_value=_MAX_SIDE_PX),
            height_px=capture.get_int("ResolutionY", 360, min_value=1, max_value=_MAX_SIDE_PX),
            rim_rad=math.radians(rim),
            image_up_azimuth_rad=_image_up_azimuth(item),
        )
    except DomainError as error:
        raise settings.make_error("RimAngle", expected=f"a possible value: {error}") from error


def _require_at_pinhole(mirror: CentralMirror, item: SectionReader) -> None:
    """Raise ConfigError for a capture camera off the pinhole or the axis, which is not central."""
    position = np.asarray(item.get_vector("Position"))
    # A parabolic mirror's pinhole is at infinity: an orthographic camera anywhere on the axis.
    if math.isinf(mirror.pinhole_distance_m):
        off = float(np.hypot(position[0], position[1]))
        pinhole = "on the axis (X=0,Y=0)"
    else:
        off = float(np.linalg.norm(position - (0.0, 0.0, mirror.pinhole_distance_m)))
        pinhole = f"(X=0,Y=0,Z={mirror.pinhole_distance_m:g}), the mirror's second focus"
    if off > _PINHOLE_TOLERANCE_M:
        raise item.make_error(
            "Position", expected=f"the pinhole {pinhole}; it is {1e3 * off:.3g} mm off"
        )
    forward = Pose.from_rpy((0, 0, 0), item.get_vector("Direction")).rotation[:, 0]
    if np.linalg.norm(forward - (0.0, 0.0, -1.0)) > _AXIS_TOLERANCE_RAD:
        raise item.make_error("Direction", expected="a pitch Y=1.5708, looking up into the mirror")


def _image_up_azimuth(item: SectionReader) -> float:
    """Azimuth in the mirror frame, radians, of the direction at the top of the image."""
    rotation = Pose.from_rpy((0, 0, 0), item.get_vector("Direction")).rotation
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


def _read_texture_clients(file: IniFile) -> tuple[TextureClient, ...]:
    """Texture clients N, E, S, W, C, as USARSim spawns them, and U where the file has one."""
    clients = []
    for face in Face:
        section = file.get_section(f"USARBot.USARCameraTextureClient{face.name}")
        if face is Face.U and not file.has_section(section.name):
            continue
        # USARSim's key; another value than 90 leaves gaps between the faces or lets them overlap.
        fov = section.get_float("FOV", 90.0)
        if abs(fov - 90.0) > 1e-6:
            raise section.make_error("FOV", expected="90: the faces of a cube")
        clients.append(
            TextureClient(
                face=face,
                texture=section.get_str("DestTexture", f"OmniCam{face.name}"),
                fov_rad=math.radians(fov),
                size_px=section.get_int("TextureSize", 0, max_value=_MAX_SIDE_PX),
            )
        )
    return tuple(clients)


def _read_render_settings(
    file: IniFile, mirror: SectionReader, capture: SectionReader
) -> RenderSettings:
    return RenderSettings(
        surface=_read_surface(mirror),
        samples=capture.get_int("Samples", 0, max_value=16),
        # Faces share an atlas and one size; 0 lets the plan choose sizes by density.
        face_size_px=max(client.size_px for client in _read_texture_clients(file)),
        face_samples=capture.get_int("FaceSamples", 0, max_value=8),
        accuracy_target=AccuracyTarget(
            max_error_px=capture.get_float("MaxErrorPx", 0.0, min_value=0.0, max_value=1000.0),
            budget_ms=capture.get_float("BudgetMs", 0.0, min_value=0.0, max_value=60_000.0),
        ),
    )


def _read_surface(mirror: SectionReader) -> MirrorSurface:
    """Mirror surface: Polygons=N, or Sectors= and Rings=; 0 = the exact surface in each pixel."""
    name = mirror.get_choice(
        "Interpolation", [i.value for i in Interpolation], Interpolation.UV.value
    )
    interpolation = Interpolation(name)
    polygons = mirror.get_int("Polygons", 0, max_value=_MAX_POLYGONS)
    sectors = mirror.get_int("Sectors", 0, max_value=10_000)
    rings = mirror.get_int("Rings", 0, max_value=10_000)
    # An explicit grid wins over a polygon count, which only suggests one.
    if sectors or rings:
        if sectors < 3 or rings < 1:
            raise mirror.make_error(
                "Sectors", expected="Sectors of at least 3 with Rings of at least 1"
            )
        if 2 * sectors * rings > _MAX_POLYGONS:
            raise mirror.make_error(
                "Sectors",
                expected=f"at most {_MAX_POLYGONS} polygons, two for each sector and ring",
            )
        return Tessellation(sectors, rings, interpolation)
    if not polygons:
        return PerPixel()
    if polygons < 4:
        raise mirror.make_error("Polygons", expected="0 for the exact mirror, or at least 4")
    return tessellation_from_polygon_count(polygons, interpolation)
