"""What raster does for bodies, counted: nothing without them, one buffer for all with them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from catoptra_protocol.optics.frames import Pose
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.context import GlDevice
from catoptra_server.render.raster.moving_bodies import MovingBodies, reach_of
from catoptra_server.render.renderer import Exposure
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import build_scene
from helpers.bodies import ROBOT, TWO_ROBOTS, cube_at
from helpers.worlds import VIEW, omni_camera, raster_plan, room, smooth_texture

WITH_ROBOTS = dataclasses.replace(VIEW, bodies=TWO_ROBOTS)
ZERO = Pose.identity().translation


def test_without_bodies_there_is_no_buffer_no_program_and_no_draw(
    device: GlDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[MovingBodies] = []
    original = MovingBodies.place
    monkeypatch.setattr(
        MovingBodies, "place", lambda self, bodies: (made.append(self), original(self, bodies))
    )
    empty = World("empty", ())
    renderer = RasterRenderer(build_scene(empty), empty, device=device)
    view = renderer.prepare(omni_camera(), raster_plan(omni_camera()))
    view.draw(VIEW)
    assert [bodies.bytes_held for bodies in made] == [0] * len(made)
    assert "face" not in renderer.programs_built
    assert view.face_counts.calls == 0
    view.draw(WITH_ROBOTS)
    assert made[-1].bytes_held > 0
    assert renderer.programs_built[-1] == "face"
    view.close()


def test_bodies_are_sent_to_the_faces_that_may_see_them(device: GlDevice) -> None:
    world = room()
    view = RasterRenderer(build_scene(world), world, device=device).prepare(
        omni_camera(), raster_plan(omni_camera())
    )
    view.draw(VIEW)
    alone = view.face_counts
    behind = (cube_at(0.31, 0.17, -30.0),)
    view.draw(Exposure(VIEW.world_from_mirror, behind))
    assert view.face_counts == alone, "no face looks up"
    view.draw(WITH_ROBOTS)
    sent = view.face_counts.triangles - alone.triangles
    assert 2 * len(ROBOT) <= sent < 10 * len(ROBOT)
    view.close()


def test_buffer_grows_once_and_is_kept(device: GlDevice) -> None:
    world = room()
    renderer = RasterRenderer(build_scene(world), world, device=device)
    view = renderer.prepare(omni_camera(), raster_plan(omni_camera()))
    held = []
    for count in (2, 1, 0, 2):
        view.draw(dataclasses.replace(VIEW, bodies=TWO_ROBOTS[:count]))
        held.append(renderer.body_bytes)
    # Three corners a triangle, of six floats of four bytes.
    assert held == [2 * len(ROBOT) * 3 * 6 * 4] * 4
    view.close()


def test_body_in_a_world_of_textures_only_gets_the_plain_program(
    device: GlDevice, tmp_path: Path
) -> None:
    textured = room(texture=smooth_texture(tmp_path / "waves.png"))
    world = dataclasses.replace(textured, items=textured.items[:1])
    renderer = RasterRenderer(build_scene(world), world, device=device)
    view = renderer.prepare(omni_camera(), raster_plan(omni_camera()))
    assert "face" not in renderer.programs_built
    view.draw(WITH_ROBOTS)
    assert "face" in renderer.programs_built
    view.close()


def test_reach_without_bodies_is_nothing() -> None:
    assert reach_of((), ZERO, 0.1) == (float("inf"), 0.0)


def test_reach_of_a_near_body_is_its_nearest_triangle() -> None:
    nearest, farthest = reach_of((cube_at(0.25, 0.0, 0.0),), ZERO, 0.1)
    assert nearest == pytest.approx(0.05)
    assert farthest >= 0.45


def test_reach_of_a_far_body_is_its_sphere() -> None:
    nearest, _ = reach_of((cube_at(5.0, 0.0, 0.0),), ZERO, 0.1)
    assert nearest == pytest.approx(5.0 - 0.2 * 3**0.5)
