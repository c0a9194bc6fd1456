"""Perspective cameras in both renderers: markers at the lens model's pixels, and equal images."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan.camera import hide_unseen
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import FaceCamera, Renderer
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import INSTANTANEOUS, CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.dynamic_objects import place_cube
from helpers.image_comparison import level_differences
from helpers.markers import marker_centroid, marker_world
from helpers.opengl import make_raster
from helpers.worlds import (
    CAMERA_STATE,
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_test_world,
)

CAMERA = PerspectiveCamera(320, 240, math.radians(80.0))


def renderers(device: GlDevice, world: World) -> dict[str, Renderer]:
    scene = build_scene(world)
    return {
        "trace": TraceRenderer(scene, world, threads=2),
        "raster": RasterRenderer(scene, world, device=device),
    }


def spread_directions(camera: PerspectiveCamera) -> Floats:
    """(n, 3) directions all over the image, far enough from its borders for a marker."""
    u = np.linspace(14.0, camera.width_px - 14.0, 7) + 0.3
    v = np.linspace(14.0, camera.height_px - 14.0, 5) + 0.2
    pixel = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    directions, valid = camera.direction_from_pixel(pixel)
    assert valid.all()
    return directions


@pytest.mark.parametrize("kind", ["trace", "raster"])
@pytest.mark.parametrize("fov_deg", [40.0, 80.0, 120.0])
def test_markers_appear_within_a_tenth_of_a_pixel(
    device: GlDevice, kind: str, fov_deg: float
) -> None:
    camera = PerspectiveCamera(320, 240, math.radians(fov_deg))
    directions = spread_directions(camera)
    # Off the axis a disc's centroid is not its centre's pixel but f r^2 tan / cos^2 of the angle
    # away: 0.05 px in the corners of 120 degrees for a disc of 1.4 px at the centre.
    diameter = 1.4 / camera.focal_length_px
    world = marker_world(
        directions, world_from_mirror=CAMERA_STATE.world_from_mirror, diameter_rad=diameter
    )
    renderer = renderers(device, world)[kind]
    image = renderer.prepare_perspective(camera, 8).render(CAMERA_STATE).rgb
    positions, seen = camera.pixel_from_direction(directions)
    assert seen.all()
    errors = [np.hypot(*(marker_centroid(image, at, window_px=13.0) - at)) for at in positions]
    assert max(errors) < 0.1


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_raster_equals_trace(device: GlDevice, samples: int) -> None:
    world = make_test_world(lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT))
    raster, trace = (
        renderer.prepare_perspective(CAMERA, samples).render(CAMERA_STATE).rgb
        for renderer in renderers(device, world).values()
    )
    # Sample positions are equal: only surfaces within a 256th of a sample may differ.
    assert (level_differences(raster, trace) > 2).mean() < 0.002


@pytest.mark.parametrize("kind", ["trace", "raster"])
def test_face_ahead_is_a_square_camera_of_90_degrees(device: GlDevice, kind: str) -> None:
    renderer = renderers(device, make_test_world())[kind]
    camera = PerspectiveCamera(96, 96, 0.5 * math.pi)
    assert np.array_equal(MIRROR_FROM_FACE_ROTATIONS[Face.N], np.eye(3))
    face = renderer.prepare_face(FaceCamera(Face.N, 96), 2).render(CAMERA_STATE).rgb
    assert np.array_equal(renderer.prepare_perspective(camera, 2).render(CAMERA_STATE).rgb, face)


def test_raster_renders_one_viewport_and_no_mirror(device: GlDevice) -> None:
    renderer = make_raster(device)
    view = renderer.prepare_perspective(CAMERA, 2)
    assert view.pass_names == ("faces", "average")
    assert view.face_counts.num_cells == 1
    assert view.face_counts.num_texels == 4 * 320 * 240
    assert not any("mirror" in name for name in renderer.program_names)
    view.close()


def test_zoom_compiles_no_program_and_renders_nothing_in_advance(device: GlDevice) -> None:
    renderer = make_raster(device)
    renderer.prepare_perspective(CAMERA, 2).close()
    built = renderer.program_names
    zoomed = renderer.prepare_perspective(PerspectiveCamera(320, 240, 0.5), 2)
    assert renderer.program_names == built
    assert zoomed.face_counts.num_cells == 0
    zoomed.close()


def test_image_beyond_the_device_is_rejected(device: GlDevice) -> None:
    renderer = make_raster(device)
    with pytest.raises(DomainError, match="too many"):
        renderer.prepare_perspective(PerspectiveCamera(100_000, 10, 1.0), 4)


@pytest.mark.parametrize("kind", ["trace", "raster"])
def test_objects_beside_the_image_change_no_pixel(device: GlDevice, kind: str) -> None:
    camera = PerspectiveCamera(64, 48, math.radians(60.0))
    view = renderers(device, make_test_world())[kind].prepare_perspective(camera, 1)
    random = np.random.default_rng(35)
    num_hidden = 0
    for _ in range(40):
        places = random.normal(0.0, 1.5, (6, 3)) + CAMERA_STATE.world_from_mirror.translation
        objects = tuple(place_cube(*place, size_m=random.uniform(0.1, 1.0)) for place in places)
        pose = Pose.from_rpy(CAMERA_STATE.world_from_mirror.translation, random.normal(size=3))
        state = CameraState(pose, objects)
        shown = hide_unseen(state, camera)
        num_hidden += len(objects) - len(shown.objects)
        assert np.array_equal(view.render(shown).rgb, view.render(state).rgb)
    assert 80 < num_hidden < 200


def test_object_is_hidden_only_where_all_of_it_is_behind() -> None:
    x, y, z = CAMERA_STATE.world_from_mirror.translation
    pose = Pose.from_rpy((x, y, z))
    behind, around = place_cube(x - 1.0, y, z), place_cube(x - 0.1, y, z)
    state = CameraState(pose, (behind, behind, around, behind))
    assert hide_unseen(state, CAMERA).objects == (around,)
    # Shadows fall into the image, and an exposure may turn it.
    for lit in (replace(state, has_shadows=True), replace(state, shutter=INSTANTANEOUS)):
        assert hide_unseen(lit, CAMERA) is lit
