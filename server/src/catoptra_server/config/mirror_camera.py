"""Omnidirectional camera with a mirror, of a robot's section: the three groups of the paper.

`StaticMeshes` has the mirror, `CamTexActors` the effective viewpoint with texture clients,
`Cameras` the capture camera at the pinhole: elsewhere there would be no single viewpoint, so that
another position is an error. Source: Schmits & Visser 2009, section 3.

A new mirror is a reader here and a line of `_READERS`; parameters and domain are stated at its
class in `optics/mirrors`.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics import mirrors
from catoptra_protocol.optics.camera_rays import CENTRAL_ERROR_PX, near_limit_m
from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.elementary import arctan2, hypot
from catoptra_protocol.optics.mirrors import HyperbolicMirror, Mirror
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.camera_sections import (
    MAX_SIDE_PX,
    read_effect_settings,
    read_min_frame_interval_s,
    read_picture,
    read_render_settings,
    read_size,
    reject_impossible,
    require_on_robot,
    reserve_view,
)
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.known_names import is_own_section
from catoptra_server.config.robot_cameras import is_lens_camera, read_plane, require_picture
from catoptra_server.config.section_reader import SectionReader, read_columns
from catoptra_server.render.renderer import (
    MirrorSurface,
    PerPixel,
    require_mesh_viewpoint,
)
from catoptra_server.simulation.robot_description import (
    OmniCameraDescription,
    TextureClient,
)
from catoptra_server.world.mirror_mesh import (
    Interpolation,
    Tessellation,
    tessellation_from_polygon_count,
)

log = logging.getLogger(__name__)
# Up into the mirror, forward at the top of the image.
_LOOKING_UP = (0.0, 1.5708, 3.1416)
# Directions in real files have four digits: 1.5708 for a right angle.
_AXIS_TOLERANCE_RAD = 1e-3
_PINHOLE_TOLERANCE_M = 5e-5
"""Distance off the foci that counts as none: a capture camera so far off the pinhole displaces the
image by 0.04 px at 360 px. Beyond, the camera is no longer central, which is the effect
Misalignment, not a camera model."""
# The paper's meshes end at 4096. A million takes 0.3 GB while the lookup map is drawn.
_MAX_POLYGONS = 1_000_000
# A larger prime number of polygons is more likely a typing error than a grid.
_MAX_SINGLE_RING = 10


def read_mirror_camera(file: IniFile, section: SectionReader) -> OmniCameraDescription | None:
    """Camera of a robot's section; None where CamTexActors names no viewpoint.

    Raises:
        ConfigError: for a capture camera off the pinhole, an impossible mirror, a missing group, or
            a view larger than the file's limit.
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
    with reject_impossible(mirror_settings):
        mirror = _read_mirror(mirror_item, mirror_settings)
        camera, central_error_px = _approximate_viewpoint(
            mirror_settings, _read_camera_model(mirror, mirror_settings, capture, capture_item)
        )
    texture_clients = _read_texture_clients(file)
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
        effects=read_effect_settings(capture, has_viewpoint=camera.is_central),
    )
    reserve_view(file, capture, description)
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


def _read_viewpoint_pose(viewpoint: SectionReader) -> Pose:
    direction = viewpoint.get_vector("Direction", (0.0, 0.0, 0.0))
    position = viewpoint.get_vector("Position")
    require_on_robot(viewpoint, "Position", position)
    return Pose.from_rpy(position, direction)


def _read_texture_clients(file: IniFile) -> tuple[TextureClient, ...]:
    """Texture clients N, E, S, W, C, in USARSim's order, and U where the file has one."""
    names = {face: f"USARBot.USARCameraTextureClient{face.name}" for face in Face}
    missing = [n for face, n in names.items() if face is not Face.U and not file.has_section(n)]
    if missing:
        log.warning(
            "%s: no section %s: a texture client renders one side of what the mirror shows; it is "
            "served with FOV=90 and TextureSize=0; add the section with these lines to state them",
            file.path,
            ", ".join(f"[{name}]" for name in missing),
        )
    clients = []
    for face in Face:
        section = file.get_section(names[face])
        if face is Face.U and not file.has_section(section.name):
            continue
        # USARSim's key; another value than 90 leaves gaps or overlaps between the faces.
        fov = section.get_float("FOV", 90.0)
        if abs(fov - 90.0) > 1e-6:
            raise section.make_error("FOV", expected="90: the faces of a cube")
        clients.append(
            TextureClient(
                face=face,
                texture=section.get_str("DestTexture", f"OmniCam{face.name}"),
                fov_rad=math.radians(fov),
                size_px=section.get_int("TextureSize", 0, max_value=MAX_SIDE_PX),
            )
        )
    return tuple(clients)


