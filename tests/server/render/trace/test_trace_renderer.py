"""The trace renderer against the camera model, a float64 ray caster and itself."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import (
    PAPER_MIRROR,
    HyperbolicMirror,
    Mirror,
    ParabolicMirror,
)
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.renderer import FaceCamera, Image, RenderPlan
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.world import textures as texture_levels
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.mirror_mesh import tessellation_from_polygon_count
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import (
    Box,
    Item,
    Material,
    Rectangle,
    World,
    srgb_from_linear,
)
from helpers.markers import marker_centroid, marker_directions, marker_world
from helpers.reference_caster import cast_rays
from helpers.trace_engines import ENGINES, open_engine, open_renderer
from helpers.worlds import (
    CAMERA_STATE,
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_fine_floor,
    make_omni_camera,
    make_plan,
    make_test_world,
    write_fine_texture,
    write_smooth_texture,
)

WHITE = Material((1.0, 1.0, 1.0), unlit=True)


MakeRenderer = Callable[..., AbstractContextManager[TraceRenderer]]


@pytest.fixture(params=ENGINES)
def make_renderer(request: pytest.FixtureRequest) -> MakeRenderer:
    """Function that opens a renderer with one of the engines."""
    return partial(open_renderer, request.param)


def render_image(
    make_renderer: MakeRenderer,
    world: World,
    camera: OmniCamera,
    plan: RenderPlan | None = None,
    *,
    camera_state: CameraState = CAMERA_STATE,
    threads: int = 1,
) -> Image:
    with make_renderer(world, threads=threads) as renderer:
        return renderer.prepare(camera, plan or make_plan(camera)).render(camera_state).rgb


# Geometry.


@pytest.mark.parametrize(
    "mirror",
    [PAPER_MIRROR, HyperbolicMirror(4.0, 0.1), ParabolicMirror(0.05)],
    ids=["the paper's", "strongly curved", "parabolic"],
)
def test_marker_when_rendered_is_within_a_tenth_of_a_pixel(
    make_renderer: MakeRenderer, mirror: Mirror
) -> None:
    camera = make_omni_camera(mirror=mirror, width_px=360)
    incidence = (20.0, 33.0, 45.0, 60.0, 75.0, 90.0, 104.0, 118.0)
    directions = marker_directions(incidence, tuple(range(-180, 180, 24)))
    world = marker_world(directions, world_from_mirror=CAMERA_STATE.world_from_mirror)
    # 6 x 6 samples: the smallest markers are a pixel wide, 4 x 4 locate their centre to 0.1 px.
    image = render_image(make_renderer, world, camera, make_plan(camera, samples=6))
    positions, seen = pixel_from_direction(camera, directions)
    assert seen.all()
    # 3 px: the markers at 20 degrees are 7 px apart.
    errors = [np.hypot(*(marker_centroid(image, at, window_px=3.0) - at)) for at in positions]
    assert len(errors) == 120
    assert max(errors) < 0.1


def test_image_of_an_object_on_the_left_shows_it_on_the_right(make_renderer: MakeRenderer) -> None:
    wall = Item("left", Box((4.0, 1.0, 4.0)), Pose.from_rpy((0.0, -2.0, 0.0)), WHITE)
    at = CameraState(Pose.identity())
    image = render_image(
        make_renderer, World("w", (wall,)), make_omni_camera(width_px=100), camera_state=at
    )
    assert image[50, 80:].mean() > 100
    assert image[50, :50].max() == 0


@pytest.mark.parametrize("face", list(Face))
def test_face_when_rendered_shows_surfaces_in_front_alone(
    make_renderer: MakeRenderer, face: Face
) -> None:
    around = {Face.N: (2, 0, 0), Face.E: (0, 2, 0), Face.S: (-2, 0, 0), Face.W: (0, -2, 0)}
    place = {**around, Face.C: (0, 0, 2), Face.U: (0, 0, -2)}[face]
    world = World("w", (Item("box", Box((1.0, 1.0, 1.0)), Pose.from_rpy(place), WHITE),))
    with make_renderer(world) as renderer:
        seen = [
            renderer.prepare_face(FaceCamera(f, 9), 1)
            .render(CameraState(Pose.identity()))
            .rgb[4, 4, 0]
            for f in Face
        ]
    assert seen == [255 if f is face else 0 for f in Face]


# Light.


@pytest.mark.parametrize("samples", [1, 2])
def test_image_with_texture_and_point_light_is_that_of_the_float64_caster(
    make_renderer: MakeRenderer, tmp_path: Path, samples: int
) -> None:
    camera = make_omni_camera(width_px=56)
    # Texels of a metre: all samples read the image itself, as the caster does.
    world = make_test_world(
        lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
        texture=write_smooth_texture(tmp_path / "waves.png", size=2),
    )
    image = render_image(make_renderer, world, camera, make_plan(camera, samples=samples))
    grid = pixel_sample_positions(camera, samples)
    local, on_mirror = direction_from_pixel(camera, grid)
    pose = CAMERA_STATE.world_from_mirror
    seen = cast_rays(
        build_scene(world), world, pose.translation, pose.rotate_directions(local.reshape(-1, 3))
    )
    light = np.where(on_mirror.reshape(-1, 1), np.clip(seen.radiance, 0.0, 1.0), 0.0)
    mean = light.reshape(56, 56, samples**2, 3).mean(axis=2)
    certain = seen.is_certain.reshape(56, 56, samples**2).all(axis=2)
    assert certain.mean() > 0.9
    difference = np.abs(image - 255.0 * srgb_from_linear(mean))[certain]
    # Half a level is rounding; float32 rays and texture coordinates move it by little more.
    assert difference.max() < 0.6


def test_fine_texture_seen_from_afar_aliases_at_most_half_as_much_as_without_levels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = make_fine_floor(write_fine_texture(tmp_path / "checkers.png"))
    mean = render_levels("kernel", world, samples=16)
    by_kernel, by_reference = (
        rms(render_levels(engine, world, samples=1) - mean) for engine in ENGINES
    )
    # No footprint larger than a texel: each sample has a single one's colour.
    monkeypatch.setattr(texture_levels, "MAX_STRETCH", 0.0)
    aliased = rms(render_levels("reference", world, samples=1) - mean)
    assert max(by_kernel, by_reference) < 0.5 * aliased


def render_levels(engine_name: EngineName, world: World, *, samples: int) -> Floats:
    """(100, 100, 3) image in grey levels."""
    camera = make_omni_camera(width_px=100)
    with open_engine(engine_name, world) as engine:
        rays = engine.prepare(omni_ray_table(camera, make_plan(camera, samples=samples)))
        return rays.render_srgb(CAMERA_STATE).astype(np.float64)


def rms(difference: Floats) -> float:
    return float(np.sqrt(np.square(difference).mean()))


def test_rim_when_sampled_fades_into_black(make_renderer: MakeRenderer) -> None:
    camera = make_omni_camera(width_px=40)
    image = render_image(
        make_renderer,
        World("w", (), background=(1.0, 1.0, 1.0)),
        camera,
        make_plan(camera, samples=4),
    )
    levels = np.unique(image)
    assert levels[0] == 0
    assert levels[-1] == 255
    assert len(levels) > 5


def test_world_when_empty_is_its_background_on_the_mirror_and_black_beside_it(
    make_renderer: MakeRenderer,
) -> None:
    camera = make_omni_camera(width_px=40)
    image = render_image(make_renderer, World("w", (), background=(1.0, 0.0, 0.2159)), camera)
    _, seen = direction_from_pixel(camera, pixel_sample_positions(camera)[:, :, 0])
    np.testing.assert_array_equal(image[~seen], 0)
    np.testing.assert_array_equal(image[seen], np.tile([255, 0, 128], (seen.sum(), 1)))


def test_mirror_when_of_few_polygons_shows_nothing_beyond_them(make_renderer: MakeRenderer) -> None:
    camera = make_omni_camera(width_px=60)
    world = World("w", (), background=(1.0, 1.0, 1.0))
    image = render_image(
        make_renderer, world, camera, make_plan(camera, tessellation_from_polygon_count(16))
    )
    exact = render_image(make_renderer, world, camera)
    assert image.any(axis=-1).sum() / exact.any(axis=-1).sum() == pytest.approx(0.634, abs=0.02)


# Itself.


@pytest.mark.parametrize("samples", [1, 3])
def test_image_when_rendered_by_more_threads_has_the_same_bytes(
    make_renderer: MakeRenderer, tmp_path: Path, samples: int
) -> None:
    camera = make_omni_camera(width_px=90)
    world = make_test_world(
        lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
        texture=write_smooth_texture(tmp_path / "waves.png"),
    )
    plan = make_plan(camera, samples=samples)
    images = [
        render_image(make_renderer, world, camera, plan, threads=threads) for threads in (1, 2, 5)
    ]
    assert images[0].tobytes() == images[1].tobytes() == images[2].tobytes()


def test_image_when_rendered_again_is_the_same_and_read_only(make_renderer: MakeRenderer) -> None:
    camera = make_omni_camera(width_px=60)
    with make_renderer(make_test_world()) as renderer:
        view = renderer.prepare(camera, make_plan(camera))
        one, _, again = (
            view.render(e) for e in (CAMERA_STATE, CameraState(Pose.identity()), CAMERA_STATE)
        )
    np.testing.assert_array_equal(one.rgb, again.rgb)
    assert not one.rgb.flags.writeable
    assert set(one.stage_ms) == {"trace"}
    assert one.stage_ms["trace"] > 0.0


@pytest.mark.parametrize("far_m", [1e3, 1e5])
def test_world_when_far_from_its_origin_has_the_same_image(
    make_renderer: MakeRenderer, far_m: float
) -> None:
    camera = make_omni_camera(width_px=90)
    near = make_test_world()
    moved = Pose.from_rpy((far_m, -far_m, 0.5 * far_m))
    items = tuple(
        Item(item.name, item.shape, moved @ item.world_from_item, item.material)
        for item in near.items
    )
    far = World("far", items, lights=near.lights, background=near.background)
    image = render_image(make_renderer, near, camera)
    camera_state = CameraState(moved @ CAMERA_STATE.world_from_mirror)
    other = render_image(make_renderer, far, camera, camera_state=camera_state)
    # Rays through the very edges may go either way.
    assert (image != other).any(axis=-1).mean() < 2e-3


def test_view_when_inside_an_object_or_on_a_surface_is_rendered(
    make_renderer: MakeRenderer,
) -> None:
    camera = make_omni_camera(width_px=30)
    floor = Item("floor", Rectangle((4.0, 4.0)), Pose.identity(), WHITE)
    image = render_image(
        make_renderer, World("w", (floor,)), camera, camera_state=CameraState(Pose.identity())
    )
    assert image.shape == (30, 30, 3)


def test_description_names_engine_threads_and_triangles(make_renderer: MakeRenderer) -> None:
    with make_renderer(make_test_world(), threads=2) as renderer:
        assert renderer.describe().startswith(f"trace: {renderer.engine_name} (")
        assert renderer.describe().endswith(", 2 threads, 230 triangles")
