"""Views of the raster renderer: passes, programs, threads, hard scenes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as PillowImage

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.raster import RasterRenderer, scene_buffers
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.raster.scene_batches import ImageTexture
from catoptra_server.render.renderer import FaceCamera, Image, MirrorSurface, PerPixel, View
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import Box, Item, Material, Rectangle, World
from helpers.opengl import make_raster
from helpers.worlds import CAMERA_STATE, HEMISPHERE_LIGHT, make_omni_camera, make_plan

CAMERA = make_omni_camera(width_px=120)
HERE = CameraState(Pose.identity())


@pytest.fixture(scope="module")
def renderer(device: GlDevice) -> RasterRenderer:
    return make_raster(device)


def render_image(device: GlDevice, world: World, camera_state: CameraState) -> Image:
    view = make_raster(device, world).prepare(CAMERA, make_plan(CAMERA))
    image = view.render(camera_state).rgb
    view.close()
    return image


def make_box(x: float, y: float, z: float, *, size: float = 0.4) -> World:
    red = Material((1.0, 0.0, 0.0), unlit=True)
    item = Item("box", Box((size, size, size)), Pose.from_rpy((x, y, z)), red)
    return World("box", (item,), lights=(HEMISPHERE_LIGHT,), background=(0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("surface", "samples", "passes"),
    [
        (PerPixel(), 1, ("faces", "mirror")),
        (PerPixel(), 3, ("faces", "mirror")),
        (Tessellation(8, 8), 1, ("faces", "mirror")),
        (Tessellation(64, 64), 2, ("faces", "mirror")),
    ],
)
def test_view_has_the_passes_that_its_plan_needs_and_times_each(
    renderer: RasterRenderer, surface: MirrorSurface, samples: int, passes: tuple[str, ...]
) -> None:
    view = renderer.prepare(CAMERA, make_plan(CAMERA, surface, samples=samples))
    assert tuple(view.render(CAMERA_STATE).stage_ms) == (*passes, "readback")
    assert view.pass_names == passes
    view.close()


def test_programs_are_shared_by_views_of_one_kind(renderer: RasterRenderer) -> None:
    first = renderer.prepare(CAMERA, make_plan(CAMERA))
    render_image = first.render(CAMERA_STATE).rgb
    built = renderer.program_names
    second = renderer.prepare(
        make_omni_camera(width_px=64), make_plan(make_omni_camera(width_px=64))
    )
    assert render_image.shape != second.render(CAMERA_STATE).rgb.shape
    assert renderer.program_names == built
    first.close()
    second.close()


def test_views_do_not_disturb_each_other(renderer: RasterRenderer) -> None:
    other_camera = make_omni_camera(mirror=ParabolicMirror(0.03), width_px=64, rim_deg=100.0)
    one = renderer.prepare(CAMERA, make_plan(CAMERA))
    alone = one.render(CAMERA_STATE).rgb
    other = renderer.prepare(other_camera, make_plan(other_camera, samples=2))
    face = renderer.prepare_face(FaceCamera(Face.C, 40), 2)
    for view in (other, face):
        view.render(HERE)
    assert np.array_equal(one.render(CAMERA_STATE).rgb, alone)
    for view in (one, other, face):
        view.close()


def test_same_exposure_gives_the_same_bytes(renderer: RasterRenderer) -> None:
    view = renderer.prepare(CAMERA, make_plan(CAMERA, face_samples=4))
    first = view.render(CAMERA_STATE).rgb
    view.render(HERE)
    assert np.array_equal(view.render(CAMERA_STATE).rgb, first)
    view.close()


def test_polygons_of_an_orthographic_camera_are_rejected(renderer: RasterRenderer) -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03))
    with pytest.raises(DomainError, match="pinhole"):
        renderer.prepare(camera, make_plan(camera, Tessellation(8, 8)))


def test_lines_a_millimetre_above_the_floor_do_not_flicker(device: GlDevice) -> None:
    floor = Item(
        "floor", Box((60, 60, 0.1)), Pose.from_rpy((0, 0, 0.65)), Material((0, 1, 0), unlit=True)
    )
    paint = Item(
        "paint", Box((60, 60, 0.1)), Pose.from_rpy((0, 0, 0.649)), Material((1, 0, 0), unlit=True)
    )
    image = render_image(device, World("floor", (paint, floor)), HERE)
    assert not (image[..., 1] > 0).any()


def test_scenes_of_one_device_keep_apart(device: GlDevice) -> None:
    blue = replace(make_box(2.0, 0.0, 0.0), items=())
    assert (render_image(device, blue, HERE)[60, 60] == (0, 0, 255)).all()
    assert (
        render_image(device, make_box(0.0, 0.0, 2.0, size=2.0), HERE)[60, 60] == (255, 0, 0)
    ).all()


def test_renderer_describes_its_device(renderer: RasterRenderer) -> None:
    assert "OpenGL" in renderer.describe()
    assert "triangles" in renderer.describe()


def test_renderer_is_rejected_in_another_thread(renderer: RasterRenderer) -> None:
    errors: list[AssertionError] = []

    def prepare() -> None:
        try:
            renderer.prepare(CAMERA, make_plan(CAMERA))
        except AssertionError as error:
            errors.append(error)

    thread = threading.Thread(target=prepare)
    thread.start()
    thread.join()
    assert "thread" in str(errors[0])


LENS = PerspectiveCamera(80, 60, 1.2)


def prepare_lens(renderer: RasterRenderer) -> View:
    return renderer.prepare_perspective(LENS, 2)


def prepare_mirror(renderer: RasterRenderer) -> View:
    return renderer.prepare(CAMERA, make_plan(CAMERA, samples=2))


# Of what looks down: a mirror, and a lens that is turned so.
@pytest.mark.parametrize(("prepare", "pitch_rad"), [(prepare_mirror, 0.2), (prepare_lens, -1.4)])
def test_levels_of_a_large_scene_are_uploaded_where_a_frame_reads_them(
    device: GlDevice,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    prepare: Callable[[RasterRenderer], View],
    pitch_rad: float,
) -> None:
    noise = np.random.default_rng(39).integers(0, 256, (512, 256, 3), dtype=np.uint8)
    PillowImage.fromarray(noise).save(tmp_path / "noise.png")
    look = Material((0.9, 0.9, 0.9), tmp_path / "noise.png")
    # Steps of a texel are longer one way than the other.
    floor = Item("floor", Rectangle((6, 9), (3, 3)), Pose.from_rpy((0, 0, 0), (0.2, 0, 0)), look)
    world = World("floor", (floor,), lights=(HEMISPHERE_LIGHT,))
    written: list[tuple[int, int]] = []

    def record(texture: ImageTexture, levels: Any, first: int = 0) -> None:
        written.append((len(levels), first))
        write(texture, levels, first)

    write = ImageTexture.write
    whole = prepare(make_raster(device, world))
    monkeypatch.setattr(ImageTexture, "write", record)
    monkeypatch.setattr(scene_buffers, "MAX_LIGHT_TEXELS", 256 * 512 - 1)
    needed = prepare(make_raster(device, world))
    for height_m in (40.0, 20.0, 9.0, 4.0, 2.5, 1.0, 30.0):
        state = CameraState(Pose.from_rpy((0.3, 0.2, -height_m), (0.1, pitch_rad, 0.3)))
        image = needed.render(state).rgb
        np.testing.assert_array_equal(image, whole.render(state).rgb)
        assert np.ptp(image) > 20
    firsts = [first for _, first in written]
    assert firsts == sorted(set(firsts), reverse=True)
    assert all(number == 10 - first for number, first in written)
    assert firsts[0] > 3
    assert firsts[-1] <= 1
