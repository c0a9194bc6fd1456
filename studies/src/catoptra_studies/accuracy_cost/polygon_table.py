"""Displacement by mirror meshes at the paper's size, beside an independent table.

The table was derived in float64 and confirmed by OpenGL in float32, for the paper's mirror
(k = 11.546, rim at 120 degrees) in 360 x 360 px: rms and maximum over the covered pixel centres.
"""

from __future__ import annotations

import math

from catoptra_protocol.optics.mirrors import PAPER_MIRROR, HyperbolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.scene.mirror_mesh import Interpolation, Tessellation
from catoptra_studies.accuracy_cost.accuracy_levels import SQUARE_TESSELLATIONS, WIDE_TESSELLATIONS
from catoptra_studies.accuracy_cost.cost_results import PolygonRow
from catoptra_studies.camera_figures.polygon_figures import measure_polygon_error
from catoptra_studies.paper_values import PAPER_SIZE_PX
from catoptra_studies.study_subject import resize_camera

# rms and maximum in px by (sectors, rings): interpolation of positions, then of UV coordinates.
REFERENCE_DISPLACEMENT_PX = {
    (4, 4): ((39.6, 91.8), (37.5, 91.3)),
    (8, 8): ((9.706, 21.28), (11.3, 24.6)),
    (16, 16): ((2.422, 5.251), (2.95, 7.28)),
    (32, 32): ((0.6048, 1.317), (0.747, 2.03)),
    (64, 64): ((0.1512, 0.3315), (0.187, 0.543)),
    (8, 2): ((15.28, 24.87), (32.0, 85.6)),
    (16, 4): ((3.733, 6.606), (3.74, 10.2)),
    (32, 8): ((0.9279, 1.727), (0.959, 2.97)),
    (64, 16): ((0.2317, 0.4431), (0.241, 0.737)),
    (128, 32): ((0.0579, 0.1121), (0.0603, 0.193)),
}


def measure_polygon_rows(camera: OmniCamera) -> tuple[PolygonRow, ...]:
    """Measure all tessellations with both interpolations, at the paper's image size."""
    resized = resize_camera(camera, PAPER_SIZE_PX)
    return tuple(
        _polygon_row(resized, Tessellation(sectors, rings, interpolation))
        for interpolation in Interpolation
        for sectors, rings in (*SQUARE_TESSELLATIONS, *WIDE_TESSELLATIONS)
    )


def _polygon_row(camera: OmniCamera, tessellation: Tessellation) -> PolygonRow:
    error = measure_polygon_error(camera, tessellation)
    rms_px, max_px = reference_displacement_px(camera, tessellation)
    return PolygonRow(
        num_polygons=tessellation.num_polygons,
        sectors=tessellation.sectors,
        rings=tessellation.rings,
        interpolation=tessellation.interpolation.value,
        coverage=error.coverage,
        rms_px=error.rms_px,
        max_px=error.max_px,
        reference_rms_px=rms_px,
        reference_max_px=max_px,
    )


def reference_displacement_px(
    camera: OmniCamera, tessellation: Tessellation
) -> tuple[float, float]:
    """The table's rms and maximum; (0, 0) for any mirror but the paper's."""
    mirror = camera.mirror
    is_paper = isinstance(mirror, HyperbolicMirror) and math.isclose(mirror.k, PAPER_MIRROR.k)
    if not is_paper or not math.isclose(camera.rim_rad, math.radians(120.0)):
        # No None: the report leaves the columns out where no row has a reference.
        return 0.0, 0.0
    position, uv = REFERENCE_DISPLACEMENT_PX[tessellation.sectors, tessellation.rings]
    return position if tessellation.interpolation is Interpolation.POSITION else uv


def relative_tolerances(row: PolygonRow) -> tuple[float, float]:
    """Relative differences from the table that are allowed in rms and maximum."""
    # With UV coordinates the maker of a mesh is free to choose the face of a quadrilateral and its
    # diagonal, which moves the error of large polygons by more than the rounding of the table.
    return (0.15, 0.15) if row.interpolation == Interpolation.UV.value else (0.03, 0.05)


def is_within_tolerance(row: PolygonRow) -> bool:
    """Whether a row agrees with the table."""
    rms, maximum = relative_tolerances(row)
    return math.isclose(row.rms_px, row.reference_rms_px, rel_tol=rms) and math.isclose(
        row.max_px, row.reference_max_px, rel_tol=maximum
    )
