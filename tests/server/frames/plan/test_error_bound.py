"""Bounds and their parts; tests/server/render/test_error_bound.py tests that they hold."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera_rays import pixel_from_point
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import (
    MIRRORS,
    PAPER_MIRROR,
    ConicalMirror,
    HyperbolicMirror,
    Mirror,
    ParabolicMirror,
    SphericalMirror,
)
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_server.frames.plan.error_bound import (
    ErrorBound,
    SceneDisplacement,
    angle_error,
    error_bound,
    scene_error,
)
from catoptra_server.frames.plan.faces import TexelFootprint, texel_footprint
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.projection.atlas import GUARD_TEXELS, atlas_coordinates, pack_atlas
from catoptra_server.render.renderer import MirrorSurface, PerPixel, RenderPlan, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation
from helpers.mirror_checks import MIRROR_EXAMPLES
from helpers.mirror_checks import make_camera as make_mirror_camera
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=360)
TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER


def make_plan(kind: RendererKind, surface: MirrorSurface, samples: int = 2) -> RenderPlan:
    return plan_from_settings(RenderSettings(surface, samples), CAMERA, kind=kind, reason="test")


def make_bound(kind: RendererKind, surface: MirrorSurface, samples: int = 2) -> ErrorBound:
    return error_bound(CAMERA, make_plan(kind, surface, samples))


def component_px(bound: ErrorBound, name: str) -> float:
    """Largest displacement by one cause."""
    return next(part.max_px for part in bound.components if part.name == name)


@pytest.mark.parametrize(
    ("kind", "surface", "names"),
    [
        (TRACE, PerPixel(), ["rounding"]),
        (RASTER, PerPixel(), ["faces", "rounding"]),
        (TRACE, Tessellation(16, 16), ["polygons", "rounding", "rim"]),
        (RASTER, Tessellation(16, 16), ["polygons", "faces", "corners", "rounding", "rim"]),
    ],
    ids=["trace", "raster", "traced polygons", "rastered polygons"],
)
def test_bound_has_the_components_of_its_plan_with_reasons(
    kind: RendererKind, surface: MirrorSurface, names: list[str]
) -> None:
    parts = make_bound(kind, surface).components
    assert [part.name for part in parts] == names
    assert all(part.reason and part.max_px > 0.0 for part in parts)


def test_components_add_up_in_the_worst_ring_but_for_the_rim() -> None:
    whole = make_bound(RASTER, Tessellation(16, 16))
    parts = [part.max_px for part in whole.components if part.name != "rim"]
    assert max(parts) < whole.geometric.max_px <= sum(parts) + 1e-9
    assert whole.geometric.max_px == max(whole.geometric.by_radius_px)
    alone = make_bound(TRACE, PerPixel())
    assert alone.geometric.max_px == pytest.approx(component_px(alone, "rounding"))


@pytest.mark.parametrize("kind", [TRACE, RASTER])
def test_bound_at_a_place_follows_the_scale_of_the_image_there(kind: RendererKind) -> None:
    bound = make_bound(kind, PerPixel())
    places_px = [bound.outline_error_at_px(place) for place in np.linspace(0.0, 1.0, 65).tolist()]
    assert max(places_px) == pytest.approx(bound.outline_error_px)
    assert min(places_px) - bound.sampling.edge_error_px < 0.8 * bound.geometric.max_px


def test_rim_dominates_with_few_sectors_and_many_rings() -> None:
    camera = make_omni_camera(width_px=360, rim_deg=60.0)
    tessellation = Tessellation(8, 64, Interpolation.POSITION)
    few = plan_from_settings(RenderSettings(tessellation), camera, kind=TRACE, reason="test")
    whole = error_bound(camera, few)
    assert whole.geometric.max_px == component_px(whole, "rim")


def test_repeated_bound_is_cached() -> None:
    assert make_bound(RASTER, Tessellation(8, 8)) is make_bound(RASTER, Tessellation(8, 8))


def test_bound_as_a_dict_has_a_number_for_each_name() -> None:
    numbers = make_bound(RASTER, PerPixel()).numbers_by_name()
    assert set(numbers) == {
        *("max_px", "rms_px", "max_deg", "rms_deg"),
        *("edge_px", "outline_px", "marker_px"),
        *("texels_per_px_min", "texels_per_px_median", "texels_per_px_max"),
        *("faces_px", "rounding_px"),
    }
    assert all(isinstance(value, float) for value in numbers.values())
    assert "texels_per_px_min" not in make_bound(TRACE, PerPixel()).numbers_by_name()


def test_errors_of_outlines_and_markers_are_displacement_plus_sampling() -> None:
    whole = make_bound(RASTER, PerPixel())
    assert whole.outline_error_px == whole.geometric.max_px + whole.sampling.edge_error_px
    assert whole.marker_error_px == whole.geometric.max_px + whole.sampling.centroid_error_px


def test_bound_when_printed_names_total_components_and_samples() -> None:
    text = str(make_bound(RASTER, Tessellation(16, 16)))
    assert text.startswith("outlines are displaced by at most 8.2")
    assert "(polygons 7.3, faces 0.58, " in text
    assert "edge 0.35), samples by 7.9" in text
    assert text.endswith("texels a px, undersampled")


def test_bound_of_trace_when_printed_has_no_texels() -> None:
    assert "texels" not in str(make_bound(TRACE, PerPixel()))


def test_mesh_under_an_orthographic_camera_has_no_bound() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03))
    with pytest.raises(DomainError, match="pinhole"):
        error_bound(camera, make_plan(TRACE, Tessellation(8, 8)))


# Sixteenths of a texel: the standard patterns that Direct3D 11.1 prescribes and drivers share.
PATTERNS = {
    1: [(8, 8)],
    2: [(12, 12), (4, 4)],
    4: [(6, 2), (14, 6), (2, 10), (10, 14)],
    8: [(9, 5), (7, 11), (13, 9), (5, 3), (3, 13), (1, 7), (11, 15), (15, 1)],
}
EDGE_OFFSETS = np.linspace(0.0, 1.0, 17)


def displacement_texels(samples: int, middle: Floats, radius: float) -> float:
    """Distance from a disc's edge to the farthest point on the wrong side."""
    texel = np.arange(-math.ceil(radius + 2), math.ceil(radius + 3))
    points = (
        texel[:, None]
        + np.array(PATTERNS[samples]).T[:, None, :] / 16.0
        - 0.5
        - middle[:, None, None]
    )
    x, y = points
    covered = (np.hypot(x[:, None], y[None, :]) < radius).mean(axis=-1)
    corners = [covered[:-1, :-1], covered[1:, :-1], covered[:-1, 1:], covered[1:, 1:]]
    column, row = np.nonzero(np.ptp(corners, axis=0) > 0.0)
    c00, c10, c01, c11 = (corner[column, row][:, None, None] for corner in corners)
    u, v = EDGE_OFFSETS[:, None], EDGE_OFFSETS[None, :]
    light = (1 - v) * ((1 - u) * c00 + u * c10) + v * ((1 - u) * c01 + u * c11)
    at_x = texel[column][:, None, None] + u - middle[0]
    at_y = texel[row][:, None, None] + v - middle[1]
    inside = radius - np.hypot(at_x, at_y)
    wrong = ((light > 0.5 + 1e-9) & (inside < 0.0)) | ((light < 0.5 - 1e-9) & (inside > 0.0))
    return float(np.abs(inside[wrong]).max(initial=0.0))


