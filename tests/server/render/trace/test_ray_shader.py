"""The colours of rays, by tabulated colours and by summed samples."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.trace.embree_objects import EmbreeObjectScenes
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.packed_light import SrgbScale
from catoptra_server.render.trace.ray_shader import UnshadowedShader
from catoptra_server.scene.scene_mesh import build_scene
from helpers.dynamic_objects import place_cube
from helpers.worlds import CAMERA_STATE, make_test_world

NONE = np.zeros(0, dtype=np.intp)


def shade_pixels(samples: int) -> UnshadowedShader:
    world = make_test_world()
    scene, objects = EmbreeScene(build_scene(world), world), EmbreeObjectScenes(world.lights)
    return UnshadowedShader(scene, objects, SrgbScale.for_samples(samples))


def random_directions(count: int) -> np.ndarray[tuple[int, int]]:
    found = np.random.default_rng(4).normal(size=(count, 3))
    return (found / np.linalg.norm(found, axis=1, keepdims=True)).astype(np.float32)


def test_ray_when_alone_in_its_pixel_is_as_several_of_the_same() -> None:
    rays, one, four = random_directions(500), shade_pixels(1), shade_pixels(4)
    alone = one.shade_rays(rays, one.transform_view(CAMERA_STATE), off_mirror=NONE)
    together = four.shade_rays(
        np.repeat(rays, 4, axis=0), four.transform_view(CAMERA_STATE), off_mirror=NONE
    )
    np.testing.assert_array_equal(alone, together)
    assert len(np.unique(alone, axis=0)) > 5


@pytest.mark.parametrize("samples", [1, 2])
def test_ray_when_off_the_mirror_is_black(samples: int) -> None:
    colours = shade_pixels(samples)
    off = np.arange(4 * samples)
    found = colours.shade_rays(
        random_directions(10 * samples), colours.transform_view(CAMERA_STATE), off_mirror=off
    )
    assert (found[:4] == 0).all()
    assert (found[4:] > 0).any(axis=1).all()


def test_object_in_view_is_visible_and_only_there() -> None:
    colours = shade_pixels(1)
    ahead, behind = np.float32([[1, 0, 0]]), np.float32([[-1, 0, 0]])
    camera_state = CameraState(Pose.from_rpy((0.0, 0.0, -0.6)), (place_cube(0.5, 0.0, -0.6),))
    placed = colours.transform_view(camera_state)
    rays = np.concatenate((ahead, behind))
    assert colours.shade_rays(rays, placed, off_mirror=NONE)[0].tolist() == [255, 0, 0]
    assert colours.shade_rays(rays, placed, off_mirror=NONE)[1].tolist() != [255, 0, 0]


def test_scene_behind_an_object_is_not_traced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    colours, num_traced = shade_pixels(2), []
    whole = EmbreeScene.trace_radiance

    def counting_trace(
        scene: EmbreeScene, origins: np.ndarray, *args: object, **how: object
    ) -> object:
        num_traced.append(len(origins))
        return whole(scene, origins, *args, **how)  # type: ignore[arg-type]

    monkeypatch.setattr(EmbreeScene, "trace_radiance", counting_trace)
    camera_state = CameraState(Pose.from_rpy((0.0, 0.0, -0.6)), (place_cube(0.5, 0.0, -0.6),))
    rays = np.float32([[1, 0, 0], [1, 0.01, 0], [-1, 0, 0], [0, 1, 0]])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    found = colours.shade_rays(rays, colours.transform_view(camera_state), off_mirror=NONE)
    assert num_traced == [2]
    assert found[0].tolist() == [255, 0, 0]


@pytest.mark.parametrize("samples", [1, 4])
def test_triangles_when_they_fill_pixels_have_the_colour_of_their_rays(samples: int) -> None:
    colours, rays = shade_pixels(samples), random_directions(200)
    origins = np.broadcast_to(colours.transform_view(CAMERA_STATE).origin, rays.shape)
    turned = rays @ colours.transform_view(CAMERA_STATE).rotation
    triangle = colours.scene.intersect(origins, turned)
    trace_image = colours.shade_rays(
        np.repeat(rays, samples, axis=0), colours.transform_view(CAMERA_STATE), off_mirror=NONE
    )
    np.testing.assert_array_equal(colours.shade_triangles(triangle), trace_image)
