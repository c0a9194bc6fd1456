"""The mirror of an omnidirectional camera: its class with parameters, and the mesh drawn for it.

A new mirror is a reader, with its line in `_READERS`.

Wide-angle cameras without a mirror: items of `Cameras=` whose class's section has a `Lens`, or a
`CalibrationFile` of another program.

The camera looks along the item's x axis, as an ordinary camera does; its y axis is the right of the
image. The lens's own keys are those of `LENS_PARAMETERS` without the prefix Lens.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.camera_conf import LENS_PARAMETERS
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera_rays import CENTRAL_ERROR_PX, near_limit_m, ray_from_pixel
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import LENSES
from catoptra_protocol.optics.mirrors import (
    ConicalMirror,
    EquiangularMirror,
    HyperbolicMirror,
    Mirror,
    ParabolicMirror,
    ProfileMirror,
    RadialTableMirror,
    SphericalMirror,
)
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture, RadialProjection, largest_angle_rad
from catoptra_protocol.optics.transforms import LENS_FROM_MIRROR
from catoptra_server.config.camera_sections import (
    MAX_SIDE_PX,
    read_lens_effect_settings,
    read_min_frame_interval_s,
    read_mount,
    read_picture,
    read_render_settings,
    reserve_view,
)
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.section_reader import SectionReader, read_columns
from catoptra_server.render.render_settings import MirrorSurface, PerPixel
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES, MemoryBudget
from catoptra_server.simulation.robot_description import OmniCameraDescription
from catoptra_server.world.mirror_mesh import (
    Interpolation,
    Tessellation,
    tessellation_from_polygon_count,
)

PINHOLE_TOLERANCE_M = 5e-5
"""Distance off the foci that counts as none: a capture camera so far off the pinhole displaces the
image by 0.04 px at 360 px. Beyond, the camera is no longer central, which is the effect
Misalignment, not a camera model."""

# The paper's meshes end at 4096. A million take 0.3 GB while they are drawn into the lookup map.
_MAX_POLYGONS = 1_000_000
# A larger prime number of polygons is more likely a typing error than a grid.
_MAX_SINGLE_RING = 10


def read_mirror(item: SectionReader, settings: SectionReader) -> Mirror:
    """Mirror of an item of `StaticMeshes`, with the parameters of its class's section.

    Raises:
        ConfigError: A mesh off the viewpoint, an unknown class, or an impossible parameter.
    """
    # The mesh's origin is the mirror's focus, which is the effective viewpoint.
    if any(
        abs(value) > PINHOLE_TOLERANCE_M for value in item.get_vector("Position", (0.0, 0.0, 0.0))
    ):
        raise item.make_error(
            "Position", expected="(X=0,Y=0,Z=0): the viewpoint has the mesh's position"
        )
    item.get_vector("Direction", (0.0, 0.0, 0.0))
    item.get_str("ItemName")
    reader = _READERS.get(settings.name.rpartition(".")[2].lower())
    if reader is None:
        names = ", ".join(f"Catoptra.{name}" for name in _CLASS_NAMES)
        raise item.make_error("ItemClass", expected=f"a mirror with a section: {names}")
    return reader(settings)


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
    return ParabolicMirror(radius * _read_unit_m(settings, 0.1))


def _read_spherical(settings: SectionReader) -> Mirror:
    metres = _read_unit_m(settings, 1.0)
    radius_m = settings.get_float("Radius", min_value=1e-9) * metres
    distance_m = settings.get_float("CentreDistance", min_value=1e-9) * metres
    return _make(settings, "CentreDistance", lambda rim: SphericalMirror(radius_m, distance_m, rim))


def _read_conical(settings: SectionReader) -> Mirror:
    half_rad = math.radians(settings.get_float("HalfAngle", min_value=0.1, max_value=89.9))
    distance_m = settings.get_float("ApexDistance", min_value=1e-9) * _read_unit_m(settings, 1.0)
    return _make(settings, "HalfAngle", lambda rim: ConicalMirror(half_rad, distance_m, rim))


def _read_equiangular(settings: SectionReader) -> Mirror:
    gain = settings.get_float("Gain", min_value=1.0, max_value=1000.0)
    distance_m = settings.get_float("VertexDistance", min_value=1e-9) * _read_unit_m(settings, 1.0)
    return _make(settings, "Gain", lambda rim: EquiangularMirror(gain, distance_m, rim))


def _read_profile(settings: SectionReader) -> Mirror:
    metres = _read_unit_m(settings, 1.0)
    radii, sags = _read_table(settings, "Profile", ("Radii", "Sags"))
    radii_m = tuple(radius * metres for radius in radii)
    # A measuring machine has a zero of its own.
    sags_m = tuple((sag - sags[0]) * metres for sag in sags)
    distance_m = settings.get_float("VertexDistance", min_value=1e-9) * metres
    key = "Profile" if settings.has_key("Profile") else "Sags"
    return _make(settings, key, lambda rim: ProfileMirror(radii_m, sags_m, distance_m, rim))


def _read_radial_table(settings: SectionReader) -> Mirror:
    angles, radii = _read_table(settings, "Table", ("Angles", "Radii"))
    focal = settings.get_float("FocalLength", 1.0, min_value=1e-9)
    ratios = tuple(radius / focal for radius in radii)
    distance_m = settings.get_float("VertexDistance", min_value=1e-9) * _read_unit_m(settings, 1.0)
    key = "Table" if settings.has_key("Table") else "Radii"
    return _make(settings, key, lambda rim: RadialTableMirror(angles, ratios, distance_m, rim))


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


def _make(settings: SectionReader, key: str, make: Callable[[float], Mirror]) -> Mirror:
    """Mirror up to its rim; an impossible one is an error at the key, or at the rim."""
    rim_rad = math.radians(read_rim_deg(settings))
    try:
        return make(rim_rad)
    except DomainError as error:
        where = "RimAngle" if str(error).startswith("a rim") else key
        raise settings.make_error(where, expected=f"a possible value: {error}") from error


_CLASS_NAMES = (
    "HyperbolicMirror",
    "ParabolicMirror",
    "SphericalMirror",
    "ConicalMirror",
    "EquiangularMirror",
    "ProfileMirror",
    "RadialTableMirror",
)
_READERS: dict[str, Callable[[SectionReader], Mirror]] = {
    "hyperbolicmirror": _read_hyperbolic,
    "parabolicmirror": _read_parabolic,
    "sphericalmirror": _read_spherical,
    "conicalmirror": _read_conical,
    "equiangularmirror": _read_equiangular,
    "profilemirror": _read_profile,
    "radialtablemirror": _read_radial_table,
}


def read_rim_deg(settings: SectionReader) -> float:
    """Angle at the rim of a mirror, degrees."""
    return settings.get_float("RimAngle", 120.0, min_value=1.0, max_value=179.0)


def approximate_viewpoint(settings: SectionReader, camera: OmniCamera) -> tuple[OmniCamera, float]:
    """The camera with rays that meet in one viewpoint, where its mirror's section wants that.

    `auto` approximates where no point outside the mirror errs by more than CentralErrorPx, which
    holds for measured hyperboloids, and leaves other mirrors to each frame; `always` everywhere,
    and each frame states the error.

    Returns:
        The camera; the error up to which a frame may approximate it, px, 0 for none.
    """
    mode = settings.get_choice("Central", ("auto", "always", "never"), "auto")
    error_px = settings.get_float("CentralErrorPx", CENTRAL_ERROR_PX, min_value=1e-6)
    if camera.is_central or mode == "never":
        return camera, 0.0
    r, z = camera.mirror.surface_point(np.linspace(camera.projection.t_min, camera.rim_t, 65))
    nearest_m = float(np.hypot(r, z).min())
    if mode == "auto" and near_limit_m(camera, error_px) > nearest_m:
        return camera, error_px
    return replace(camera, is_approximated=True), 0.0


def read_surface(mirror: SectionReader) -> MirrorSurface:
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


# Pixels along a side among which one that sees something is looked for: a field that fits between
# them is none that anybody wants.
_GRID_SIDE = 33
# Anamorphic lenses squeeze by 2.
_MAX_ASPECT = 10.0


def is_lens_camera(file: IniFile, item: SectionReader) -> bool:
    """Whether the section of an item's class has a lens."""
    section = file.get_section(item.get_str("ItemClass"))
    return section.has_key("Lens") or section.has_key("CalibrationFile")