def faces_bound(samples: int, face_size_px: int = 365) -> tuple[ErrorBound, TexelFootprint]:
    """Bound of faces with samples a texel, and the footprint of their texels."""
    settings = RenderSettings(face_size_px=face_size_px, face_samples=samples)
    plan = plan_from_settings(settings, CAMERA, kind=RASTER, reason="test")
    return error_bound(CAMERA, plan), texel_footprint(CAMERA, plan.face_regions)


def bound_texels(samples: int) -> float:
    """Bound on the displacement of an edge."""
    bound, footprint = faces_bound(samples)
    return component_px(bound, "faces") / footprint.max_px


@pytest.mark.parametrize("samples", PATTERNS)
def test_edges_are_displaced_nearly_up_to_the_bound(samples: int) -> None:
    rng = np.random.default_rng(samples)
    displaced = [
        displacement_texels(samples, rng.uniform(-0.5, 0.5, 2), radius)
        for radius in np.concatenate((rng.uniform(2.0, 2.3, 500), rng.uniform(2.3, 20.0, 100)))
    ]
    # Beside the pattern, hardware rounds corners and coordinates to 256ths of a texel.
    bound = bound_texels(samples) - math.sqrt(2.0) / 256.0
    assert max(displaced) <= bound < 1.3 * max(displaced)


def test_untabulated_samples_count_as_the_next_lower() -> None:
    assert bound_texels(3) == bound_texels(2)
    assert bound_texels(32) == bound_texels(16)
    assert bound_texels(1) > bound_texels(2) > bound_texels(4) > bound_texels(8)


def test_error_is_half_a_texel_of_the_image_and_a_little() -> None:
    bound, _ = faces_bound(1)
    faces_px = component_px(bound, "faces")
    # One texel a pixel where there are fewest.
    assert 0.5 < faces_px < 0.6
    # Rounding adds ten thousandths.
    degrees = math.degrees(bound_texels(1) * 2.0 / 365)
    assert bound.geometric.max_deg == pytest.approx(degrees, rel=1e-2)
    assert 0.2 * faces_px < bound.geometric.rms_px < faces_px / math.sqrt(3.0)


