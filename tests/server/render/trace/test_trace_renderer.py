"""Images of both engines against camera model, float64 caster and themselves; the choice."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import CaptureContext
from catoptra_server.render.renderer import FaceCamera, Image, MirrorSurface, PerPixel, RenderPlan
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.kernel.library import KernelUnavailableError
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.render.trace.trace_engine import assemble_grid
from catoptra_server.render.trace.trace_renderer import EngineName, EngineRequest, create_engine
from catoptra_server.world import textures as texture_levels
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.objects import CameraState, NoiseSeed
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Box, Item, Material, World, srgb_from_linear
from helpers.effect_measurement import CAMERA, make_effect
from helpers.image_comparison import level_differences
from helpers.range_images import RangeRecorder
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


# Geometry; markers at the pixels of the camera model are those of test_every_camera.py.


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


# Itself.


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


def test_description_names_engine_and_triangles(make_renderer: MakeRenderer) -> None:
    with make_renderer(make_test_world(), threads=2) as renderer:
        assert renderer.describe().startswith(f"trace: {renderer.engine_name}")
        assert renderer.describe().endswith(", 230 triangles")


WORLD = make_test_world()


def create_name(request: EngineRequest) -> tuple[EngineName, str]:
    """Name and description of the engine of a request."""
    name, engine = create_engine(
        request,
        build_scene(WORLD),
        WORLD,
        threads=1,
        scene_lights=WORLD.lights,
    )
    engine.close()
    return name, engine.description


@pytest.fixture
def no_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CATOPTRA_KERNEL", "off")


@pytest.mark.usefixtures("no_kernel")
def test_engine_when_the_kernel_is_missing_is_the_reference_with_one_warning(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.INFO):
        name, description = create_name("auto")
    assert name == "reference"
    assert description.startswith("reference (")
    (record,) = caplog.records
    assert record.levelno == logging.WARNING
    assert "CATOPTRA_KERNEL=off" in record.message
    assert "reference" in record.message


@pytest.mark.usefixtures("no_kernel")
def test_kernel_when_requested_and_missing_is_an_error() -> None:
    with pytest.raises(KernelUnavailableError, match="CATOPTRA_KERNEL=off"):
        create_name("kernel")


def test_reference_when_requested_is_given_without_a_warning(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.WARNING):
        assert create_name("reference")[0] == "reference"
    assert not caplog.records


def test_kernel_where_it_can_run_is_the_choice(caplog: pytest.LogCaptureFixture) -> None:
    try:
        expected = create_name("kernel")
    except KernelUnavailableError as error:
        pytest.skip(str(error))
    with caplog.at_level(logging.WARNING):
        assert create_name("auto") == expected
    assert expected[1] == "kernel"
    assert not caplog.records


def test_engine_that_does_not_exist_is_refused() -> None:
    with pytest.raises(DomainError, match="auto, kernel or reference, not 'fast'"):
        create_name("fast")  # type: ignore[arg-type]


CHAIN = (make_effect("Vignetting"), make_effect("ShotNoise"), make_effect("Bayer"))


@pytest.fixture(params=ENGINES)
def renderer(request: pytest.FixtureRequest) -> Iterator[TraceRenderer]:
    with open_renderer(request.param, make_test_world(), threads=2) as renderer:
        yield renderer


@pytest.mark.parametrize("surface", [PerPixel(), Tessellation(16, 16)])
@pytest.mark.parametrize("samples", [1, 2])
def test_image_when_no_effect_changes_it_is_the_usual_one(
    renderer: TraceRenderer, surface: MirrorSurface, samples: int
) -> None:
    plan = make_plan(CAMERA, surface, samples=samples)
    view = renderer.prepare(CAMERA, plan)
    encoded = srgb_from_linear(view.render_linear(CAMERA_STATE).astype(np.float64))
    difference = level_differences(
        view.render(CAMERA_STATE).rgb, np.rint(255.0 * encoded).astype(np.uint8)
    )
    # A sample brighter than white is clipped by itself in the one, with its pixel in the other.
    assert (difference > 1).mean() < 0.01
    assert np.median(difference) == 0


def test_image_with_effects_is_their_result_on_the_linear_image(renderer: TraceRenderer) -> None:
    plan = make_plan(CAMERA, samples=2)
    view = renderer.prepare(CAMERA, plan)
    light = view.render_linear(CAMERA_STATE).astype(np.float64)
    for effect in CHAIN:
        light = effect.apply(light, CAMERA, CaptureContext(CAMERA_STATE.noise_seed))
    rendered = view.render_linear(CAMERA_STATE, CHAIN)
    np.testing.assert_allclose(rendered, light, atol=1e-6)


def test_stages_when_timed_have_the_effects_names(renderer: TraceRenderer) -> None:
    view = renderer.prepare(CAMERA, make_plan(CAMERA))
    stages = tuple(view.render(CAMERA_STATE, CHAIN).stage_ms)
    assert stages == ("trace", "Vignetting", "ShotNoise", "Bayer", "encode")
    view.close()


def test_frame_when_rendered_twice_has_the_same_bytes_and_the_next_one_others(
    renderer: TraceRenderer,
) -> None:
    view = renderer.prepare(CAMERA, make_plan(CAMERA))
    first, again = view.render(CAMERA_STATE, CHAIN).rgb, view.render(CAMERA_STATE, CHAIN).rgb
    later = view.render(replace(CAMERA_STATE, noise_seed=NoiseSeed(tick=1)), CHAIN).rgb
    assert not first.flags.writeable
    np.testing.assert_array_equal(first, again)
    assert (first != later).mean() > 0.3


def test_ranges_when_an_effect_needs_them_are_those_of_the_frames_own_rays(
    renderer: TraceRenderer,
) -> None:
    view = renderer.prepare(CAMERA, make_plan(CAMERA, samples=2))
    before = view.memory_bytes
    recorder = RangeRecorder(CHAIN[0])
    rendered = view.render(CAMERA_STATE, (recorder,))  # type: ignore[arg-type]
    assert "ranges" not in rendered.stage_ms
    assert view.memory_bytes == before
    table = omni_ray_table(CAMERA, make_plan(CAMERA, samples=2))
    hits = view._rays.find_hits(CAMERA_STATE)
    inverse = assemble_grid(table, 1.0 / hits.range_m[..., None], fill=np.float32(0.0))[..., 0]
    height, width = CAMERA.height_px, CAMERA.width_px
    means = inverse.astype(np.float64).reshape(height, 2, width, 2).mean(axis=(1, 3))
    assert recorder.range_m is not None
    np.testing.assert_allclose(1.0 / recorder.range_m, means, rtol=1e-4, atol=1e-7)
    view.close()


@pytest.mark.parametrize("engine", ENGINES)
def test_light_brighter_than_white_is_passed_on_unchanged(engine: EngineName) -> None:
    world = World("glare", (), background=(4.0, 2.0, 0.5))
    with open_renderer(engine, world) as renderer:
        light = renderer.prepare(CAMERA, make_plan(CAMERA)).render_linear(CAMERA_STATE)
    np.testing.assert_allclose(light[48, 20], (4.0, 2.0, 0.5), rtol=1e-5)
