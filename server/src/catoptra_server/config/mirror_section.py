"""The mirror of an omnidirectional camera: its class with parameters, and the mesh drawn for it.

A new mirror is a reader, with its line in `_READERS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera_rays import CENTRAL_ERROR_PX, near_limit_m
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
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.config.number_columns import read_columns
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.render.render_settings import MirrorSurface, PerPixel
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
