"""Raster's resources for dynamic objects, counted: none without objects, one buffer with them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.raster.scene_batches import (
    DynamicObjectBuffer,
    object_distance_range,
)
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.dynamic_objects import ROBOT_MESH, TWO_ROBOTS, place_cube
from helpers.worlds import (
    CAMERA_STATE,
    make_omni_camera,
    make_plan,
    make_test_world,
    write_smooth_texture,
)

WITH_ROBOTS = dataclasses.replace(CAMERA_STATE, objects=TWO_ROBOTS)
ZERO = Pose.identity().translation


def test_without_objects_there_is_no_buffer_no_program_and_no_draw(
    device: GlDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    created: list[DynamicObjectBuffer] = []
    original = DynamicObjectBuffer.upload
    monkeypatch.setattr(
        DynamicObjectBuffer,
        "upload",
        lambda self, objects: (created.append(self), original(self, objects)),
    )
    empty = World("empty", ())
    renderer = RasterRenderer(build_scene(empty), empty, device=device)
    view = renderer.prepare(make_omni_camera(), make_plan(make_omni_camera()))
    view.render(CAMERA_STATE)
    assert [objects.buffer_bytes for objects in created] == [0] * len(created)
    assert "face" not in renderer.program_names
    assert view.face_counts.num_draw_calls == 0
    view.render(WITH_ROBOTS)
    assert created[-1].buffer_bytes > 0
    assert renderer.program_names[-1] == "face"
    view.close()


def test_objects_are_sent_to_the_faces_that_may_see_them(device: GlDevice) -> None:
    world = make_test_world()
    view = RasterRenderer(build_scene(world), world, device=device).prepare(
        make_omni_camera(), make_plan(make_omni_camera())
    )
    view.render(CAMERA_STATE)
    alone = view.face_counts
    behind = (place_cube(0.31, 0.17, -30.0),)
    view.render(CameraState(CAMERA_STATE.world_from_mirror, behind))
    assert view.face_counts == alone, "no face looks up"
    view.render(WITH_ROBOTS)
    sent = view.face_counts.num_triangles - alone.num_triangles
    assert 2 * len(ROBOT_MESH) <= sent < 10 * len(ROBOT_MESH)
    view.close()


def test_buffer_grows_once_and_is_kept(device: GlDevice) -> None:
    world = make_test_world()
    renderer = RasterRenderer(build_scene(world), world, device=device)
    view = renderer.prepare(make_omni_camera(), make_plan(make_omni_camera()))
    held = []
    for count in (2, 1, 0, 2):
        view.render(dataclasses.replace(CAMERA_STATE, objects=TWO_ROBOTS[:count]))
        held.append(renderer.object_buffer_bytes)
    # Three corners a triangle, of nine floats of four bytes.
    assert held == [2 * len(ROBOT_MESH) * 3 * 9 * 4] * 4
    view.close()


def test_object_in_a_world_of_textures_only_gets_the_plain_program(
    device: GlDevice, tmp_path: Path
) -> None:
    textured = make_test_world(texture=write_smooth_texture(tmp_path / "waves.png"))
    world = dataclasses.replace(textured, items=textured.items[:1])
    renderer = RasterRenderer(build_scene(world), world, device=device)
    view = renderer.prepare(make_omni_camera(), make_plan(make_omni_camera()))
    assert "face" not in renderer.program_names
    view.render(WITH_ROBOTS)
    assert "face" in renderer.program_names
    view.close()


def test_distance_range_without_objects_is_empty() -> None:
    assert object_distance_range((), ZERO, 0.1) == (float("inf"), 0.0)


def test_distance_range_of_a_near_object_begins_at_its_nearest_triangle() -> None:
    nearest, farthest = object_distance_range((place_cube(0.25, 0.0, 0.0),), ZERO, 0.1)
    assert nearest == pytest.approx(0.05)
    assert farthest >= 0.45


def test_distance_range_of_a_far_object_is_that_of_its_sphere() -> None:
    nearest, _ = object_distance_range((place_cube(5.0, 0.0, 0.0),), ZERO, 0.1)
    assert nearest == pytest.approx(5.0 - 0.2 * 3**0.5)
