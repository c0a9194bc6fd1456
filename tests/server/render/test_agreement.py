"""Raster against trace: equal images, and markers at the camera model's pixels.

Tolerances: two grey levels away from edges, one for each renderer's rounding (trace encodes through
a table of 16 bits, raster stores light in 11 bits and encodes in float32). At an edge a pixel shows
either side, because the edge on a cube face moves by up to half a texel.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, HyperbolicMirror, Mirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import FaceCamera, Image, MirrorSurface, PerPixel, RenderPlan
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.mirror_mesh import (
    Interpolation,
    Tessellation,
    tessellation_from_polygon_count,
)
from catoptra_server.world.objects import CameraState, FogMedium
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import World
from helpers.image_comparison import level_differences, mask_away_from_edges
from helpers.markers import marker_centroid, marker_directions, marker_world
from helpers.opengl import make_raster
from helpers.standing_things import bake_scene, bend_scene, blend_scene, pierce_scene
from helpers.worlds import (
    CAMERA_STATE,
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_fine_floor,
    make_omni_camera,
    make_plan,
    make_smooth_sky,
    make_test_world,
    under_sky,
    write_fine_texture,
    write_smooth_texture,
)


def render_both(
    device: GlDevice,
    world: World,
    camera: OmniCamera,
    plan: RenderPlan,
    *,
    scene: SceneMesh | None = None,
    state: CameraState = CAMERA_STATE,
) -> tuple[Image, Image]:
    """Image of an omnidirectional camera by raster and by trace."""
    with _renderers(device, world, scene) as renderers:
        views = [renderer.prepare(camera, plan) for renderer in renderers]
        raster, trace = (view.render(state).rgb for view in views)
        views[0].close()
    return raster, trace


@contextmanager
def _renderers(
    device: GlDevice, world: World, scene: SceneMesh | None = None
) -> Iterator[tuple[RasterRenderer, TraceRenderer]]:
    scene = build_scene(world) if scene is None else scene
    with ExitStack() as stack:
        trace = TraceRenderer(scene, world, threads=1)
        stack.callback(trace.close)
        yield RasterRenderer(scene, world, device=device), trace


def assert_same(
    raster: Image, trace: Image, *, levels: int = 2, edges: float = 0.05, faint: float = 1e-3
) -> None:
    """Assert that images differ by at most `levels` away from edges, which are few.

    Edges of little contrast are not known as such: a fraction of the rest, at most `faint`.
    """
    difference = level_differences(raster, trace)
    smooth = mask_away_from_edges(trace)
    assert smooth.mean() > 0.5
    assert (difference[smooth] > levels).mean() < faint
    assert (difference > levels).mean() < edges


MIRRORS: dict[str, tuple[Mirror, float]] = {
    "the paper's": (PAPER_MIRROR, 120.0),
    "sixth face": (PAPER_MIRROR, 140.0),
    "looks down only": (PAPER_MIRROR, 40.0),
    "strongly curved": (HyperbolicMirror(3.0, 0.2), 105.0),
    "parabolic": (ParabolicMirror(0.03), 110.0),
}


@pytest.mark.parametrize("name", MIRRORS)
def test_raster_by_camera_model_equals_trace(device: GlDevice, name: str) -> None:
    mirror, rim_deg = MIRRORS[name]
    camera = make_omni_camera(mirror=mirror, rim_deg=rim_deg)
    assert_same(*render_both(device, make_test_world(), camera, make_plan(camera)))


@pytest.mark.parametrize("samples", [2, 3])
def test_samples_are_averaged_as_trace_does(device: GlDevice, samples: int) -> None:
    camera = make_omni_camera()
    plan = make_plan(camera, samples=samples, face_size_px=samples * 224)
    assert_same(*render_both(device, make_test_world(), camera, plan), edges=0.1)


def test_rim_is_the_same_pixel_for_pixel(device: GlDevice) -> None:
    camera = make_omni_camera()
    world = World("white", (), background=(1.0, 1.0, 1.0))
    raster, trace = render_both(device, world, camera, make_plan(camera, samples=2))
    assert level_differences(raster, trace).max() <= 1


def test_rotated_image_off_centre_equals_trace(device: GlDevice) -> None:
    camera = OmniCamera(HyperbolicMirror(11.546, 0.2), 210, 160, (98.4, 87.1), 55.0, 2.0, 0.7)
    for surface in (PerPixel(), Tessellation(12, 7)):
        plan = make_plan(camera, surface)
        assert_same(*render_both(device, make_test_world(), camera, plan))


def test_raster_under_a_sky_equals_trace(device: GlDevice) -> None:
    camera, world = make_omni_camera(rim_deg=140.0), under_sky(make_test_world(), make_smooth_sky())
    plan = make_plan(camera, face_size_px=448)
    for fog in (None, FogMedium(0.1, (0.3, 0.4, 0.5))):
        state = replace(CAMERA_STATE, fog=fog)
        assert_same(*render_both(device, world, camera, plan, state=state), levels=3, edges=0.1)


@pytest.mark.parametrize("face", list(Face))
def test_single_face_under_a_sky_equals_trace(device: GlDevice, face: Face) -> None:
    with _renderers(device, under_sky(make_test_world(), make_smooth_sky())) as renderers:
        views = [renderer.prepare_face(FaceCamera(face, 96), 1) for renderer in renderers]
        raster, trace = (view.render(CAMERA_STATE).rgb for view in views)
        views[0].close()
    assert (level_differences(raster, trace) > 2).mean() < 0.002


def test_raster_with_textures_and_point_lights_equals_trace(
    device: GlDevice, tmp_path: Path
) -> None:
    camera = make_omni_camera()
    world = make_test_world(
        lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
        texture=write_smooth_texture(tmp_path / "waves.png"),
    )
    plan = make_plan(camera, face_size_px=448)
    # One more level: the atlas is interpolated between texels of light that varies.
    assert_same(*render_both(device, world, camera, plan), levels=3)


def test_raster_of_bent_and_shining_surfaces_equals_trace(device: GlDevice, tmp_path: Path) -> None:
    camera = make_omni_camera()
    world = make_test_world(
        lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
        texture=write_smooth_texture(tmp_path / "waves.png"),
    )
    scene, plan = bend_scene(bake_scene(world)), make_plan(camera, face_size_px=448)
    assert_same(*render_both(device, world, camera, plan, scene=scene), levels=3, edges=0.1)


def test_raster_of_holes_and_backs_that_are_none_equals_trace(
    device: GlDevice, tmp_path: Path
) -> None:
    camera = make_omni_camera()
    texture = write_smooth_texture(tmp_path / "waves.png")
    world = make_test_world(lights=(HEMISPHERE_LIGHT, POINT_LIGHT), texture=texture)
    scene, plan = pierce_scene(build_scene(world)), make_plan(camera, face_size_px=448)
    both = render_both(device, world, camera, plan, scene=scene)
    assert_same(*both, levels=3, edges=0.1, faint=3e-3)


@pytest.mark.parametrize("face_samples", [1, 4])
@pytest.mark.parametrize("has_shadows", [False, True])
def test_raster_of_blended_surfaces_equals_trace(
    device: GlDevice, tmp_path: Path, has_shadows: bool, face_samples: int
) -> None:
    camera = make_omni_camera()
    texture = write_smooth_texture(tmp_path / "waves.png")
    world = make_test_world(lights=(HEMISPHERE_LIGHT, POINT_LIGHT), texture=texture)
    scene = blend_scene(build_scene(world))
    plan = make_plan(camera, face_size_px=448, face_samples=face_samples)
    state = replace(CAMERA_STATE, has_shadows=has_shadows, fog=FogMedium(0.1, (0.3, 0.4, 0.5)))
    both = render_both(device, world, camera, plan, scene=scene, state=state)
    assert_same(*both, levels=3, edges=0.1, faint=5e-3)


@pytest.mark.parametrize("samples", [1, 2])
def test_raster_of_a_fine_texture_at_grazing_angles_equals_trace(
    device: GlDevice, tmp_path: Path, samples: int
) -> None:
    camera = make_omni_camera()
    world = make_fine_floor(write_fine_texture(tmp_path / "checkers.png"))
    # Texels of the faces are finer than the samples: coarser ones would choose the levels.
    plan = make_plan(camera, samples=samples, face_size_px=448)
    difference = level_differences(*render_both(device, world, camera, plan))
    # Two levels as elsewhere, and the interpolation of the atlas near the robot, where checkers are
    # sharp; at the floor's end a pixel shows either side.
    assert np.percentile(difference, 99) <= 3
    assert np.percentile(difference, 50) == 0


@pytest.mark.parametrize("has_shadows", [False, True])
def test_raster_with_ambient_occlusion_equals_trace(
    device: GlDevice, tmp_path: Path, has_shadows: bool
) -> None:
    camera, plain = make_omni_camera(), make_test_world()
    textured = make_test_world(texture=write_smooth_texture(tmp_path / "waves.png"))
    for world in (plain, textured):
        plan = make_plan(camera, face_size_px=448)
        state = replace(CAMERA_STATE, has_shadows=has_shadows)
        scene = bake_scene(world)
        raster, trace = render_both(device, world, camera, plan, scene=scene, state=state)
        # One more level, as above; shadow maps move the edges of shadows.
        assert_same(raster, trace, levels=3, edges=0.1)
        _, whole_sky = render_both(device, world, camera, plan, state=state)
        assert (level_differences(trace, whole_sky) > 5).mean() > 0.01


@pytest.mark.parametrize("interpolation", list(Interpolation))
@pytest.mark.parametrize("polygons", [16, 64, 256, 1024, 4096])
def test_raster_by_mirror_mesh_equals_trace(
    device: GlDevice, polygons: int, interpolation: Interpolation
) -> None:
    camera = make_omni_camera()
    plan = make_plan(camera, tessellation_from_polygon_count(polygons, interpolation))
    assert_same(*render_both(device, make_test_world(), camera, plan))


def test_polygon_samples_are_averaged_as_trace_does(device: GlDevice) -> None:
    camera = make_omni_camera()
    plan = make_plan(camera, tessellation_from_polygon_count(256), samples=2, face_size_px=448)
    assert_same(*render_both(device, make_test_world(), camera, plan), edges=0.1)


@pytest.mark.parametrize("face", list(Face))
@pytest.mark.parametrize("samples", [1, 2])
def test_single_face_equals_trace(device: GlDevice, face: Face, samples: int) -> None:
    camera = FaceCamera(face, 96)
    with _renderers(device, make_test_world()) as renderers:
        views = [renderer.prepare_face(camera, samples) for renderer in renderers]
        raster, trace = (view.render(CAMERA_STATE).rgb for view in views)
        views[0].close()
    # Sample positions are equal: only surfaces within a 256th of a sample may differ.
    assert (level_differences(raster, trace) > 2).mean() < 0.002


# Borders of the faces: 45 degrees of bearing between side faces, 45 degrees of incidence at bearing
# 0 between C and N; the cube's corner is at 54.7356 degrees of incidence, 45 of bearing.
INCIDENCE_DEG = (20.0, 33.0, 45.0, 54.7356, 70.0, 90.0, 104.0, 118.0)
BORDER_BEARINGS_DEG = (0.0, 45.0, 90.0, 135.0, -167.0, -135.0, -90.0, -45.0)
# Within sectors of 32 and of 64, whose corners stand on every bearing above.
BETWEEN_CORNERS_DEG = (9.0, 58.0, 103.0, 147.0, -160.0, -115.0, -70.0, -22.0)


def marker_errors(
    device: GlDevice, surface: MirrorSurface, bearings_deg: tuple[float, ...] = BORDER_BEARINGS_DEG
) -> Floats:
    """(n,) distances in px of raster's markers from the camera model's pixels."""
    camera = make_omni_camera(width_px=360)
    directions = marker_directions(INCIDENCE_DEG, bearings_deg)
    pose = CAMERA_STATE.world_from_mirror
    world = marker_world(directions, world_from_mirror=pose)
    plan = make_plan(camera, surface, samples=4, face_size_px=768, face_samples=4)
    view = make_raster(device, world).prepare(camera, plan)
    image = view.render(CAMERA_STATE).rgb
    view.close()
    positions, seen = pixel_from_direction(camera, directions)
    assert seen.all()
    return np.array([np.hypot(*(marker_centroid(image, at) - at)) for at in positions])


def test_markers_appear_within_a_tenth_of_a_pixel(device: GlDevice) -> None:
    errors = marker_errors(device, PerPixel())
    assert len(errors) == 64
    assert errors.max() < 0.1


@pytest.mark.parametrize(("polygons", "largest_px"), [(1024, 2.03), (4096, 0.543)])
def test_markers_on_polygons_are_displaced_as_the_reference(
    device: GlDevice, polygons: int, largest_px: float
) -> None:
    # The derived table's column "uv"; 64 bearings come near the largest error of all.
    errors = marker_errors(device, tessellation_from_polygon_count(polygons), BETWEEN_CORNERS_DEG)
    assert 0.4 * largest_px < errors.max() < 1.15 * largest_px