def read_lens_camera(
    file: IniFile,
    robot: SectionReader,
    item: SectionReader,
    *,
    limit_bytes: int = DEFAULT_LIMIT_BYTES,
) -> OmniCameraDescription:
    """Camera of an item, with lens, resolution and effects of the section of its class.

    Raises:
        ConfigError: For an unknown lens, an impossible parameter, a field of view beyond the lens's
            domain or first fold, or a view that takes more than `limit_bytes`.
    """
    section = file.get_section(item.get_str("ItemClass"))
    if section.has_key("CalibrationFile"):
        camera = _read_calibrated_camera(file, section)
    else:
        camera = _read_camera(section)
    _require_picture(section, camera)
    mount = read_mount(robot, item)
    description = OmniCameraDescription(
        name=item.get_wire_name("ItemName"),
        camera=camera,
        robot_from_mirror=mount.parent_from_item() @ LENS_FROM_MIRROR,
        texture_clients=(),
        render_settings=read_render_settings(
            section,
            surface=PerPixel(),
            face_size_px=section.get_int("TextureSize", 0, max_value=MAX_SIDE_PX),
        ),
        min_frame_interval_s=read_min_frame_interval_s(section),
        capture_fov_rad=2.0 * camera.rim_rad,
        effects=read_lens_effect_settings(section),
        parent=mount.parent,
    )
    reserve_view(description, section, MemoryBudget(limit_bytes))
    return description


