"""Packed regions never overlap; atlas and lookup map hold the directions of the camera model."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import (
    MIRROR_FROM_FACE_ROTATIONS,
    Face,
    face_coordinates,
    face_from_direction,
)
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_server.frames.plan.faces import face_regions
from catoptra_server.render.projection.atlas import (
    OUTSIDE_MIRROR,
    Atlas,
    atlas_coordinates,
    compute_lookup_map,
    pack_atlas,
)
from helpers.worlds import make_omni_camera, regions_of_size


def pack_uniform(limit_deg: float, *, size: int = 64, max_texels: int = 16384) -> Atlas:
    parts = regions_of_size(math.radians(limit_deg), size)
    return pack_atlas(parts, guard_texels=2, max_texels=max_texels)


def pack_dense(rim_deg: float) -> Atlas:
    camera = make_omni_camera(rim_deg=rim_deg)
    parts = face_regions(camera, camera.rim_rad, size_px=0, texels_per_px=1.0)
    return pack_atlas(parts, guard_texels=2, max_texels=16384)


def directions_up_to(limit_deg: float) -> Floats:
    theta = np.radians(np.linspace(0.0, limit_deg, 181))
    gamma = np.radians(np.linspace(-180.0, 180.0, 361))
    theta, gamma = np.meshgrid(theta, gamma, indexing="ij")
    ring = np.sin(theta)
    grid = np.stack((ring * np.cos(gamma), ring * np.sin(gamma), np.cos(theta)), axis=-1)
    return grid.reshape(-1, 3)


@pytest.mark.parametrize(
    ("limit_deg", "cells"), [(30.0, 1), (44.0, 1), (46.0, 5), (120.0, 5), (125.0, 5)]
)
def test_faces_that_the_mirror_does_not_see_have_no_cell(limit_deg: float, cells: int) -> None:
    assert len(pack_uniform(limit_deg).cells) == cells


def test_rows_above_the_rim_have_no_texels() -> None:
    # t = -tan 30 deg sqrt 2 = -0.816: 26 of 32 rows above the horizon, 32 below, twice the guard.
    side = next(cell for cell in pack_uniform(120.0).cells if cell.region.face is Face.N)
    assert side.height == math.ceil(32 * (1.0 + math.tan(math.radians(30.0)) * math.sqrt(2.0))) + 4
    assert side.width == 68


@pytest.mark.parametrize("rim_deg", [60.0, 90.0, 100.0, 120.0, 130.0, 150.0])
def test_cells_do_not_overlap_and_waste_little_of_their_texture(rim_deg: float) -> None:
    packed = pack_dense(rim_deg)
    covered = np.zeros((packed.height, packed.width), dtype=int)
    for cell in packed.cells:
        covered[cell.y : cell.y + cell.height, cell.x : cell.x + cell.width] += 1
    assert sum(cell.width * cell.height for cell in packed.cells) == covered.sum()
    assert covered.max() == 1
    assert covered.mean() > 0.8


def test_cells_fill_a_texture_that_contains_few_in_a_row() -> None:
    packed = pack_uniform(130.0, max_texels=3 * 68)
    assert (packed.height, packed.width) in ((2 * 68, 3 * 68), (3 * 68, 2 * 68))


@pytest.mark.parametrize("rim_deg", [60.0, 100.0, 120.0, 130.0])
def test_projection_puts_a_direction_on_its_texel(rim_deg: float) -> None:
    packed = pack_dense(rim_deg)
    rng = np.random.default_rng(3)
    for cell in packed.cells:
        window = cell.region.window
        low, high = (window.left, window.top), (window.right, window.bottom)
        st = rng.uniform(low, high, (50, 2))
        directions = (
            np.column_stack((np.ones(len(st)), st)) @ MIRROR_FROM_FACE_ROTATIONS[cell.region.face].T
        )
        x, y, w = cell.clip_from_mirror @ (2.5 * directions.T)
        texel_x = cell.x + 0.5 * (x / w + 1.0) * cell.width
        texel_y = cell.y + 0.5 * (y / w + 1.0) * cell.height
        expected = packed.texels_from_direction(directions)
        assert np.column_stack((texel_x, texel_y)) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    "rim_deg", [30.0, 44.9, 45.1, 60.0, 89.0, 91.0, 120.0, 125.2, 125.3, 150.0]
)
def test_bilinear_look_up_of_any_direction_stays_in_one_cell(rim_deg: float) -> None:
    packed = pack_dense(rim_deg)
    texels = packed.texels_from_direction(directions_up_to(rim_deg))
    inside = np.zeros(len(texels), dtype=bool)
    for cell in packed.cells:
        low = np.array((cell.x, cell.y)) + 0.5
        high = low + np.array((cell.width - 1.0, cell.height - 1.0))
        inside |= ((texels >= low) & (texels <= high)).all(axis=-1)
    assert inside.all()


def test_coordinates_of_a_direction_are_on_the_face_of_the_cube() -> None:
    packed = pack_uniform(130.0)
    directions = np.random.default_rng(5).normal(size=(2000, 3))
    face = face_from_direction(directions)
    positions = {cell.region.face: cell.texel_transform for cell in packed.cells}
    centre, per_unit = np.split(np.array([positions[Face(f)] for f in face]), 2, axis=-1)
    expected = centre + face_coordinates(directions, face) * per_unit
    assert packed.texels_from_direction(directions) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("size", "limit"), [(17000, 16384), (9000, 16384)])
def test_pack_when_the_device_is_too_small_reports_the_limit(size: int, limit: int) -> None:
    with pytest.raises(DomainError, match=str(limit)):
        pack_uniform(120.0, size=size, max_texels=limit)


# Off centre, not square, turned, cut by the image.
OFF_CENTRE = OmniCamera(HyperbolicMirror(11.546, 0.2), 90, 70, (41.3, 36.6), 24.0, 2.0, 0.4)


def pack_camera_atlas(camera: OmniCamera) -> Atlas:
    return pack_atlas(regions_of_size(camera.rim_rad, 128), guard_texels=2, max_texels=4096)


@pytest.mark.parametrize("samples", [1, 2, 3])
@pytest.mark.parametrize(
    "camera", [make_omni_camera(width_px=64), OFF_CENTRE], ids=["centred", "turned"]
)
def test_samples_stand_in_their_pixels_as_trace_has_them(camera: OmniCamera, samples: int) -> None:
    atlas = pack_camera_atlas(camera)
    pixels = pixel_sample_positions(camera, samples)
    directions, seen = direction_from_pixel(camera, pixels)
    expected = atlas.texels_from_direction(directions) / (atlas.width, atlas.height)
    expected[~seen] = OUTSIDE_MIRROR
    shape = (camera.height_px, camera.width_px, samples, samples, 2)
    grid = expected.reshape(shape).swapaxes(1, 2).reshape(shape[0] * samples, -1, 2)
    assert np.array_equal(compute_lookup_map(camera, atlas, samples), grid.astype(np.float32))


def test_only_samples_on_the_mirror_have_coordinates() -> None:
    camera = make_omni_camera(width_px=64)
    positions = compute_lookup_map(camera, pack_camera_atlas(camera), 2)
    _, seen = direction_from_pixel(camera, pixel_sample_positions(camera, 2))
    assert (positions[..., 0] >= 0.0).sum() == seen.sum()
    assert (positions <= 1.0).all()
    assert (positions[positions[..., 0] < 0.0] == OUTSIDE_MIRROR).all()


def test_axis_looks_at_the_centre_of_the_bottom() -> None:
    camera = make_omni_camera(width_px=64)
    atlas = pack_camera_atlas(camera)
    bottom = atlas.texel_transforms()[4, :2] / (atlas.width, atlas.height)
    place = atlas_coordinates(camera, atlas, np.array([camera.centre_px]))
    assert place[0] == pytest.approx(bottom, abs=1e-7)
