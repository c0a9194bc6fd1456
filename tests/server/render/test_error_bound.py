"""The error bound of a plan against rendered frames: never exceeded, never twice the largest error.

The rays of trace are known, so the largest error is measured on all of them. Raster's error is
measured on its images: pixels beside outlines of targets (helpers/displacement_targets).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.lenses import EquidistantLens
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, HyperbolicMirror, Mirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    camera_with_inscribed_rim,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan.error_bound import error_bound
from catoptra_server.frames.plan.faces import texel_footprint
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import (
    Image,
    MirrorSurface,
    PerPixel,
    Renderer,
    RenderPlan,
    RenderSettings,
)
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_studies.camera_figures.polygon_figures import displacement_px
from helpers.displacement_targets import (
    DisplacementTargets,
    max_displacement_px,
    scatter_discs,
    scatter_squares,
)
from helpers.long_cases import quick_cases
from helpers.markers import marker_centroid, marker_directions, marker_world
from helpers.opengl import make_raster
from helpers.ray_grids import grid_directions, grid_validity
from helpers.worlds import CAMERA_STATE, make_omni_camera

STRONG = HyperbolicMirror(3.0, 0.1)
NEARLY_PLANE = HyperbolicMirror(2.1, 0.2)
NEARLY_PARABOLIC = HyperbolicMirror(1e4, 0.3)
PARABOLIC = ParabolicMirror(0.03)
LEVEL = CameraState(Pose.identity())

Lens = tuple[Mirror, float, int]  # mirror, rim in degrees, image width


def make_tessellation(sectors: int, rings: int, way: str) -> Tessellation:
    return Tessellation(sectors, rings, Interpolation(way))


def make_bound_plan(
    camera: OmniCamera,
    surface: MirrorSurface,
    kind: RendererKind,
    *,
    size: int = 0,
    samples: int = 1,
) -> RenderPlan:
    """A plan with one face sample a texel, and faces of a size, 0 = the plan's own."""
    render_settings = RenderSettings(surface, samples, size, 1)
    return plan_from_settings(render_settings, camera, kind=kind, reason="test")


# Trace: every ray.

EXACT: list[Lens] = [
    (PAPER_MIRROR, 120.0, 360),
    (PAPER_MIRROR, 90.0, 90),
    (PAPER_MIRROR, 150.0, 360),
    (PAPER_MIRROR, 120.0, 1024),
    (STRONG, 105.0, 200),
    (NEARLY_PLANE, 100.0, 640),
    (NEARLY_PARABOLIC, 150.0, 200),
    (PARABOLIC, 135.0, 640),
]
FACETED: list[tuple[Lens, Tessellation]] = [
    ((PAPER_MIRROR, 120.0, 360), make_tessellation(4, 4, "uv")),
    ((PAPER_MIRROR, 120.0, 360), make_tessellation(4, 4, "position")),
    ((PAPER_MIRROR, 120.0, 360), make_tessellation(32, 32, "uv")),
    ((PAPER_MIRROR, 120.0, 360), make_tessellation(64, 64, "uv")),
    ((PAPER_MIRROR, 120.0, 1024), make_tessellation(64, 64, "position")),
    ((PAPER_MIRROR, 90.0, 90), make_tessellation(16, 16, "uv")),
    ((PAPER_MIRROR, 90.0, 200), make_tessellation(64, 64, "position")),
    ((PAPER_MIRROR, 150.0, 360), make_tessellation(16, 16, "uv")),
    ((PAPER_MIRROR, 150.0, 360), make_tessellation(64, 64, "uv")),
    ((PAPER_MIRROR, 150.0, 200), make_tessellation(16, 4, "position")),
    ((STRONG, 105.0, 200), make_tessellation(16, 16, "position")),
    ((STRONG, 105.0, 200), make_tessellation(12, 7, "uv")),
    ((NEARLY_PLANE, 100.0, 200), make_tessellation(16, 16, "uv")),
    ((NEARLY_PARABOLIC, 130.0, 200), make_tessellation(5, 3, "uv")),
    ((NEARLY_PARABOLIC, 130.0, 200), make_tessellation(30, 9, "position")),
]

# Of images of 1024 px, and of meshes as fine on the same mirror, the others alone.
QUICK_FACETED = quick_cases(FACETED, *sorted({*range(len(FACETED))} - {4, 8}))