def rounding_px(
    camera: OmniCamera,
    kind: RendererKind,
    surface: MirrorSurface = PerPixel(),  # noqa: B008 - frozen
) -> float:
    plan = plan_from_settings(RenderSettings(surface), camera, kind=kind, reason="test")
    return component_px(error_bound(camera, plan), "rounding")


@pytest.mark.parametrize(
    ("mirror", "rim_deg"),
    [(PAPER_MIRROR, 120.0), (HyperbolicMirror(2.1, 0.2), 100.0), (ParabolicMirror(0.03), 135.0)],
    ids=str,
)
def test_atlas_coordinates_are_more_precise_than_their_bound(
    mirror: Mirror, rim_deg: float
) -> None:
    camera = make_omni_camera(mirror=mirror, width_px=640, rim_deg=rim_deg)
    plan = plan_from_settings(RenderSettings(), camera, kind=RASTER, reason="test")
    atlas = pack_atlas(plan.face_regions, guard_texels=GUARD_TEXELS, max_texels=16384)
    pixels = pixel_sample_positions(camera)[::3, ::3, 0]
    directions, on_mirror = direction_from_pixel(camera, pixels)
    size = np.array((atlas.width, atlas.height), dtype=np.float32)
    # As a sampler does it, in float32.
    held = (atlas_coordinates(camera, atlas, pixels) * size).astype(np.float64)
    moved = (held - atlas.texels_from_direction(directions))[on_mirror]
    seen_px = (
        np.linalg.norm(moved, axis=-1).max() * texel_footprint(camera, plan.face_regions).max_px
    )
    assert 0.0 < seen_px <= rounding_px(camera, RendererKind.RASTER) < 5e-3


def test_directions_of_a_mesh_are_rounded_too() -> None:
    camera = make_omni_camera(width_px=360)
    tessellation = Tessellation(16, 16)
    assert rounding_px(camera, RendererKind.RASTER, tessellation) > rounding_px(
        camera, RendererKind.RASTER
    )


def test_rounding_of_rays_is_far_below_visibility() -> None:
    # Unit vectors in float32 are good to 6e-8; times up to 210 px a radian at the rim.
    assert 1e-5 < rounding_px(make_omni_camera(width_px=360), RendererKind.TRACE) < 5e-5


def test_rounding_grows_with_the_image() -> None:
    small, large = (
        rounding_px(make_omni_camera(width_px=w), RendererKind.TRACE) for w in (90, 900)
    )
    assert large == pytest.approx(10.0 * small)


def test_corner_error_falls_with_more_samples() -> None:
    for samples in (1, 4):
        bound = make_bound(RASTER, Tessellation(8, 8), samples)
        assert component_px(bound, "corners") == pytest.approx(2**0.5 / 512.0 / samples)


NON_CENTRAL = [
    *(kind(*MIRROR_EXAMPLES[name]) for name, kind in MIRRORS.items()),
    SphericalMirror(0.03, 0.2, math.radians(170.0)),
    ConicalMirror(math.radians(20.0), 0.1, math.radians(150.0)),
]
NON_CENTRAL = [make_mirror_camera(one) for one in NON_CENTRAL if not one.is_central]


def displacements_px(camera: OmniCamera, nearest_m: float) -> tuple[Floats, Floats]:
    """Places over the rim's radius, where points from a distance on are drawn from one viewpoint,
    and (n,) distances from their pixels by the exact rays."""
    rng = np.random.default_rng(1)
    azimuth = rng.uniform(-math.pi, math.pi, 6_000)
    t = camera.t_from_radius_px(camera.rim_radius_px * rng.uniform(0.0, 1.0, len(azimuth)))
    theta = np.minimum(2.0 * np.arctan(t), camera.rim_rad)
    circle = np.stack((np.cos(azimuth), np.sin(azimuth)), axis=-1)
    directions = np.column_stack((np.sin(theta)[:, None] * circle, np.cos(theta)))
    distances_m = nearest_m * np.where(rng.uniform(size=len(theta)) < 0.9, 1.0, 2.0 - 1e-3)
    exact_px, is_seen = pixel_from_point(camera, distances_m[:, None] * directions)
    drawn_px, is_drawn = pixel_from_direction(camera, directions)
    # A point behind the mirror is hidden by it.
    known = is_seen & is_drawn
    places = np.linalg.norm(drawn_px - camera.centre_px, axis=-1) / camera.rim_radius_px
    return places[known], np.linalg.norm(exact_px - drawn_px, axis=-1)[known]