def _read_mirror(item: SectionReader, settings: SectionReader) -> Mirror:
    """Mirror of an item of `StaticMeshes`, with the parameters in the section of its class.

    Raises:
        ConfigError: A mesh off the viewpoint, an unknown class, or an impossible parameter.
    """
    # The mesh's origin is the mirror's focus, which is the effective viewpoint.
    if any(
        abs(value) > _PINHOLE_TOLERANCE_M for value in item.get_vector("Position", (0.0, 0.0, 0.0))
    ):
        raise item.make_error(
            "Position", expected="(X=0,Y=0,Z=0): the viewpoint has the mesh's position"
        )
    item.get_vector("Direction", (0.0, 0.0, 0.0))
    item.get_str("ItemName")
    for name, reader in _READERS.items():
        if item.get_class_name("ItemClass") == name.lower():
            return reader(settings)
    names = ", ".join(f"Catoptra.{name}" for name in _READERS)
    raise item.make_error("ItemClass", expected=f"a mirror with a section: {names}")


def _read_hyperbolic(settings: SectionReader) -> Mirror:
    metres = _read_unit_m(settings, 0.1)
    k = settings.get_float("K", min_value=2.0)
    c_m = settings.get_float("C", min_value=0.0) * metres
    # The bounds above are closed, the mirror's domain is open: K=2 and C=0 fail here.
    try:
        return HyperbolicMirror(k, c_m)
    except DomainError as error:
        raise settings.make_error(
            "K" if k <= 2.0 else "C", expected=f"a possible value: {error}"
        ) from error


def _read_parabolic(settings: SectionReader) -> Mirror:
    radius = settings.get_float("HorizonRadius", min_value=1e-9)
    return mirrors.ParabolicMirror(radius * _read_unit_m(settings, 0.1))


def _read_spherical(settings: SectionReader) -> Mirror:
    metres = _read_unit_m(settings, 1.0)
    radius_m = settings.get_float("Radius", min_value=1e-9) * metres
    distance_m = settings.get_float("CentreDistance", min_value=1e-9) * metres
    return _make_mirror(
        settings, "CentreDistance", lambda rim: mirrors.SphericalMirror(radius_m, distance_m, rim)
    )


def _read_conical(settings: SectionReader) -> Mirror:
    half_rad = math.radians(settings.get_float("HalfAngle", min_value=0.1, max_value=89.9))
    distance_m = settings.get_float("ApexDistance", min_value=1e-9) * _read_unit_m(settings, 1.0)
    return _make_mirror(
        settings, "HalfAngle", lambda rim: mirrors.ConicalMirror(half_rad, distance_m, rim)
    )


def _read_equiangular(settings: SectionReader) -> Mirror:
    gain = settings.get_float("Gain", min_value=1.0, max_value=1000.0)
    distance_m = settings.get_float("VertexDistance", min_value=1e-9) * _read_unit_m(settings, 1.0)
    return _make_mirror(
        settings, "Gain", lambda rim: mirrors.EquiangularMirror(gain, distance_m, rim)
    )


def _read_profile(settings: SectionReader) -> Mirror:
    metres = _read_unit_m(settings, 1.0)
    radii, sags = _read_table(settings, "Profile", ("Radii", "Sags"))
    radii_m = tuple(radius * metres for radius in radii)
    # A measuring machine starts at any height.
    sags_m = tuple((sag - sags[0]) * metres for sag in sags)
    distance_m = settings.get_float("VertexDistance", min_value=1e-9) * metres
    key = "Profile" if settings.has_key("Profile") else "Sags"
    return _make_mirror(
        settings, key, lambda rim: mirrors.ProfileMirror(radii_m, sags_m, distance_m, rim)
    )


