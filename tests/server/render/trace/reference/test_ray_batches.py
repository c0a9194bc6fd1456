"""Batches of a table have every valid ray once; pixels are means of their samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.render.trace.ray_table import RayTable, omni_ray_table
from catoptra_server.render.trace.reference import engine as ray_batches
from catoptra_server.render.trace.reference.engine import (
    RayBatch,
    mean_pixels,
    read_batch,
    split_tiles,
)
from helpers.worlds import make_omni_camera, make_plan

CAMERA = make_omni_camera(width_px=61)


def read_batches(table: RayTable) -> list[RayBatch]:
    return [read_batch(table, tiles) for tiles in split_tiles(table)]


@pytest.mark.parametrize("samples", [1, 2])
def test_batches_have_every_valid_ray_once(monkeypatch: pytest.MonkeyPatch, samples: int) -> None:
    table = omni_ray_table(CAMERA, make_plan(CAMERA, samples=samples))
    monkeypatch.setattr(ray_batches, "_RAYS_PER_BATCH", 1000)
    batches = read_batches(table)
    assert len(batches) > 3
    valid = np.concatenate([16 * samples**2 * batch.tiles.start + batch.rays for batch in batches])
    assert len(valid) == sum(int(bits).bit_count() for bits in table.valid.reshape(-1))
    assert len(np.unique(valid)) == len(valid)
    directions = np.concatenate([batch.directions for batch in batches])
    expected = table.directions.swapaxes(-1, -2).reshape(-1, 3)[valid]
    np.testing.assert_allclose(directions, expected, atol=2e-7)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, rtol=1e-15)


def test_batches_have_the_origins_and_times_of_their_rays() -> None:
    table = omni_ray_table(CAMERA, make_plan(CAMERA))
    shape = (*table.valid.shape, 16)
    times = np.random.default_rng(1).uniform(size=shape).astype(np.float32)
    table = replace(table, times=times, origins=np.repeat(times[:, :, None], 3, axis=2))
    for batch in read_batches(table):
        assert batch.times is not None
        np.testing.assert_array_equal(batch.times, times[batch.tiles].reshape(-1)[batch.rays])
        np.testing.assert_array_equal(batch.origins, np.repeat(batch.times[:, None], 3, axis=1))


def test_rays_without_origins_and_times_begin_at_the_viewpoint() -> None:
    for batch in read_batches(omni_ray_table(CAMERA, make_plan(CAMERA))):
        assert batch.times is None
        assert not batch.origins.any()


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_pixels_are_the_means_of_their_samples(samples: int) -> None:
    # The grid of samples, whose pixels are squares of samples x samples; in blocks of 4 x 4.
    side = 4 * samples
    grid = np.random.default_rng(2).uniform(size=(side, side))
    blocks = grid.reshape(samples, 4, samples, 4).swapaxes(1, 2).reshape(1, samples**2, 16, 1)
    expected = grid.reshape(4, samples, 4, samples).mean(axis=(1, 3))
    np.testing.assert_allclose(mean_pixels(blocks, samples)[0, ..., 0], expected)