def _read_calibrated_camera(file: IniFile, section: SectionReader) -> OmniCamera:
    """Camera of a calibration file, in a narrower field of view if the section has one."""
    path = section.get_path("CalibrationFile", file.path.parent)
    name = section.get_str("CalibrationCamera", "")
    picture = read_picture(section, Picture.FLIPPED) if section.has_key("Picture") else None
    camera = camera_from_file(path, camera=name, picture=picture)
    for key, side_px in (("ResolutionX", camera.width_px), ("ResolutionY", camera.height_px)):
        if section.get_int(key, side_px, min_value=1, max_value=MAX_SIDE_PX) != side_px:
            raise section.make_error(
                key, expected=f"{side_px}, as in the calibration file, or no such line"
            )
    field_deg = section.get_float("FieldOfView", 0.0, min_value=0.1, max_value=360.0)
    rim_rad = math.radians(0.5 * field_deg)
    if not field_deg:
        return camera
    if rim_rad > camera.rim_rad:
        reach = math.degrees(2.0 * camera.rim_rad)
        raise section.make_error(
            "FieldOfView",
            expected=f"at most {reach:.3f} deg: the calibration's image or first fold",
        )
    return dataclasses.replace(camera, rim_rad=rim_rad)


def _read_camera(section: SectionReader) -> OmniCamera:
    projection = _read_lens(section)
    width_px = section.get_int("ResolutionX", 640, min_value=1, max_value=MAX_SIDE_PX)
    height_px = section.get_int("ResolutionY", 640, min_value=1, max_value=MAX_SIDE_PX)
    picture = read_picture(section, Picture.FLIPPED)
    field_deg = section.get_float("FieldOfView", 0.0, min_value=0.1, max_value=360.0)
    rim_rad = math.radians(0.5 * field_deg)
    focal_length_px = section.get_float("FocalLength", 0.0, min_value=1e-6)
    key = "FieldOfView"
    try:
        if not focal_length_px:
            key = "FieldOfView" if field_deg else "FocalLength"
            if not field_deg:
                raise DomainError(
                    "a lens has a FocalLength in px, a FieldOfView in degrees or both"
                )
            return camera_with_inscribed_rim(
                projection, width_px=width_px, height_px=height_px, rim_rad=rim_rad, picture=picture
            )
        centre_px = (
            section.get_float("CentreU", 0.5 * width_px),
            section.get_float("CentreV", 0.5 * height_px),
        )
        plane = _read_plane(section, focal_length_px)
        if not field_deg:
            corner_px = max(
                math.hypot(u - centre_px[0], v - centre_px[1])
                for u in (0.0, width_px)
                for v in (0.0, height_px)
            )
            ratio = corner_px / focal_length_px / plane.stretch_limits[0]
            rim_rad = largest_angle_rad(projection, ratio)
        return OmniCamera(
            projection,
            width_px,
            height_px,
            centre_px,
            focal_length_px,
            rim_rad,
            0.0,
            picture,
            plane,
        )
    except DomainError as error:
        raise section.make_error(key, expected=f"a possible value: {error}") from error


