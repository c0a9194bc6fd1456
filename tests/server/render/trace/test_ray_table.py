"""The rays of cameras, in blocks of 4 x 4."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.render.renderer import FaceCamera, PerPixel
from catoptra_server.render.trace import ray_table
from catoptra_server.render.trace.ray_table import (
    BLOCK_RAYS,
    face_ray_table,
    lens_ray_table,
    omni_ray_table,
)
from catoptra_server.world.mirror_mesh import tessellation_from_polygon_count
from helpers.ray_grids import grid_directions, grid_validity
from helpers.worlds import make_omni_camera, make_plan

CAMERA = make_omni_camera(width_px=40)


def sample_grid(camera: OmniCamera | PerspectiveCamera, samples: int) -> Floats:
    """(h * samples, w * samples, 2) pixel positions."""
    positions = pixel_sample_positions(camera, samples)
    split = positions.reshape(camera.height_px, camera.width_px, samples, samples, 2)
    return split.swapaxes(1, 2).reshape(camera.height_px * samples, -1, 2)


CAMERAS = {
    **{str(width_px): make_omni_camera(width_px=width_px) for width_px in (3, 40, 41)},
    "in a wide picture": replace(CAMERA, width_px=90, centre_px=(51.3, 12.6)),
    "in a corner": replace(CAMERA, centre_px=(47.0, -9.5)),
    "in the next picture": replace(CAMERA, centre_px=(-30.0, 20.0)),
}


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("samples", [1, 2, 3])
def test_rays_of_the_camera_model_are_at_their_places_in_the_grid(
    samples: int, camera: OmniCamera
) -> None:
    rays = omni_ray_table(camera, make_plan(camera, samples=samples))
    expected, valid = direction_from_pixel(camera, sample_grid(camera, samples))
    np.testing.assert_array_equal(grid_validity(rays), valid)
    np.testing.assert_allclose(
        grid_directions(rays)[valid],
        expected[valid],
        atol=1e-7,  # float32
    )


def test_arrays_have_the_layout_that_the_kernel_reads() -> None:
    rays = omni_ray_table(CAMERA, make_plan(CAMERA, samples=2))
    count = len(rays.tiles)
    assert rays.directions.shape == (count, 4, 3, BLOCK_RAYS)
    assert rays.valid.shape == (count, 4)
    for array, dtype in ((rays.tiles, "int32"), (rays.directions, "float32"), (rays.valid, "u2")):
        assert array.dtype == dtype
        assert array.flags.c_contiguous
    assert rays.memory_bytes == count * (4 + 4 * 3 * 16 * 4 + 4 * 2)


def test_tiles_are_those_with_a_ray_on_the_mirror() -> None:
    rays = omni_ray_table(CAMERA, make_plan(CAMERA))
    assert rays.num_tile_columns == 10
    assert (rays.valid != 0).any(axis=1).all()
    assert (np.diff(rays.tiles) > 0).all()
    # The tile at the image's corner is off the mirror, that in the middle of its top is not.
    assert 0 not in rays.tiles
    assert 5 in rays.tiles


def test_rays_beside_the_mirror_look_along_the_axis() -> None:
    rays = omni_ray_table(CAMERA, make_plan(CAMERA))
    bits = (rays.valid[..., None] >> np.arange(BLOCK_RAYS)) & 1
    beside = rays.directions.swapaxes(-1, -2)[bits == 0]
    assert len(beside) > 20
    assert (beside == (0.0, 0.0, 1.0)).all()


def test_rays_of_polygons_leave_out_uncovered_pixels() -> None:
    exact = omni_ray_table(CAMERA, make_plan(CAMERA))
    polygons = omni_ray_table(CAMERA, make_plan(CAMERA, tessellation_from_polygon_count(16)))
    # Derived: four sectors cover 0.634 of the disc.
    ratio = grid_validity(polygons).sum() / grid_validity(exact).sum()
    assert ratio == pytest.approx(0.634, abs=0.02)


@pytest.mark.parametrize("face", list(Face))
def test_rays_when_of_a_face_run_right_and_down_in_its_camera(face: Face) -> None:
    rays = face_ray_table(FaceCamera(face, 4), samples=1)
    local = grid_directions(rays) @ MIRROR_FROM_FACE_ROTATIONS[face]
    local /= local[..., :1]
    np.testing.assert_allclose(local[0, :, 1], [-0.75, -0.25, 0.25, 0.75], atol=1e-6)
    np.testing.assert_allclose(local[:, 0, 2], [-0.75, -0.25, 0.25, 0.75], atol=1e-6)


def test_rays_of_a_lens_are_the_lens_model_s_at_every_pixel() -> None:
    camera = PerspectiveCamera(5, 3, 1.2)
    rays = lens_ray_table(camera, 2)
    assert (rays.width_px, rays.height_px, rays.samples) == (5, 3, 2)
    expected, _ = camera.direction_from_pixel(sample_grid(camera, 2))
    np.testing.assert_allclose(grid_directions(rays), expected, atol=1e-7)  # float32
    # Eight columns of tiles, five of them in the image: the others have no ray.
    assert grid_validity(rays).shape == (6, 10)
    assert grid_validity(rays).all()
    assert sum(int(bits).bit_count() for bits in rays.valid.reshape(-1)) == 60


@pytest.mark.parametrize("samples", [0, -1, 17])
def test_samples_that_no_pixel_can_have_are_refused(samples: int) -> None:
    with pytest.raises(DomainError, match=f"^{samples} samples along a pixel's side"):
        lens_ray_table(PerspectiveCamera(5, 3, 1.2), samples)


@pytest.mark.parametrize("polygons", [None, 64])
@pytest.mark.parametrize("samples", [1, 3])
def test_rays_when_computed_in_batches_are_those_of_one_batch(
    monkeypatch: pytest.MonkeyPatch, samples: int, polygons: int | None
) -> None:
    surface = tessellation_from_polygon_count(polygons) if polygons else PerPixel()
    plan = make_plan(CAMERA, surface, samples=samples)
    whole = omni_ray_table(CAMERA, plan)
    # Three rows of tiles a batch: ten rows leave a batch of one.
    monkeypatch.setattr(ray_table, "_SAMPLES_PER_BATCH", 3 * 4 * 40 * samples**2)
    rays = omni_ray_table(CAMERA, plan)
    assert rays.directions.tobytes() == whole.directions.tobytes()
    np.testing.assert_array_equal(rays.tiles, whole.tiles)
    np.testing.assert_array_equal(rays.valid, whole.valid)


def test_rays_of_two_million_samples_take_half_as_much_memory_as_their_float64_form() -> None:
    camera = make_omni_camera(width_px=720)
    tracemalloc.start()
    try:
        omni_ray_table(camera, make_plan(camera, samples=2))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # 24 bytes each for positions and directions alone, in float64; all at once took 269 MB.
    assert peak < 60 * 720 * 720 * 4