@pytest.mark.parametrize("camera", NON_CENTRAL, ids=lambda one: str(one.projection)[:24])
@pytest.mark.parametrize("nearest_m", [0.1, 1.0, 10.0, 100.0])
def test_points_seen_from_one_viewpoint_are_displaced_by_the_bound_of_each_ring(
    camera: OmniCamera, nearest_m: float
) -> None:
    approximated = replace(camera, is_approximated=True)
    bounds = [
        scene_error(one, kind, SceneDisplacement(0.0, nearest_m))
        for one, kind in ((approximated, TRACE), (approximated, RASTER))
    ]
    assert bounds[0] == bounds[1]
    places, seen_px = displacements_px(camera, nearest_m)
    assert seen_px.max() <= bounds[0].max_px <= 2.0 * seen_px.max()
    allowed_px = np.array([bounds[0].at_px(place) for place in places.tolist()])
    assert (seen_px <= allowed_px).all()


def test_exact_rays_are_displaced_by_coordinates_alone() -> None:
    camera = NON_CENTRAL[0]
    scene = SceneDisplacement(1e-6, 0.1)
    assert scene_error(camera, TRACE, scene) == angle_error(camera, 1e-6)
    approximated = replace(camera, is_approximated=True)
    nearer, farther = (
        scene_error(approximated, TRACE, replace(scene, nearest_m=one)) for one in (0.1, math.inf)
    )
    assert nearer.max_px > farther.max_px == pytest.approx(angle_error(camera, 1e-6).max_px)


def test_distance_of_the_model_from_the_lens_is_a_part_of_its_own() -> None:
    plan = plan_from_settings(RenderSettings(), CAMERA, kind=TRACE, reason="test")
    exact = error_bound(CAMERA, plan)
    stated = error_bound(replace(CAMERA, model_error_px=0.3), plan)
    assert stated.numbers_by_name() == exact.numbers_by_name() | {"model_px": 0.3}
    assert str(stated) == f"{exact}; the model may be 0.3 px from the lens"


def make_sampling_error(kind: RendererKind, *, samples: int, face_size_px: int = 0) -> Any:
    settings = RenderSettings(PerPixel(), samples, face_size_px)
    plan = plan_from_settings(settings, CAMERA, kind=kind, reason="test")
    return error_bound(CAMERA, plan).sampling


@pytest.mark.parametrize("samples", [1, 2, 4])
def test_edge_error_is_half_the_diagonal_of_a_sample(samples: int) -> None:
    assert make_sampling_error(RendererKind.TRACE, samples=samples).edge_error_px == pytest.approx(
        math.sqrt(0.5) / samples
    )


def test_trace_has_no_texel_footprint() -> None:
    error = make_sampling_error(RendererKind.TRACE, samples=1)
    assert error.texel_footprint is None
    assert error.minification == 0.0
    assert not error.is_undersampled


def test_coarse_samples_skip_texels_where_the_image_minifies() -> None:
    # Derived: n / h times at the centre, five times at n = 512.
    coarse = make_sampling_error(RendererKind.RASTER, samples=1, face_size_px=512)
    assert coarse.minification > 512 / CAMERA.horizon_radius_px > 4.9
    assert coarse.is_undersampled


def test_enough_samples_reach_every_texel() -> None:
    many = make_sampling_error(RendererKind.RASTER, samples=16, face_size_px=512)
    assert many.minification < 1.0
    assert not many.is_undersampled


def max_centroid_error_px(samples: int, radius_px: float, count: int) -> float:
    """Largest error of disc centroids, computed from the light of whole pixels."""
    rng = np.random.default_rng(7)
    reach = math.ceil(radius_px + 1.0)
    points = (np.arange(-reach * samples, (reach + 1) * samples) + 0.5) / samples
    pixels = np.floor(points) + 0.5
    worst = 0.0
    for u, v in rng.uniform(0.0, 1.0, (count, 2)):
        inside = np.hypot(points[:, None] - u, points[None, :] - v) < radius_px
        if inside.any():
            weight = inside / inside.sum()
            error = np.array(((weight.T @ pixels).sum() - u, (weight @ pixels).sum() - v))
            worst = max(worst, float(np.linalg.norm(error)))
    return worst


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 8])
def test_centroid_errors_of_discs_lie_between_half_the_bound_and_the_bound(samples: int) -> None:
    error = make_sampling_error(RendererKind.TRACE, samples=samples)
    worst = max(max_centroid_error_px(samples, 0.5 * size, 300) for size in (1.0, 1.3, 1.5, 3.0))
    assert worst <= error.centroid_error_px < 2.0 * worst


def test_centroid_errors_by_pixels_alone_lie_between_half_the_bound_and_the_bound() -> None:
    worst = max_centroid_error_px(24, 0.5, 300)
    error = make_sampling_error(RendererKind.TRACE, samples=1)
    by_pixels_px = error.centroid_error_px - error.edge_error_px
    assert worst <= by_pixels_px + math.sqrt(0.5) / 24
    assert by_pixels_px < 2.0 * worst
