"""The mirror of an omnidirectional camera: its class with parameters, and the mesh drawn for it.

A new mirror is a case of `read_mirror`.
"""

from __future__ import annotations

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors import HyperbolicMirror, Mirror, ParabolicMirror
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.robot.render_settings import MirrorSurface, PerPixel
from catoptra_server.scene.mirror_mesh import (
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
