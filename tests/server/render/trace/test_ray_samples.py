"""The rays of cameras."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_protocol.optics.omni_camera import direction_from_pixel, pixel_sample_positions
from catoptra_server.render.renderer import FaceCamera
from catoptra_server.render.trace import ray_samples
from catoptra_server.render.trace.ray_samples import face_rays, lens_rays, omni_rays
from catoptra_server.robot.render_settings import PerPixel
from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from helpers.worlds import make_omni_camera, make_plan

CAMERA = make_omni_camera(width_px=40)


@pytest.mark.parametrize("samples", [1, 3])
def test_rays_of_the_camera_model_are_those_of_the_disc_s_pixels(samples: int) -> None:
    rays = omni_rays(CAMERA, make_plan(CAMERA, samples=samples))
    assert (rays.width_px, rays.height_px, rays.samples_per_pixel) == (40, 40, samples**2)
    assert len(rays.directions) == len(rays.on_mirror) == len(rays.pixels) * samples**2
    # A disc of 20 px radius; pixels at its edge count if one of their samples is on it.
    assert rays.on_mirror.sum() / samples**2 == pytest.approx(np.pi * 400.0, rel=0.01)
    assert (rays.on_mirror.reshape(-1, samples**2).any(axis=1)).all()


def test_ray_of_a_pixel_is_the_camera_model_s() -> None:
    rays = omni_rays(CAMERA, make_plan(CAMERA))
    rows, columns = np.divmod(rays.pixels, 40)
    expected, _ = direction_from_pixel(CAMERA, np.stack((columns + 0.5, rows + 0.5), axis=-1))
    np.testing.assert_allclose(rays.directions, expected, atol=1e-7)  # float32
    assert rays.directions.dtype == np.float32


def test_rays_of_polygons_leave_out_uncovered_pixels() -> None:
    exact = omni_rays(CAMERA, make_plan(CAMERA))
    polygons = omni_rays(CAMERA, make_plan(CAMERA, tessellation_from_polygon_count(16)))
    # Derived: four sectors cover 0.634 of the disc.
    assert len(polygons.pixels) / len(exact.pixels) == pytest.approx(0.634, abs=0.02)


@pytest.mark.parametrize("face", list(Face))
def test_rays_when_of_a_face_run_right_and_down_in_its_camera(face: Face) -> None:
    rays = face_rays(FaceCamera(face, 4), samples=1)
    local = (rays.directions @ MIRROR_FROM_FACE_ROTATIONS[face]).reshape(4, 4, 3)
    local /= local[..., :1]
    np.testing.assert_allclose(local[0, :, 1], [-0.75, -0.25, 0.25, 0.75], atol=1e-6)
    np.testing.assert_allclose(local[:, 0, 2], [-0.75, -0.25, 0.25, 0.75], atol=1e-6)


def test_samples_when_of_a_face_lie_inside_their_pixel() -> None:
    rays = face_rays(FaceCamera(Face.N, 2), samples=2)
    local = rays.directions / rays.directions[:, :1]
    first = local[:4, 1:]
    assert (first < 0.0).all()
    np.testing.assert_allclose(first.mean(axis=0), (-0.5, -0.5), atol=1e-6)


def test_rays_of_a_lens_are_the_lens_model_s_at_every_pixel() -> None:
    camera = PerspectiveCamera(5, 3, 1.2)
    rays = lens_rays(camera, 2)
    assert (rays.width_px, rays.height_px, rays.samples_per_pixel) == (5, 3, 4)
    expected, _ = camera.direction_from_pixel(pixel_sample_positions(camera, 2))
    np.testing.assert_allclose(rays.directions, expected.reshape(-1, 3), atol=1e-7)  # float32
    assert rays.on_mirror.all()


@pytest.mark.parametrize("polygons", [None, 64])
@pytest.mark.parametrize("samples", [1, 3])
def test_rays_when_computed_in_batches_are_those_of_one_batch(
    monkeypatch: pytest.MonkeyPatch, samples: int, polygons: int | None
) -> None:
    surface = tessellation_from_polygon_count(polygons) if polygons else PerPixel()
    plan = make_plan(CAMERA, surface, samples=samples)
    whole = omni_rays(CAMERA, plan)
    # Three rows a batch: 40 rows leave a batch of one.
    monkeypatch.setattr(ray_samples, "_SAMPLES_PER_BATCH", 3 * 40 * samples**2)
    rays = omni_rays(CAMERA, plan)
    assert rays.height_px == 40
    assert rays.directions.tobytes() == whole.directions.tobytes()
    np.testing.assert_array_equal(rays.pixels, whole.pixels)
    np.testing.assert_array_equal(rays.on_mirror, whole.on_mirror)


def test_rays_of_two_million_samples_take_half_as_much_memory_as_their_float64_form() -> None:
    camera = make_omni_camera(width_px=720)
    tracemalloc.start()
    try:
        omni_rays(camera, make_plan(camera, samples=2))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # 24 bytes each for positions and directions alone, in float64; all at once took 269 MB.
    assert peak < 60 * 720 * 720 * 4
