"""Raster's resources for dynamic objects, counted: none without objects, one buffer with them."""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import direction_from_pixel
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.projection import large_triangles
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice, ShaderPrograms, split_positions
from catoptra_server.render.raster.scene_batches import (
    DynamicObjectBuffer,
    FacetLighting,
    SceneBatches,
    upload_texture,
    upload_values,
)
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.shading import facet_irradiance, point_irradiance
from catoptra_server.world.triangles import make_clusters
from catoptra_server.world.world_description import Item, Light, MeshFile, World, srgb_from_linear
from helpers.dynamic_objects import ROBOT_MESH, TWO_ROBOTS, place_cube
from helpers.mesh_file_samples import export_mesh
from helpers.opengl import make_raster
from helpers.worlds import (
    CAMERA_STATE,
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_omni_camera,
    make_plan,
    make_test_world,
    write_smooth_texture,
)


def test_batches_when_light_varies_by_position_have_the_programs_that_need_normals(
    device: GlDevice, tmp_path: Path
) -> None:
    world = make_test_world(
        lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
        texture=write_smooth_texture(tmp_path / "t.png"),
    )
    scene = build_scene(world)
    chunks = make_clusters(scene.corners, (scene.texture_index + 1).astype(np.intp))
    position = upload_values(device.context, split_positions(scene.corners[chunks.order]))
    textures = [upload_texture(device.context, image) for image in scene.textures]
    built = []
    for varying in ((), (("NUM_POINT_LIGHTS", 1),)):
        programs = ShaderPrograms(device.context)
        light = FacetLighting(world.lights, varying)
        look = SceneBatches(
            *(device.context, programs, scene, chunks),
            position=position,
            lighting=light,
            textures=textures,
        )
        assert len(look.programs) == 2
        built.append(programs.names)
        look.close()
    assert built == [
        ("face", "face TEXTURED=1"),
        ("face NUM_POINT_LIGHTS=1", "face TEXTURED=1 NUM_POINT_LIGHTS=1"),
    ]
    position.release()


CORNERS = np.array([[-3.0, -3, 0], [5, -2, 0], [-1, 5, 0]])  # of one triangle on the floor
COLOURS = np.array([[255, 0, 40], [0, 255, 40], [60, 60, 255]])
CAMERA = make_omni_camera(width_px=160, rim_deg=80.0)


def make_colourful_floor(folder: Path, *, unlit: bool, lights: tuple[Light, ...]) -> World:
    """A world of one triangle that faces up, with a colour at each corner."""
    mesh = trimesh.Trimesh(CORNERS * (1, -1, -1), [[0, 2, 1]], process=False)
    mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=COLOURS)
    floor = MeshFile(export_mesh(mesh, folder / "floor.ply"))
    return World("w", (Item("floor", floor, Pose.identity(), None, unlit=unlit),), lights=lights)


def expected_levels(scene: SceneMesh, lights: tuple[Light, ...]) -> tuple[Floats, Bools]:
    """(h, w, 3) grey levels of the triangle in float64, and the (h, w) pixels well inside it."""
    rows, columns = np.mgrid[:160, :160] + 0.5
    direction, seen = direction_from_pixel(CAMERA, np.stack((columns, rows), axis=-1))
    pose = CAMERA_STATE.world_from_mirror
    ray = pose.rotate_directions(np.where(seen[..., None], direction, 1.0)).reshape(-1, 3)
    points = pose.translation - ray * (pose.translation[2] / ray[:, 2:])
    a, b, c = scene.corners[0, :, :2]
    u, v = np.linalg.solve(np.stack((b - a, c - a), axis=-1), (points[:, :2] - a).T)
    inside = (np.minimum(np.minimum(u, v), 1.0 - u - v) > 0.02) & seen.ravel() & (ray[:, 2] > 0)
    assert scene.corner_albedo is not None
    albedo = np.stack((1.0 - u - v, u, v), axis=-1) @ scene.corner_albedo[0]
    normals = np.broadcast_to(scene.normals[0], points.shape)
    light = facet_irradiance(lights, normals) + point_irradiance(lights, points, normals)
    radiance = np.where(inside[:, None], albedo * (1.0 if scene.unlit[0] else light), 0.0)
    levels: Floats = 255.0 * srgb_from_linear(radiance).reshape(160, 160, 3)
    return levels, inside.reshape(160, 160)


@pytest.mark.parametrize("unlit", [True, False])
@pytest.mark.parametrize("has_shadows", [False, True])
@pytest.mark.parametrize("has_point_light", [False, True])
def test_colours_are_interpolated_between_corners(
    device: GlDevice, tmp_path: Path, unlit: bool, has_shadows: bool, has_point_light: bool
) -> None:
    lights = (HEMISPHERE_LIGHT, *((POINT_LIGHT,) if has_point_light else ()))
    world = make_colourful_floor(tmp_path, unlit=unlit, lights=lights)
    scene = build_scene(world)
    view = RasterRenderer(scene, world, device=device).prepare(CAMERA, make_plan(CAMERA))
    image = view.render(replace(CAMERA_STATE, has_shadows=has_shadows)).rgb
    view.close()
    levels, inside = expected_levels(scene, lights)
    assert inside.mean() > 0.1
    # One level for the rounding to bytes, one for light stored in 11 bits.
    assert np.abs(image - levels)[inside].max() < 2.0


WITH_ROBOTS = dataclasses.replace(CAMERA_STATE, objects=TWO_ROBOTS)


def test_without_objects_there_is_no_buffer_no_program_and_no_draw(
    device: GlDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    created: list[DynamicObjectBuffer] = []
    original = DynamicObjectBuffer.upload
    monkeypatch.setattr(
        DynamicObjectBuffer,
        "upload",
        lambda self, *arguments: (created.append(self), original(self, *arguments)),
    )
    empty = World("empty", ())
    renderer = make_raster(device, empty)
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
    view = make_raster(device).prepare(make_omni_camera(), make_plan(make_omni_camera()))
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
    renderer = make_raster(device)
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
    renderer = make_raster(device, world)
    view = renderer.prepare(make_omni_camera(), make_plan(make_omni_camera()))
    assert "face" not in renderer.program_names
    view.render(WITH_ROBOTS)
    assert "face" in renderer.program_names
    view.close()


@pytest.mark.parametrize("has_shadows", [False, True])
def test_pieces_look_like_the_triangles_that_they_replace(
    device: GlDevice, tmp_path: Path, has_shadows: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    lights = (HEMISPHERE_LIGHT, POINT_LIGHT)
    world = make_test_world(lights=lights, texture=write_smooth_texture(tmp_path / "t.png"))
    state = replace(CAMERA_STATE, objects=TWO_ROBOTS, has_shadows=has_shadows)
    images, triangles = [], []
    for limit in (128.0, 4.0):
        monkeypatch.setattr(large_triangles, "MAX_SIZE_PER_DISTANCE", limit)
        monkeypatch.setattr(large_triangles, "_MAX_CUT", 0.5)
        view = make_raster(device, world).prepare(CAMERA, make_plan(CAMERA))
        images.append(view.render(state).rgb.astype(int))
        triangles.append(view.face_counts.num_triangles)
        view.close()
    assert triangles[1] > triangles[0] + 20
    differences = np.abs(images[1] - images[0]).max(axis=-1)
    # Only where a corner on the rasterizer's grid moves an edge.
    assert (differences > 2).mean() < 1e-3
