"""The table of the camera model against the model."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_server.render.trace.projection_table import MAX_PIXEL_ERROR_PX, ProjectionTable
from helpers.worlds import make_omni_camera

CAMERAS = [
    make_omni_camera(width_px=1200),
    make_omni_camera(width_px=640, mirror=HyperbolicMirror(2.5, 0.1), rim_deg=90.0),
    make_omni_camera(width_px=640, mirror=ParabolicMirror(0.05), rim_deg=150.0),
    replace(make_omni_camera(width_px=300), image_up_azimuth_rad=2.1),
]
NAMES = ["the paper's", "strongly curved", "parabolic", "turned"]


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_pixel_when_looked_up_is_the_camera_model_s(camera: OmniCamera) -> None:
    rng = np.random.default_rng(1)
    directions, seen = direction_from_pixel(camera, rng.uniform(0.0, camera.width_px, (50_000, 2)))
    directions = np.concatenate((directions[seen], [[0.0, 0.0, 1.0]]))
    expected, _ = pixel_from_direction(camera, directions)
    u, v = ProjectionTable.from_camera(camera).pixel_from_direction(
        *directions.T.astype(np.float32)
    )
    assert np.abs(np.stack((u, v), axis=-1) - expected).max() < MAX_PIXEL_ERROR_PX


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_pixel_when_beyond_the_rim_is_beside_the_mirror(camera: OmniCamera) -> None:
    theta = np.linspace(camera.rim_rad + 0.01, math.pi - 1e-4, 500).astype(np.float32)
    u, v = ProjectionTable.from_camera(camera).pixel_from_direction(
        np.sin(theta), np.zeros_like(theta), np.cos(theta)
    )
    away = np.hypot(u - camera.centre_px[0], v - camera.centre_px[1])
    assert (away > camera.rim_radius_px).all()


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_magnification_bounds_the_displacement_by_a_small_rotation(camera: OmniCamera) -> None:
    rng = np.random.default_rng(2)
    pixels = rng.uniform(0.0, camera.width_px, (5_000, 2))
    here, seen = direction_from_pixel(camera, pixels)
    there = here + 1e-6 * rng.normal(size=here.shape)
    there /= np.linalg.norm(there, axis=-1, keepdims=True)
    moved, also_seen = pixel_from_direction(camera, there)
    valid = seen & also_seen
    angle = np.linalg.norm(there - here, axis=-1)[valid]
    incidence = np.arccos(np.minimum(here[valid, 2], there[valid, 2]))
    bound = angle * ProjectionTable.from_camera(camera).max_pixels_per_radian(incidence)
    way = np.linalg.norm(moved - pixels, axis=-1)[valid]
    assert (way <= 1.005 * bound + 1e-9).all()
    assert (way / bound).max() > 0.9  # and not idly


def test_table_when_the_rim_is_next_to_the_asymptote_neither_ends_nor_jumps() -> None:
    camera = make_omni_camera(width_px=640, mirror=HyperbolicMirror(2.001, 0.2), rim_deg=91.28)
    table = ProjectionTable.from_camera(camera)
    theta = np.linspace(0.0, math.acos(table.min_height) - 1e-3, 20_001)
    u, _ = table.pixel_from_direction(np.sin(theta), np.zeros_like(theta), np.cos(theta))
    v = table.pixel_from_direction(
        *(f(theta).astype(np.float32) for f in (np.sin, np.zeros_like, np.cos))
    )[1]
    steps = np.abs(np.diff(v))
    # No step in pixels exceeds the greatest magnification times the angle, plus the table's error.
    bound = table.max_pixels_per_radian(theta[1:]) * np.diff(theta) + 2.0 * MAX_PIXEL_ERROR_PX
    assert np.ptp(u) < 1e-3
    assert (steps <= bound).all()
    assert np.isfinite(table.max_magnification).all()


@pytest.mark.parametrize("rim_deg", [178.0, 179.9])
def test_table_when_the_rim_is_near_the_antipode_is_none_rather_than_endless(
    rim_deg: float,
) -> None:
    assert (
        ProjectionTable.from_camera(make_omni_camera(mirror=ParabolicMirror(0.05), rim_deg=rim_deg))
        is None
    )
