"""Worlds that are large for float32: a thing 200 km away changes nothing that is near."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.labels import LabelledImage
from catoptra_server.frames.labels.label_renderer import LabelRenderer
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.kernel.kernel_engine import KernelEngine
from catoptra_server.render.trace.kernel.library import KernelUnavailableError
from catoptra_server.world.objects import FogMedium, Shutter
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import Box, Item, Material, Twist, World
from helpers.image_comparison import level_differences
from helpers.labelled_rooms import ROBOTS
from helpers.standing_things import bake_scene
from helpers.trace_kernels import make_omni_table, open_kernel
from helpers.worlds import (
    CAMERA_STATE,
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_omni_camera,
    make_test_world,
    write_smooth_texture,
)

STATE = replace(CAMERA_STATE, objects=ROBOTS)
FAR = Item("far", Box((1.0, 1.0, 1.0)), Pose.from_rpy((2e5, -1e5, 0.0)), Material((0.5, 0.5, 0.5)))


def add_far_thing(world: World) -> World:
    return replace(world, items=(*world.items, FAR))


def make_scenes(world: World) -> tuple[SceneMesh, SceneMesh]:
    """Scenes of the world and of the same with a far thing, with one map of ambient occlusion."""
    near, large = bake_scene(world), build_scene(add_far_thing(world))
    assert near.occlusion is not None
    patch_of = np.full(len(large), -1, dtype=near.occlusion.patch_of.dtype)
    patch_of[: len(near)] = near.occlusion.patch_of
    assert (near.is_large, large.is_large) == (False, True)
    return near, replace(large, occlusion=replace(near.occlusion, patch_of=patch_of))


@contextmanager
def open_engines(world: World) -> Iterator[tuple[KernelEngine, KernelEngine]]:
    near, large = make_scenes(world)
    with (
        open_kernel(world, scene=near) as one,
        open_kernel(add_far_thing(world), scene=large) as other,
    ):
        yield one, other


MOVING = replace(STATE, twist=Twist((0.4, 0.2, 0.0), (0.0, 0.0, 0.5)))
BLUR = Shutter(1.0 / 30.0, 0.0, 64.0)
EXPOSURES = {
    "plain": STATE,
    "shadows": replace(STATE, has_shadows=True),
    "fog": replace(STATE, fog=FogMedium(0.3, (0.5, 0.5, 0.6))),
    "blur": replace(MOVING, shutter=BLUR),
    "blurred shadows": replace(MOVING, shutter=BLUR, has_shadows=True),
    "readout": replace(MOVING, shutter=Shutter(0.0, 1.0 / 30.0, 64.0)),
}


@pytest.mark.parametrize("samples", [1, 2])
def test_pictures_are_those_of_the_world_without_it(tmp_path: Path, samples: int) -> None:
    world = make_test_world(
        lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
        texture=write_smooth_texture(tmp_path / "texture.png"),
    )
    table = make_omni_table(width_px=200, samples=samples)
    with open_engines(world) as engines:
        views = [engine.prepare(table) for engine in engines]
        for name, state in EXPOSURES.items():
            near, large = (view.render_srgb(state) for view in views)
            differences = level_differences(near, large)
            assert (differences > 2).mean() < 2e-4, f"{name}: edges move by rounding alone"
            assert (differences > 0).mean() < 2e-2, name
            filled = [view.last_counts.num_filled_tiles for view in views]
            assert filled[1] > 0.6 * filled[0], f"{name}: proofs hold as well"


def test_labels_are_those_of_the_world_without_it() -> None:
    world = make_test_world()
    channels = ("range", "normal", "point", "ids", "agreement", "flow")
    image = LabelledImage(make_omni_camera(width_px=200), STATE, samples=2)
    moved = replace(STATE, world_from_mirror=STATE.world_from_mirror @ Pose.from_rpy((0.1, 0, 0)))
    found = []
    for scene in make_scenes(world):
        try:
            renderer = TraceRenderer(scene, world, threads=1, engine="kernel")
        except KernelUnavailableError as error:
            pytest.skip(str(error))
        labels = LabelRenderer(renderer, scene)
        found.append(labels.render(image, channels, moved).channels)
        labels.close()
        renderer.close()
    near, large = found
    # The far thing has a number between those of the room and of the robots.
    ids = near["ids"] + (near["ids"] > len(world.items))
    assert (ids != large["ids"]).mean() < 2e-4
    assert (near["agreement"] != large["agreement"]).mean() < 2e-3
    same = (ids == large["ids"]) & np.isfinite(near["range"])
    assert same.mean() > 0.3
    for name, tolerance in (("range", 2e-6), ("normal", 2e-6), ("point", 4e-6)):
        np.testing.assert_allclose(near[name][same], large[name][same], atol=tolerance, rtol=2e-6)
    seen = same & np.isfinite(near["flow"]).all(axis=-1) & np.isfinite(large["flow"]).all(axis=-1)
    assert seen.sum() > 0.9 * np.isfinite(near["flow"]).all(axis=-1).sum()
    np.testing.assert_allclose(near["flow"][seen], large["flow"][seen], atol=2e-3)


def test_robots_far_from_the_centre_are_drawn_as_there() -> None:
    world = World("empty", (), lights=(HEMISPHERE_LIGHT,), background=(0.3, 0.3, 0.35))
    offset = Pose.from_rpy((3e5, 2e5, 0.0))
    moved = replace(
        STATE,
        world_from_mirror=offset @ STATE.world_from_mirror,
        objects=tuple(
            replace(one, world_from_object=offset @ one.world_from_object) for one in ROBOTS
        ),
    )
    with open_kernel(world) as engine:
        view = engine.prepare(make_omni_table(width_px=200))
        here, there = view.render_srgb(STATE), view.render_srgb(moved)
    assert len(np.unique(here)) > 5
    assert (level_differences(here, there) > 0).mean() < 2e-4