def _read_radial_table(settings: SectionReader) -> Mirror:
    angles, radii = _read_table(settings, "Table", ("Angles", "Radii"))
    focal = settings.get_float("FocalLength", 1.0, min_value=1e-9)
    ratios = tuple(radius / focal for radius in radii)
    distance_m = settings.get_float("VertexDistance", min_value=1e-9) * _read_unit_m(settings, 1.0)
    key = "Table" if settings.has_key("Table") else "Radii"
    return _make_mirror(
        settings, key, lambda rim: mirrors.RadialTableMirror(angles, ratios, distance_m, rim)
    )


_READERS: dict[str, Callable[[SectionReader], Mirror]] = {
    "HyperbolicMirror": _read_hyperbolic,
    "ParabolicMirror": _read_parabolic,
    "SphericalMirror": _read_spherical,
    "ConicalMirror": _read_conical,
    "EquiangularMirror": _read_equiangular,
    "ProfileMirror": _read_profile,
    "RadialTableMirror": _read_radial_table,
}


def _read_table(
    settings: SectionReader, file_key: str, keys: tuple[str, str]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Two columns of the same length: of the file of a key, or of a key each."""
    if settings.has_key(file_key):
        first, second = read_columns(settings, file_key, keys)
        return first, second
    first, second = (settings.get_floats(key) for key in keys)
    return first, second


def _read_unit_m(settings: SectionReader, default: float) -> float:
    return settings.get_float("MetresPerUnit", default, min_value=1e-9)


def _make_mirror(settings: SectionReader, key: str, make: Callable[[float], Mirror]) -> Mirror:
    """Mirror up to its rim; an impossible one is an error at the key, or at the rim."""
    rim_rad = _read_rim_rad(settings)
    try:
        return make(rim_rad)
    except DomainError as error:
        where = "RimAngle" if str(error).startswith("a rim") else key
        raise settings.make_error(where, expected=f"a possible value: {error}") from error


def _read_rim_rad(settings: SectionReader) -> float:
    """Incidence angle at the rim of a mirror."""
    return math.radians(settings.get_float("RimAngle", 120.0, min_value=1.0, max_value=179.0))


def _read_camera_model(
    mirror: Mirror, settings: SectionReader, capture: SectionReader, item: SectionReader
) -> OmniCamera:
    _require_at_pinhole(mirror, item)
    width_px, height_px = read_size(capture, 360, 360)
    try:
        camera = camera_with_inscribed_rim(
            mirror,
            width_px=width_px,
            height_px=height_px,
            rim_rad=_read_rim_rad(settings),
            image_up_azimuth_rad=_image_up_azimuth(item),
            picture=read_picture(capture, Picture.MIRRORED),
        )
        calibrated = _read_calibrated_plane(capture, camera)
        if calibrated != camera:
            require_picture(capture, calibrated)
        return calibrated
    except DomainError as error:
        raise settings.make_error("RimAngle", expected=f"a possible value: {error}") from error


def _read_calibrated_plane(capture: SectionReader, camera: OmniCamera) -> OmniCamera:
    """The camera with the capture lens's focal length and centre of a calibration, where stated."""
    centre_px = (
        capture.get_float("CentreU", camera.centre_px[0]),
        capture.get_float("CentreV", camera.centre_px[1]),
    )
    plain_px = 1.0 / camera.inverse_focal_length if camera.inverse_focal_length else 0.0
    focal_px = capture.get_float("FocalLength", plain_px, min_value=1e-6)
    if not plain_px:
        return replace(camera, centre_px=centre_px)
    return replace(
        camera,
        centre_px=centre_px,
        scale_px=camera.scale_px * focal_px / plain_px,
        plane=read_plane(capture, focal_px),
    )


def _require_at_pinhole(mirror: Mirror, item: SectionReader) -> None:
    """Raise ConfigError for a capture camera off the pinhole or the axis, which is not central."""
    direction = item.get_vector("Direction", _LOOKING_UP)
    forward = Pose.from_rpy((0, 0, 0), direction).rotation[:, 0]
    if hypot(*(forward - (0.0, 0.0, -1.0))) > _AXIS_TOLERANCE_RAD:
        raise item.make_error("Direction", expected="a pitch Y=1.5708, looking up into the mirror")
    if not item.has_key("Position"):  # at the pinhole, then
        return
    position = np.asarray(item.get_vector("Position"))
    # A parabolic mirror's pinhole is at infinity: an orthographic camera anywhere on the axis.
    if math.isinf(mirror.pinhole_distance_m):
        off = float(hypot(position[0], position[1]))
        pinhole = "on the axis (X=0,Y=0)"
    else:
        off = hypot(*(position - (0.0, 0.0, mirror.pinhole_distance_m)))
        pinhole = f"(X=0,Y=0,Z={mirror.pinhole_distance_m:g}), the mirror's second focus"
    if off > _PINHOLE_TOLERANCE_M:
        raise item.make_error(
            "Position",
            expected=f"the pinhole {pinhole}, or no Position; it is {1e3 * off:.3g} mm off",
        )


def _image_up_azimuth(item: SectionReader) -> float:
    """Azimuth in the mirror frame, radians, of the direction at the top of the image."""
    direction = item.get_vector("Direction", _LOOKING_UP)
    rotation = Pose.from_rpy((0, 0, 0), direction).rotation
    up = -rotation[:, 2]
    azimuth = arctan2(float(up[1]), float(up[0]))
    # 1.5708 in a file means a quarter turn exactly: the residual of 4e-6 rad would rotate the image
    # and break the symmetry of the faces.
    quarters = azimuth / (0.5 * math.pi)
    nearest = round(quarters)
    near = abs(quarters - nearest) < 1e-4
    return (nearest % 4) * 0.5 * math.pi if near else azimuth


def _approximate_viewpoint(settings: SectionReader, camera: OmniCamera) -> tuple[OmniCamera, float]:
    """The camera with rays that meet in one viewpoint, where the mirror's section says so.

    `auto` approximates where no point outside the mirror errs by more than CentralErrorPx, which
    holds for measured hyperboloids, and leaves other mirrors to each frame; `always` everywhere,
    and each frame states the error.

    Returns:
        The camera; the error of approximation that a frame may accept, px, 0 for none.
    """
    mode = settings.get_choice("Central", ("auto", "always", "never"), "auto")
    error_px = settings.get_float("CentralErrorPx", CENTRAL_ERROR_PX, min_value=1e-6)
    if camera.is_central or mode == "never":
        return camera, 0.0
    r, z = camera.mirror.surface_point(np.linspace(camera.projection.t_min, camera.rim_t, 65))
    nearest_m = float(hypot(r, z).min())
    if mode == "auto" and near_limit_m(camera, error_px) > nearest_m:
        return camera, error_px
    return replace(camera, is_approximated=True), 0.0


def _read_surface(camera: OmniCamera, settings: SectionReader) -> MirrorSurface:
    """Mirror surface: Polygons=N, or Sectors= and Rings=; 0 = the exact surface in each pixel."""
    surface = _read_mesh(settings)
    if isinstance(surface, PerPixel):
        return surface
    try:
        require_mesh_viewpoint(camera)
    except DomainError as error:
        key = "Polygons" if settings.has_key("Polygons") else "Sectors"
        raise settings.make_error(key, expected=str(error)) from error
    return surface


def _read_mesh(mirror: SectionReader) -> MirrorSurface:
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
    tessellation = tessellation_from_polygon_count(polygons, interpolation)
    if tessellation.rings == 1 and polygons > _MAX_SINGLE_RING:
        counts = (polygons - 1, polygons + 1)
        near = next(n for n in counts if tessellation_from_polygon_count(n).rings > 1)
        raise mirror.make_error(
            "Polygons",
            expected=f"the size of a grid, such as {near}: {polygons} is one ring of as many "
            "sectors, which Sectors and Rings make",
        )
    return tessellation


def _capture_fov(camera: OmniCamera) -> float:
    """Field of view of the capture camera over the rim, radians; 0 for an orthographic camera."""
    if math.isinf(camera.mirror.pinhole_distance_m):
        return 0.0
    r, z = camera.mirror.surface_point(np.array(camera.rim_t))
    return 2.0 * arctan2(float(r), camera.mirror.pinhole_distance_m - float(z))
