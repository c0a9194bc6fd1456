"""The range of each pixel by both renderers, against each other and against geometry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.omni_camera import direction_from_pixel
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.projection.atlas import GUARD_TEXELS, pack_atlas
from catoptra_server.render.raster.device import GlDevice, ShaderPrograms
from catoptra_server.render.raster.mirror_pass import make_lookup_map
from catoptra_server.render.raster.range_pass import RangePass
from catoptra_server.render.raster.scene_buffers import SceneBuffers
from catoptra_server.render.renderer import PerPixel
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import World
from helpers.effect_measurement import CAMERA, DYNAMIC_OBJECT, make_effect
from helpers.opengl import make_raster
from helpers.range_images import CAMERA_ABOVE_FLOOR, FLOOR, VIEWPOINT_HEIGHT_M, Ranges, trace_ranges
from helpers.standing_things import blend_scene, pierce_scene
from helpers.worlds import CAMERA_STATE, make_plan, make_test_world


def measure_ranges(
    world: World, camera_state: CameraState, device: GlDevice, mesh: SceneMesh | None = None
) -> Ranges:
    with device.context as context:
        programs = ShaderPrograms(context)
        scene = SceneBuffers(context, programs, mesh or build_scene(world), world)
        atlas = pack_atlas(
            make_plan(CAMERA).face_regions, guard_texels=GUARD_TEXELS, max_texels=4096
        )
        positions = make_lookup_map(context, programs, CAMERA, PerPixel(), atlas, 1)
        step = RangePass(context, programs, scene, atlas, CAMERA, positions)
        step.draw(camera_state)
        seen = step.read()
        step.close()
        scene.close()
    return seen


def test_range_over_a_level_floor_is_that_of_the_camera_model(device: GlDevice) -> None:
    directions, on_mirror = direction_from_pixel(CAMERA, pixel_sample_positions(CAMERA)[..., 0, :])
    down = directions[..., 2]
    near = on_mirror & (down > 0.1)
    seen = measure_ranges(FLOOR, CAMERA_ABOVE_FLOOR, device)
    assert not np.isfinite(seen[~on_mirror | (down < 0.0)]).any()
    ratio = seen[near] * down[near] / VIEWPOINT_HEIGHT_M
    # Half a texel of an atlas of a texel a pixel, where the floor is seen at six degrees.
    assert np.abs(ratio - 1.0).max() < 0.2
    assert np.median(np.abs(ratio - 1.0)) < 0.01


def test_renderers_when_an_object_is_in_view_measure_equal_ranges(device: GlDevice) -> None:
    camera_state = replace(CAMERA_STATE, objects=(DYNAMIC_OBJECT,))
    trace, raster = (
        trace_ranges(make_test_world(), camera_state),
        measure_ranges(make_test_world(), camera_state, device),
    )
    with np.errstate(invalid="ignore"):
        close = np.isclose(trace, raster, rtol=0.05)
    assert close.mean() > 0.95


@pytest.mark.parametrize("change", [pierce_scene, blend_scene])
def test_holes_have_the_range_of_what_is_behind(
    device: GlDevice, change: Callable[[SceneMesh], SceneMesh]
) -> None:
    world = make_test_world()
    mesh = change(build_scene(world))
    trace = trace_ranges(world, CAMERA_STATE, mesh)
    seen = measure_ranges(world, CAMERA_STATE, device, mesh)
    whole = measure_ranges(world, CAMERA_STATE, device)
    with np.errstate(invalid="ignore"):
        assert np.isclose(trace, seen, rtol=0.05).mean() > 0.95
        assert np.isclose(trace, whole, rtol=0.05).mean() < 0.97


def test_pass_when_no_effect_uses_range_does_not_exist(device: GlDevice) -> None:
    renderer = make_raster(device)
    view = renderer.prepare(CAMERA, make_plan(CAMERA))
    view.render(CAMERA_STATE, (make_effect("Vignetting"),))
    assert "ranges" not in view.pass_names
    assert not [name for name in renderer.program_names if "range" in name]
    view.close()


@pytest.mark.parametrize("count", [0, 1, 2])
def test_objects_when_they_come_and_go_are_visible_before_the_floor(
    count: int, device: GlDevice
) -> None:
    objects = (
        DYNAMIC_OBJECT,
        replace(DYNAMIC_OBJECT, world_from_object=Pose.from_rpy((-1.0, -0.5, -0.3))),
    )[:count]
    alone, seen = (
        measure_ranges(FLOOR, CAMERA_ABOVE_FLOOR, device),
        measure_ranges(FLOOR, replace(CAMERA_ABOVE_FLOOR, objects=objects), device),
    )
    assert (seen <= alone).all()
    nearer = (seen < alone).sum()
    assert (nearer > 0) == (count > 0)
    assert nearer >= 20 * count