def _require_picture(section: SectionReader, camera: OmniCamera) -> None:
    """Raise ConfigError for a camera whose picture is black all over: of a wrong unit, mostly."""
    side = np.linspace(0.0, 1.0, _GRID_SIDE)
    u, v = (np.floor(side * (length - 1)) + 0.5 for length in (camera.width_px, camera.height_px))
    pixels = np.stack(np.meshgrid(u, v), axis=-1)
    if ray_from_pixel(camera, pixels.reshape(-1, 2))[2].any():
        return
    centre_u, centre_v = camera.centre_px
    wrong = {
        "CentreU": not 0.0 <= centre_u <= camera.width_px,
        "CentreV": not 0.0 <= centre_v <= camera.height_px,
        "FieldOfView": section.has_key("FieldOfView"),
        "FocalLength": True,
    }
    raise section.make_error(
        next(key for key, is_wrong in wrong.items() if is_wrong),
        expected="a camera that shows something, with lengths in px and angles in degrees: of "
        f"{camera.width_px} x {camera.height_px} px, its field of "
        f"{math.degrees(2.0 * camera.rim_rad):.4g} deg is {2.0 * camera.rim_radius_px:.3g} px wide "
        f"around ({centre_u:g}, {centre_v:g})",
    )


def _read_lens(section: SectionReader) -> RadialProjection:
    """Lens by its name, with its parameters; those with a default may be missing."""
    name = section.get_choice("Lens", list(LENSES))
    lens = LENSES[name]
    fields = {field.name: field for field in dataclasses.fields(lens)}  # type: ignore[arg-type]
    values: dict[str, float | tuple[float, ...]] = {}
    keys = ["Lens"]
    for wire_name, attribute in LENS_PARAMETERS[name]:
        key = wire_name.removeprefix("Lens")
        is_optional = fields[attribute].default is not dataclasses.MISSING
        if is_optional and not section.has_key(key):
            continue
        keys.append(key)
        is_table = "tuple" in str(fields[attribute].type)
        values[attribute] = section.get_floats(key) if is_table else section.get_float(key)
    try:
        return lens(**values)
    except DomainError as error:
        # Models name the parameter that is out of its domain; tables as a whole are the last key.
        named = (key for key in keys[1:] if re.search(rf"\b{key}\b", str(error), re.IGNORECASE))
        key = next(named, keys[-1])
        raise section.make_error(key, expected=f"a possible value: {error}") from error


def _read_plane(section: SectionReader, focal_length_px: float) -> ImagePlane:
    """Stretch by a second focal length and a skew, or by OCamCalib's matrix; and decentring."""
    p1, p2 = section.get_float("P1", 0.0), section.get_float("P2", 0.0)
    if section.has_key("Stretch"):
        values = section.get_floats("Stretch")
        if len(values) != 4:
            raise section.make_error("Stretch", expected="a 2 x 2 matrix: four numbers")
        a, b, c, d = values
        return ImagePlane((a, b, c, d), p1, p2)
    skew = section.get_float("Skew", 0.0) / focal_length_px
    aspect = section.get_float("FocalLengthY", focal_length_px, min_value=1e-6) / focal_length_px
    if not 1.0 / _MAX_ASPECT <= aspect <= _MAX_ASPECT:
        raise section.make_error(
            "FocalLengthY",
            expected=f"px, as FocalLength={focal_length_px:g}: at most {_MAX_ASPECT:g} times as "
            "long or short",
        )
    return ImagePlane((1.0, skew, 0.0, aspect), p1, p2)
