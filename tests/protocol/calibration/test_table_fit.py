"""Cameras from ray tables: measured lenses with their centre and stretch."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.calibration_folder import write_calibration
from catoptra_protocol.calibration.model_fits import compute_residual
from catoptra_protocol.calibration.ray_table import PixelRays, fit_table, make_ray_table
from catoptra_protocol.errors import ConfigError, DomainError
from catoptra_protocol.optics.lenses import RadialTableLens
from catoptra_protocol.optics.mirrors import SphericalMirror
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture
from helpers.calibrated_cameras import PAPER, THETA_BACK, TUM_VI, TUM_VI_KB

FLIPPED = PAPER.with_picture(Picture.FLIPPED)


@pytest.mark.parametrize(
    ("camera", "max_px"),
    [(FLIPPED, 1e-4), (TUM_VI, 1e-5), (TUM_VI_KB, 1e-6)],
    ids=["paper", "ds", "kb"],
)
def test_camera_of_a_table_is_the_camera(camera: OmniCamera, max_px: float) -> None:
    found = fit_table(make_ray_table(camera))
    assert isinstance(found.projection, RadialTableLens)
    assert found.centre_px == pytest.approx(camera.centre_px, abs=1e-4)
    assert found.plane.stretch == pytest.approx(camera.plane.stretch, abs=1e-6)
    residual = compute_residual(camera, found)
    assert residual.max_px < max_px
    # The outermost ring of pixels lies beyond the last centre.
    assert residual.fraction_missing < 0.02


@pytest.mark.parametrize("picture", list(Picture))
def test_exported_table_is_read_as_the_camera_of_its_pictures(
    picture: Picture, tmp_path: Path
) -> None:
    write_calibration(PAPER, tmp_path, name="cam", picture=picture)
    back = camera_from_file(tmp_path / "ray_table.npz")
    assert back.picture is picture
    assert compute_residual(PAPER, back).max_px < 1e-4
    other = next(one for one in Picture if one is not picture)
    with pytest.raises(ConfigError, match=f"a file of {other.value} pictures"):
        camera_from_file(tmp_path / "ray_table.npz", picture=other)


def test_rays_of_no_radial_lens_are_refused_with_the_number() -> None:
    # Tangential distortion of a published fish-eye: 2 px.
    with pytest.raises(DomainError, match=r"off its rays by up to 1\.\d+ px"):
        fit_table(make_ray_table(THETA_BACK))


def test_rays_without_a_common_origin_are_refused(tmp_path: Path) -> None:
    ball = camera_with_inscribed_rim(
        SphericalMirror(0.03, 0.2),
        width_px=60,
        height_px=60,
        rim_rad=math.radians(120.0),
        picture=Picture.FLIPPED,
    )
    write_calibration(ball, tmp_path, name="ball")
    with pytest.raises(ConfigError, match="do not begin at one point"):
        camera_from_file(tmp_path / "ray_table.npz")


def test_rays_at_random_are_refused() -> None:
    direction = np.random.default_rng(1).normal(size=(20, 20, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    table = PixelRays(direction, np.ones((20, 20), dtype=bool), np.zeros(3), Picture.FLIPPED)
    with pytest.raises(DomainError):
        fit_table(table)


def test_rays_that_show_no_lens_are_refused() -> None:
    whole = make_ray_table(FLIPPED)
    few = np.zeros_like(whole.valid)
    few[180, 100:150] = True
    with pytest.raises(DomainError, match="50 rays are too few"):
        fit_table(PixelRays(whole.direction, few, whole.origin_m, Picture.FLIPPED))
    along_axis = np.broadcast_to((0.0, 0.0, 1.0), whole.direction.shape)
    with pytest.raises(DomainError, match="within 0 deg of the axis"):
        fit_table(PixelRays(along_axis, whole.valid, whole.origin_m, Picture.FLIPPED))
