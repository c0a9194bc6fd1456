"""From a calibration's covariance to the distance of the picture from the lens."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.omni_camera import OmniCamera

CHAIN = """cam0:
  camera_model: ds
  intrinsics: [-0.17, 0.59, 156.1, 156.2, 254.5, 256.5]
  distortion_model: none
  distortion_coeffs: []
  resolution: [512, 512]
"""
NAMES = ("centre_u_px", "centre_v_px", "scale_px", "xi", "alpha")
SIGMAS = np.array((0.2, 0.3, 0.3, 1e-3, 5e-4))
CORRELATION = np.eye(5)
CORRELATION[2, 3] = CORRELATION[3, 2] = 0.9
COVARIANCE = CORRELATION * np.outer(SIGMAS, SIGMAS)


def write(folder: Path, line: str) -> Path:
    path = folder / "chain.yaml"
    path.write_text(f"# {line}\n{CHAIN}", encoding="utf-8")
    return path


def describe(covariance: np.ndarray, names: tuple[str, ...] = NAMES) -> str:
    numbers = " ".join(map(repr, covariance.ravel().tolist()))
    return f"catoptra_covariance: {' '.join(names)} | {numbers}"


def perturb(camera: OmniCamera, change: np.ndarray) -> OmniCamera:
    u, v, scale, xi, alpha = change.tolist()
    lens = camera.projection
    return replace(
        camera,
        projection=replace(lens, xi=lens.xi + xi, alpha=lens.alpha + alpha),
        centre_px=(camera.centre_px[0] + u, camera.centre_px[1] + v),
        scale_px=camera.scale_px + scale,
    )


def test_stated_part_covers_95_percent_of_perturbed_calibrations(tmp_path: Path) -> None:
    camera = camera_from_file(write(tmp_path, describe(COVARIANCE)))
    assert 0.3 < camera.model_error_px < 3.0
    pixels = np.stack(np.meshgrid(np.arange(0.0, 513.0, 32), np.arange(0.0, 513.0, 32)), axis=-1)
    directions, valid = camera.direction_from_pixel(pixels)
    seen, pixels = directions[valid], pixels[valid]
    changes = np.random.default_rng(1).multivariate_normal(np.zeros(5), COVARIANCE, 1000)
    covered = []
    for change in changes:
        moved, shown = perturb(camera, change).pixel_from_direction(seen)
        largest_px = np.linalg.norm(moved - pixels, axis=-1)[shown].max()
        covered.append(largest_px <= camera.model_error_px)
    assert 0.93 <= np.mean(covered) <= 0.97


def test_rms_counts_with_the_radius_of_95_percent(tmp_path: Path) -> None:
    camera = camera_from_file(write(tmp_path, "catoptra_rms_px: 0.2"))
    errors = np.random.default_rng(2).normal(0.0, 0.2 / np.sqrt(2.0), (100000, 2))
    assert (np.hypot(*errors.T) <= camera.model_error_px).mean() == pytest.approx(0.95, abs=0.005)


def test_file_without_a_statement_has_no_part(tmp_path: Path) -> None:
    assert camera_from_file(write(tmp_path, "by hand")).model_error_px == 0.0


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (describe(-COVARIANCE), "positive"),
        (describe(COVARIANCE * 0.0), "positive"),
        (describe(np.triu(COVARIANCE)), "symmetric"),
        (describe(COVARIANCE * np.nan), "positive"),
        (describe(COVARIANCE[:4]), "5 x 5 numbers"),
        (describe(COVARIANCE, ("k7", *NAMES[1:])), "k7"),
        ("catoptra_covariance: ", "0 x 0"),
        ("catoptra_rms_px: -1", "0 or more"),
        ("avg_reprojection_error: much", "0 or more"),
    ],
)
def test_wrong_statement_is_rejected_in_one_line(tmp_path: Path, line: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words) as found:
        camera_from_file(write(tmp_path, line))
    assert "\n" not in str(found.value)