def make_lens_camera(lens: Lens) -> OmniCamera:
    mirror, rim_deg, width_px = lens
    return make_omni_camera(mirror=mirror, width_px=width_px, rim_deg=rim_deg)


def turn_directions(directions: Floats, camera_state: CameraState) -> Floats:
    """(n, 3) float32 directions in the mirror frame, rotated to the world and back."""
    rotation = camera_state.world_from_mirror.rotation
    turned = directions.astype(np.float32) @ rotation.T.astype(np.float32)
    back: Floats = turned.astype(np.float64) @ rotation
    return back


def ray_errors_px(camera: OmniCamera, plan: RenderPlan, camera_state: CameraState) -> Floats:
    """(n,) displacements of the rays of one exposure whose directions lie in the image."""
    return ray_errors_by_pixel(camera, plan, camera_state)[1]


def ray_errors_by_pixel(
    camera: OmniCamera, plan: RenderPlan, camera_state: CameraState
) -> tuple[Floats, Floats]:
    """(n, 2) pixels and (n,) displacements of those rays."""
    rays = omni_ray_table(camera, plan)
    valid = grid_validity(rays)
    pixels = pixel_sample_positions(camera)[:, :, 0][valid]
    directions = turn_directions(grid_directions(rays)[valid], camera_state)
    error_px, known = displacement_px(camera, pixels, directions)
    return pixels[known], error_px[known]


def widest_gap_px(camera: OmniCamera, plan: RenderPlan) -> float:
    """Distance within the rim of the farthest pixel that misses the mirror wrongly."""
    pixels = pixel_sample_positions(camera)[:, :, 0]
    _, on_disc = direction_from_pixel(camera, pixels)
    missed = on_disc & ~grid_validity(omni_ray_table(camera, plan))
    radius_px = np.linalg.norm(pixels[missed] - camera.centre_px, axis=1)
    return float((camera.rim_radius_px - radius_px).max(initial=0.0))


@pytest.mark.parametrize(
    ("lens",),  # noqa: PT006  # a lens is a tuple itself
    quick_cases([(lens,) for lens in EXACT], 0, 1, 2, 4, 5, 6, 7),
    ids=str,
)
def test_bound_of_exact_rays_holds_for_any_turn_within_a_factor_of_two(lens: Lens) -> None:
    camera = make_lens_camera(lens)
    plan = make_bound_plan(camera, PerPixel(), RendererKind.TRACE)
    rng = np.random.default_rng(1)
    turns = [CAMERA_STATE] + [
        CameraState(Pose.from_rpy((0, 0, 0), rng.uniform(-3, 3, 3))) for _ in range(5)
    ]
    seen_px = max(ray_errors_px(camera, plan, turn).max() for turn in turns)
    bound_px = error_bound(camera, plan).geometric.max_px
    assert seen_px <= bound_px <= 2.0 * seen_px


@pytest.mark.parametrize(("lens", "surface"), QUICK_FACETED, ids=str)
def test_bound_of_polygon_rays_holds_within_a_factor_of_two(
    lens: Lens, surface: Tessellation
) -> None:
    camera = make_lens_camera(lens)
    plan = make_bound_plan(camera, surface, RendererKind.TRACE)
    errors_px = ray_errors_px(camera, plan, CAMERA_STATE)
    seen_px = max(errors_px.max(), widest_gap_px(camera, plan))
    bound = error_bound(camera, plan).geometric
    assert seen_px <= bound.max_px <= 2.0 * seen_px
    # Pixel centres are one set of positions in the image, the bound's are another.
    rms_px = math.sqrt(np.square(errors_px).mean())
    assert bound.rms_px == pytest.approx(rms_px, rel=0.03)


