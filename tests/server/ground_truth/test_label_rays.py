"""Rays of labels: which effects change them, and at which times they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from catoptra_server.effects.medium.misalignment import Misalignment
from catoptra_server.frames.labels.labels import (
    build_label_rays,
    label_exposure,
    make_ray_source,
)
from catoptra_server.render.trace.trace_engine import MovingExposure, assemble_grid
from catoptra_server.world.camera_state import INSTANTANEOUS
from catoptra_server.world.world_description import Twist
from helpers.labelled_rooms import CAMERAS, STATE

CAMERA = CAMERAS["paper"]
ROLLING = INSTANTANEOUS.with_exposure(0.01, 1.0).with_readout(0.03, 4.0)


def test_exposure_time_alone_changes_no_ray() -> None:
    blurred = make_ray_source(CAMERA, None, INSTANTANEOUS.with_exposure(0.01, 1.0))
    assert blurred == make_ray_source(CAMERA, None, None)
    assert build_label_rays(blurred, 1).times is None


def test_rows_have_times_around_the_middle() -> None:
    for samples in (1, 3):
        table = build_label_rays(make_ray_source(CAMERA, None, ROLLING), samples)
        assert table.times is not None
        image = assemble_grid(table, table.times[..., None], fill=np.float32(np.nan))[..., 0]
        rows = np.nanmean(image[samples // 2 :: samples], axis=1)
        expected = 0.5 + 0.03 / 0.04 * ((np.arange(96) + 0.5) / 96 - 0.5)
        seen = np.isfinite(rows)
        np.testing.assert_allclose(rows[seen], expected[seen], atol=1e-6)


def test_displaced_camera_has_rays_of_its_own() -> None:
    displaced = build_label_rays(make_ray_source(CAMERA, Misalignment(x_m=0.003), None), 1)
    aligned = build_label_rays(make_ray_source(CAMERA, None, None), 1)
    common = np.isin(displaced.tiles, aligned.tiles)
    there = np.searchsorted(aligned.tiles, displaced.tiles[common])
    turn = np.abs(displaced.directions[common] - aligned.directions[there])
    assert 0.001 < np.median(turn) < 0.1


def test_labels_know_neither_light_nor_air() -> None:
    state = replace(STATE, has_shadows=True, shutter=ROLLING, twist=Twist((1.0, 0.0, 0.0)))
    exposure = label_exposure(state)
    assert isinstance(exposure, MovingExposure)
    assert not any(one.has_shadows or one.shutter for one in exposure.states)
    still = label_exposure(replace(state, shutter=None))
    assert not isinstance(still, MovingExposure)
    assert not still.has_shadows
