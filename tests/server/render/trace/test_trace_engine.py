"""What both engines share: exposures, the scene's centre, and images from tiles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.omni_camera import direction_from_pixel
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.ray_table import RayTable
from catoptra_server.render.trace.trace_engine import (
    MovingExposure,
    assemble_grid,
    assemble_tiles,
    camera_states,
)
from catoptra_server.world.objects import CameraState
from helpers.dynamic_objects import TWO_ROBOTS, place_cube
from helpers.effect_measurement import CAMERA
from helpers.range_images import CAMERA_ABOVE_FLOOR, FLOOR, VIEWPOINT_HEIGHT_M, trace_ranges
from helpers.worlds import CAMERA_STATE


def make_empty_table(width_px: int, height_px: int, samples: int, tiles: list[int]) -> RayTable:
    """A table whose rays all look along the axis."""
    blocks = (len(tiles), samples**2)
    return RayTable(
        width_px,
        height_px,
        samples,
        np.array(tiles, dtype=np.int32),
        np.zeros((*blocks, 3, 16), dtype=np.float32),
        np.full(blocks, 0xFFFF, dtype=np.uint16),
    )


def test_moving_exposure_needs_two_states() -> None:
    with pytest.raises(DomainError, match="at least two"):
        MovingExposure((CAMERA_STATE,))


def test_moving_exposure_needs_the_same_objects_in_all_states() -> None:
    one, other = (replace(CAMERA_STATE, objects=TWO_ROBOTS[:n]) for n in (1, 2))
    with pytest.raises(DomainError, match="same objects"):
        MovingExposure((one, other))
    cubes = replace(CAMERA_STATE, objects=(place_cube(1.0, 0.0, 0.0),))
    with pytest.raises(DomainError, match="same objects"):
        MovingExposure((one, cubes))


def test_states_of_an_exposure_are_its_own_or_the_one_itself() -> None:
    later = CameraState(Pose.from_rpy((1.0, 0.0, 0.0)))
    assert camera_states(CAMERA_STATE) == (CAMERA_STATE,)
    assert camera_states(MovingExposure((CAMERA_STATE, later))) == (CAMERA_STATE, later)


def test_tiles_when_assembled_are_at_their_places_and_cut_at_the_image() -> None:
    rays = make_empty_table(6, 5, 1, [0, 1, 3])
    tiles = np.arange(3 * 16, dtype=np.int32).reshape(3, 4, 4, 1)
    image = assemble_tiles(rays, tiles, fill=-1)[..., 0]
    assert image.shape == (5, 6)
    assert image[0].tolist() == [0, 1, 2, 3, 16, 17]
    assert image[3].tolist() == [12, 13, 14, 15, 28, 29]
    assert image[4].tolist() == [-1, -1, -1, -1, 32, 33]


def test_grid_of_samples_has_blocks_side_by_side() -> None:
    rays = make_empty_table(4, 4, 2, [0])
    values = np.arange(64, dtype=np.float32).reshape(1, 4, 16, 1)
    grid = assemble_grid(rays, values, fill=np.float32(np.nan))[..., 0]
    assert grid.shape == (8, 8)
    assert grid[0].tolist() == [0, 1, 2, 3, 16, 17, 18, 19]
    assert grid[4].tolist() == [32, 33, 34, 35, 48, 49, 50, 51]


def test_range_over_a_level_floor_is_that_of_the_camera_model() -> None:
    directions, on_mirror = direction_from_pixel(CAMERA, pixel_sample_positions(CAMERA)[..., 0, :])
    down = directions[..., 2]
    near = on_mirror & (down > 0.1)
    seen = trace_ranges(FLOOR, CAMERA_ABOVE_FLOOR)
    assert not np.isfinite(seen[~on_mirror | (down < 0.0)]).any()
    np.testing.assert_allclose(seen[near], VIEWPOINT_HEIGHT_M / down[near], rtol=1e-5)