@pytest.mark.parametrize(("lens", "surface"), QUICK_FACETED, ids=str)
def test_bound_at_a_place_holds_there_and_adds_up_to_that_of_the_image(
    lens: Lens, surface: Tessellation
) -> None:
    camera = make_lens_camera(lens)
    plan = make_bound_plan(camera, surface, RendererKind.TRACE)
    bound, edge_px = error_bound(camera, plan), error_bound(camera, plan).sampling.edge_error_px
    pixels, errors_px = ray_errors_by_pixel(camera, plan, CAMERA_STATE)
    radii = np.linalg.norm(pixels - camera.centre_px, axis=1) / camera.rim_radius_px
    places = np.linspace(0.0, 1.0, 200)
    bounds_px = np.array([bound.outline_error_at_px(float(place)) for place in places]) - edge_px
    assert bounds_px.max() == pytest.approx(bound.geometric.max_px)
    assert bounds_px[:20].max() < 0.8 * bounds_px.max()
    allowed_px = np.array([bound.outline_error_at_px(float(radius)) for radius in radii])
    assert (errors_px <= allowed_px - edge_px).all()


def test_bound_of_a_part_of_the_mirror_is_that_of_the_part() -> None:
    # The upper left quarter of a mirror off the centre, turned in the image.
    camera = OmniCamera(PAPER_MIRROR, 120, 90, (100.3, 80.2), 103.0, math.radians(120.0), 0.7)
    plan = make_bound_plan(camera, make_tessellation(12, 12, "uv"), RendererKind.TRACE)
    errors_px = ray_errors_px(camera, plan, CAMERA_STATE)
    bound = error_bound(camera, plan).geometric
    assert errors_px.max() <= bound.max_px <= 1.3 * errors_px.max()
    assert bound.rms_px == pytest.approx(math.sqrt(np.square(errors_px).mean()), rel=0.05)


# Frames.


def render_frame(
    renderer: Renderer, camera: OmniCamera, plan: RenderPlan, camera_state: CameraState
) -> Image:
    view = renderer.prepare(camera, plan)
    image = view.render(camera_state).rgb
    view.close()
    return image


def iterate_targets(
    camera: OmniCamera, plan: RenderPlan, *, count: int
) -> Iterator[tuple[DisplacementTargets, CameraState]]:
    """Yield worlds of discs from a turned viewpoint, and of squares along the texels."""
    texel_px = texel_footprint(camera, plan.face_regions).max_px
    error_px = error_bound(camera, plan).geometric.max_px
    for seed in range(3):
        # Four texels a disc and eight a square, which the bound is for; and never so small that
        # looking beside a thing would find another.
        rng = np.random.default_rng(seed)
        size_px = max(4.3 * texel_px, 5.0, 2.5 * error_px)
        yield scatter_discs(camera, size_px=size_px, count=count, rng=rng), CAMERA_STATE
        size_px = max(8.5 * texel_px, 5.0, 2.5 * error_px)
        yield scatter_squares(camera, size_px=size_px, count=count, rng=rng), LEVEL


@pytest.mark.parametrize(
    ("lens", "surface"),
    quick_cases([(EXACT[0], PerPixel()), FACETED[2], FACETED[7]], 0, 2),
    ids=str,
)
def test_traced_frames_of_targets_are_within_the_bound(lens: Lens, surface: MirrorSurface) -> None:
    camera = make_lens_camera(lens)
    plan = make_bound_plan(camera, surface, RendererKind.TRACE)
    worst_px = 0.0
    for targets, camera_state in iterate_targets(camera, plan, count=20):
        world = targets.build_world(camera_state.world_from_mirror)
        renderer = TraceRenderer(build_scene(world), world, threads=1)
        image = render_frame(renderer, camera, plan, camera_state)
        renderer.close()
        worst_px = max(worst_px, max_displacement_px(camera, image, targets))
    assert worst_px <= error_bound(camera, plan).geometric.max_px


