"""The same bytes for all threads and processors; labels beside a picture."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.frames.labels import RaySource, build_label_rays
from catoptra_server.render.trace.kernel import scene_arrays
from catoptra_server.render.trace.kernel.library import available_instruction_sets
from catoptra_server.render.trace.ray_table import RayTable
from catoptra_server.render.trace.trace_engine import (
    LabelRequest,
    LabelTables,
    MovingExposure,
    TracedExposure,
    TraceRequest,
)
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Item, Material, Rectangle, World
from helpers.dynamic_objects import TWO_ROBOTS, build_textured_mesh
from helpers.labelled_rooms import CAMERAS, SCENE, STATE, WORLD
from helpers.trace_kernels import make_omni_table, open_kernel
from helpers.worlds import (
    CAMERA_STATE,
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_test_world,
    write_smooth_texture,
)
from measurements import scenes

LIGHTS = (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT)
SETS = available_instruction_sets()
WHITE = Material((1.0, 1.0, 1.0), unlit=True)
FLOOR = World("w", (Item("floor", Rectangle((9.0, 9.0)), Pose.identity(), WHITE),))

Case = tuple[World, TracedExposure]
Arrays = tuple[npt.NDArray[Any], ...]


def make_cases(folder: Path) -> dict[str, Case]:
    """Worlds with every kind of surface and light, and exposures of them."""
    textured = make_test_world(lights=LIGHTS, texture=write_smooth_texture(folder / "t.png"))
    moved = CameraState(CAMERA_STATE.world_from_mirror @ Pose.from_rpy((0.1, 0, 0), (0, 0, 0.1)))
    bodies = tuple(replace(robot, mesh=build_textured_mesh()) for robot in TWO_ROBOTS)
    return {
        "field": (read_world(scenes.FIELD)[0], scenes.CAMERA_STATE),
        "corridor": (read_world(scenes.CORRIDOR)[0], scenes.CAMERA_STATE),
        "lights and texture": (textured, CAMERA_STATE),
        "robots": (textured, replace(CAMERA_STATE, objects=TWO_ROBOTS)),
        "shadows": (textured, replace(CAMERA_STATE, objects=TWO_ROBOTS, has_shadows=True)),
        "textured robots": (textured, replace(CAMERA_STATE, objects=bodies)),
        "motion": (textured, MovingExposure((CAMERA_STATE, moved))),
        "textured motion": (
            textured,
            MovingExposure(
                tuple(replace(state, objects=bodies) for state in (CAMERA_STATE, moved))
            ),
        ),
    }


CASES = (
    "field",
    "corridor",
    "lights and texture",
    "robots",
    "shadows",
    "motion",
    "textured robots",
    "textured motion",
)


@pytest.fixture
def case(request: pytest.FixtureRequest, tmp_path: Path) -> Case:
    """The case of a parameter."""
    return make_cases(tmp_path)[request.param]


def add_times(table: RayTable) -> RayTable:
    """Rays of a rolling shutter: one after another."""
    shape = (*table.valid.shape, 16)
    times = np.linspace(0.0, 1.0, int(np.prod(shape)), dtype=np.float32).reshape(shape)
    return replace(table, times=times)


def make_table(exposure: TracedExposure, *, samples: int) -> RayTable:
    """Rays of an image of 80 samples along its side, with times if the exposure moves."""
    table = make_omni_table(width_px=80 // samples, samples=samples)
    return add_times(table) if isinstance(exposure, MovingExposure) else table


def render_all(case: Case, table: RayTable, **options: Any) -> Arrays:
    """All outputs of an engine."""
    world, exposure = case
    with open_kernel(world, **options) as engine:
        rays = engine.prepare(table)
        hits = rays.find_hits(exposure)
        return (
            rays.render_srgb(exposure),
            rays.render_linear(exposure),
            hits.range_m,
            hits.triangle,
            hits.object,
        )


def assert_same(expected: Arrays, found: Arrays) -> None:
    """Compare all outputs of two engines, byte by byte."""
    for array, other in zip(expected, found, strict=True):
        np.testing.assert_array_equal(array, other)


@pytest.mark.parametrize("channels", [3, 4])
def test_images_held_as_bytes_and_as_light_give_the_same_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, channels: int
) -> None:
    world, exposure = make_cases(tmp_path)["shadows"]
    image = np.random.default_rng(1).integers(0, 256, (7, 9, channels), dtype=np.uint8)
    scene = replace(build_scene(world), textures=(image,))
    if channels == 4:
        holes = np.where(scene.texture_index >= 0, 2.0, np.inf)
        scene = replace(scene, coverage=holes[:, None].repeat(3, axis=1))
    table = make_table(exposure, samples=2)
    light = render_all((world, exposure), table, scene=scene)
    monkeypatch.setattr(scene_arrays, "MAX_LIGHT_TEXELS", 7 * 9 - 1)
    assert_same(light, render_all((world, exposure), table, scene=scene))


@pytest.mark.parametrize("samples", [1, 2, 4])
@pytest.mark.parametrize("case", CASES, indirect=True)
def test_outputs_have_the_same_bytes_for_all_threads_and_instruction_sets(
    case: Case, samples: int
) -> None:
    table = make_table(case[1], samples=samples)
    expected = render_all(case, table, threads=1)
    assert expected[0].any()
    for threads, name in itertools.product((2, 4), SETS):
        assert_same(expected, render_all(case, table, threads=threads, instruction_set=name))


def test_image_when_rendered_among_others_has_the_same_bytes() -> None:
    with open_kernel(make_test_world(lights=LIGHTS), threads=2) as engine:
        rays = engine.prepare(make_omni_table(width_px=60))
        before = rays.render_srgb(CAMERA_STATE)
        rays.render_srgb(replace(CAMERA_STATE, objects=TWO_ROBOTS, has_shadows=True))
        engine.prepare(make_omni_table(width_px=33, samples=2)).render_linear(CAMERA_STATE)
        np.testing.assert_array_equal(rays.render_srgb(CAMERA_STATE), before)


def test_description_is_the_same_on_every_machine() -> None:
    with open_kernel(FLOOR, threads=3, instruction_set=SETS[-1]) as engine:
        assert engine.description == "kernel"


SOURCE = RaySource(CAMERAS["paper"])
TABLES = LabelTables(
    np.ones(len(SCENE), dtype=np.uint16),
    np.full(len(STATE.objects), 2, dtype=np.uint16),
    np.zeros(2**16, dtype=np.uint16),
)
REQUEST = LabelRequest(frozenset({"ids"}), TABLES, build_label_rays(SOURCE, 1))


def test_picture_is_drawn_where_its_rays_cannot_find_the_labels() -> None:
    samples = build_label_rays(SOURCE, 2)
    part = replace(
        samples,
        tiles=samples.tiles[:-3],
        directions=samples.directions[:-3],
        valid=samples.valid[:-3],
    )
    with open_kernel(WORLD) as engine:
        rays = engine.prepare(part)
        plain = rays.render(STATE, TraceRequest())
        asked = rays.render(STATE, TraceRequest(labels=REQUEST))
        assert asked.labels is None
        assert asked.image.tobytes() == plain.image.tobytes()
        with pytest.raises(DomainError, match="have no sample"):
            rays.label_pixels(STATE, REQUEST)
        rays.close()


def test_labels_are_found_beside_encoded_and_linear_pictures() -> None:
    with open_kernel(WORLD) as engine:
        rays = engine.prepare(build_label_rays(SOURCE, 2))
        alone = rays.label_pixels(STATE, REQUEST)["ids"]
        assert set(np.unique(alone)) == {0, 1, 2}
        for is_linear in (False, True):
            frame = rays.render(STATE, TraceRequest(is_linear=is_linear, labels=REQUEST))
            assert frame.labels is not None
            np.testing.assert_array_equal(frame.labels["ids"], alone)
        rays.close()