# Surface, size of the faces (0: as the plan has them), number of targets.
RASTER: list[tuple[Lens, MirrorSurface, int, int]] = [
    ((PAPER_MIRROR, 120.0, 360), PerPixel(), 0, 25),
    ((PAPER_MIRROR, 120.0, 360), PerPixel(), 128, 25),
    ((PAPER_MIRROR, 120.0, 360), PerPixel(), 720, 50),
    ((PAPER_MIRROR, 90.0, 90), PerPixel(), 0, 25),
    ((PAPER_MIRROR, 150.0, 200), PerPixel(), 0, 40),
    ((PAPER_MIRROR, 120.0, 1024), PerPixel(), 0, 8),
    ((STRONG, 105.0, 200), PerPixel(), 0, 40),
    ((NEARLY_PLANE, 100.0, 360), PerPixel(), 720, 50),
    ((NEARLY_PARABOLIC, 130.0, 200), PerPixel(), 256, 40),
    ((PARABOLIC, 135.0, 200), PerPixel(), 0, 40),
    ((PAPER_MIRROR, 120.0, 360), make_tessellation(16, 16, "uv"), 0, 25),
    ((PAPER_MIRROR, 90.0, 200), make_tessellation(32, 32, "position"), 0, 40),
    ((PAPER_MIRROR, 120.0, 360), make_tessellation(64, 64, "uv"), 0, 40),
    ((PAPER_MIRROR, 150.0, 200), make_tessellation(64, 64, "position"), 0, 40),
    ((STRONG, 105.0, 200), make_tessellation(16, 4, "uv"), 0, 25),
]


def max_measured_px(device: GlDevice, camera: OmniCamera, plan: RenderPlan, count: int) -> float:
    worst_px = 0.0
    for targets, camera_state in iterate_targets(camera, plan, count=count):
        world = targets.build_world(camera_state.world_from_mirror)
        image = render_frame(make_raster(device, world), camera, plan, camera_state)
        worst_px = max(worst_px, max_displacement_px(camera, image, targets))
    return worst_px


@pytest.mark.parametrize(
    ("lens", "surface", "size", "count"), quick_cases(RASTER, 1, 3, 9, 14), ids=str
)
def test_bound_of_rastered_frames_holds_within_a_factor_of_two(
    device: GlDevice, lens: Lens, surface: MirrorSurface, size: int, count: int
) -> None:
    camera = make_lens_camera(lens)
    plan = make_bound_plan(camera, surface, RendererKind.RASTER, size=size)
    seen_px = max_measured_px(device, camera, plan, count)
    assert seen_px <= error_bound(camera, plan).geometric.max_px <= 2.0 * seen_px


@pytest.mark.parametrize("lens", [EXACT[0], EXACT[4]], ids=str)
def test_bound_of_faces_with_four_samples_holds_and_is_smaller(
    device: GlDevice, lens: Lens
) -> None:
    camera = make_lens_camera(lens)
    one = make_bound_plan(camera, PerPixel(), RendererKind.RASTER)
    four = replace(one, face_samples=4)
    # Edges that rise by a third of their length are the worst for the pattern of four: that it
    # displaces them as far as said is searched in tests/server/frames/plan/test_error_bound.py.
    seen_px = max_measured_px(device, camera, four, 15)
    bound_px = error_bound(camera, four).geometric.max_px
    assert seen_px <= bound_px < 0.7 * error_bound(camera, one).geometric.max_px


def test_bound_of_a_rastered_lens_of_358_degrees_holds_within_a_factor_of_three(
    device: GlDevice,
) -> None:
    camera = camera_with_inscribed_rim(
        EquidistantLens(), width_px=640, height_px=640, rim_rad=math.radians(179.0)
    )
    plan = make_bound_plan(camera, PerPixel(), RendererKind.RASTER)
    up = next(one for one in plan.face_regions if one.face is Face.U)
    texel = 1.0 / up.columns_per_unit
    rim = math.tan(math.pi - camera.rim_rad)
    axes = np.tile(MIRROR_FROM_FACE_ROTATIONS[Face.U], (4, 1, 1))
    # The image shows a texel beside the antipode 45 px long and a quarter wide. Outlines along the
    # image radius are displaced lengthways there: those of discs of few texels.
    displaced_px = []
    for radius, beyond_rim, azimuth_rad in ((2.5, 1.0, 0.5), (2.5, 1.0, 0.02), (3.0, 1.64, 0.02)):
        azimuth = azimuth_rad + 0.5 * math.pi * np.arange(4)
        circle = np.stack((np.cos(azimuth), np.sin(azimuth)), axis=-1)
        centre = (rim + beyond_rim * texel) * circle
        discs = DisplacementTargets(axes, centre, np.full(4, radius * texel), True)
        world = discs.build_world(LEVEL.world_from_mirror)
        image = render_frame(make_raster(device, world), camera, plan, LEVEL)
        pixels = pixel_sample_positions(camera)[:, :, 0]
        directions, is_seen = direction_from_pixel(camera, pixels)
        is_lit = image[..., 0][is_seen] > 187  # half of the light
        wrong = pixels[is_seen][is_lit != discs.contains(directions[is_seen])]
        # Outlines go on where the image has ended.
        whole = replace(camera, rim_rad=math.radians(179.99))
        outline_px, _ = pixel_from_direction(whole, discs.outline_directions()[0])
        distance_px = np.linalg.norm(wrong[:, None] - outline_px, axis=-1).min(axis=1)
        displaced_px.append(distance_px.max())
    seen_px = max(displaced_px)
    assert seen_px <= error_bound(camera, plan).geometric.max_px <= 3.0 * seen_px


@pytest.mark.parametrize("way", ["uv", "position"])
def test_bound_of_the_coarsest_rastered_polygons_holds(device: GlDevice, way: str) -> None:
    # Errors are as large as the image there: no frame of things shows where each pixel looks, which
    # the same polygons' rays do above.
    camera = make_omni_camera(width_px=200)
    plan = make_bound_plan(camera, make_tessellation(4, 4, way), RendererKind.RASTER)
    seen_px = max_measured_px(device, camera, plan, 12)
    assert 0.0 < seen_px <= error_bound(camera, plan).geometric.max_px


# Samples: markers of about a pixel, the hardest to place.


def centroid_errors_px(camera: OmniCamera, plan: RenderPlan) -> Floats:
    """(n,) errors of the centroids of traced markers, at positions all over a pixel."""
    rng = np.random.default_rng(3)
    positions = np.stack(np.meshgrid(*[np.arange(30.0, camera.width_px - 30.0, 8.0)] * 2), axis=-1)
    positions = positions.reshape(-1, 2) + rng.uniform(-0.5, 0.5, (positions.size // 2, 2))
    directions, _ = direction_from_pixel(camera, positions)
    # Around the horizon: there a radian is h px, and nearly alike in all directions.
    level = np.abs(directions[:, 2]) < 0.12
    world = marker_world(
        directions[level],
        world_from_mirror=CAMERA_STATE.world_from_mirror,
        diameter_rad=1.15 / camera.scale_px,
    )
    renderer = TraceRenderer(build_scene(world), world, threads=1)
    image = render_frame(renderer, camera, plan, CAMERA_STATE)
    renderer.close()
    # With one sample a pixel a disc of less than sqrt 2 px may fall between the samples.
    found = [place for place in positions[level] if _is_lit(image, place)]
    centroids = [marker_centroid(image, place, window_px=2.0) for place in found]
    return np.linalg.norm(np.subtract(centroids, found), axis=1)


def _is_lit(image: Image, place: Floats) -> bool:
    column, row = (int(value) for value in place)
    return bool(image[row - 1 : row + 2, column - 1 : column + 2].any())


@pytest.mark.parametrize("samples", quick_cases([1, 2, 4, 8], 0, 1, 2))
def test_markers_of_a_pixel_are_measured_within_the_bound_and_its_half(samples: int) -> None:
    camera = make_omni_camera(width_px=360)
    plan = make_bound_plan(camera, PerPixel(), RendererKind.TRACE, samples=samples)
    errors_px = centroid_errors_px(camera, plan)
    assert len(errors_px) > 100
    assert errors_px.max() <= error_bound(camera, plan).marker_error_px <= 2.0 * errors_px.max()


def test_markers_in_rastered_frames_are_measured_within_the_bound(device: GlDevice) -> None:
    camera = make_omni_camera(width_px=360)
    plan = make_bound_plan(camera, make_tessellation(32, 32, "uv"), RendererKind.RASTER, samples=2)
    directions = marker_directions((50.0, 75.0, 90.0, 104.0), tuple(range(-180, 180, 24)))
    world = marker_world(
        directions, world_from_mirror=CAMERA_STATE.world_from_mirror, diameter_rad=math.radians(3.0)
    )
    renderer = make_raster(device, world)
    image = render_frame(renderer, camera, plan, CAMERA_STATE)
    positions, _ = pixel_from_direction(camera, directions)
    errors_px = [np.hypot(*(marker_centroid(image, at, window_px=7.0) - at)) for at in positions]
    assert len(errors_px) == 60
    assert max(errors_px) <= error_bound(camera, plan).marker_error_px
