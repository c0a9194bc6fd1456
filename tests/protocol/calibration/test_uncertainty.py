"""From a calibration's covariance to the distance of the picture from the lens."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.uncertainty import draw_camera
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


def test_drawn_cameras_have_the_covariance_of_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, describe(COVARIANCE))
    camera, text = camera_from_file(path), path.read_text(encoding="utf-8")
    generator = np.random.default_rng(3)
    moves = []
    for _ in range(2000):
        one = draw_camera(camera, text, str(path), generator.standard_normal)
        u, v = np.subtract(one.centre_px, camera.centre_px)
        lens, own = one.projection, camera.projection
        moves.append(
            (u, v, one.scale_px - camera.scale_px, lens.xi - own.xi, lens.alpha - own.alpha)
        )
    found = np.cov(np.array(moves).T) / np.outer(SIGMAS, SIGMAS)
    # Of 2000 draws an entry has a standard deviation of at most 3 %.
    np.testing.assert_allclose(found, CORRELATION, atol=0.12)


@pytest.mark.parametrize(
    ("names", "sizes"), [(("p1", "k1", "stretch_1"), (1e-4, 1e-3, 1e-3)), (("k2",), (1e-3,))]
)
def test_drawn_camera_moves_parameters_of_plane_and_lens(
    tmp_path: Path, names: tuple[str, ...], sizes: tuple[float, ...]
) -> None:
    chain = CHAIN.replace("camera_model: ds", "camera_model: pinhole")
    chain = chain.replace("-0.17, 0.59, ", "").replace("none", "radtan")
    path = tmp_path / "chain.yaml"
    path.write_text(
        chain.replace("coeffs: []", "coeffs: [-0.1, 0.01, 1e-4, 2e-4]"), encoding="utf-8"
    )
    camera = camera_from_file(path)
    text = describe(np.diag(np.square(sizes)), names)
    one = draw_camera(camera, text, "chain.yaml", np.ones)
    for name, size in zip(names, sizes, strict=True):
        owner = "projection" if name.startswith("k") else "plane"
        values = [getattr(getattr(each, owner), name.partition("_")[0]) for each in (one, camera)]
        moved = values[0][1] - values[1][1] if name == "stretch_1" else values[0] - values[1]
        assert moved == pytest.approx(size)


def test_drawing_from_a_file_without_a_covariance_is_an_error(tmp_path: Path) -> None:
    camera = camera_from_file(write(tmp_path, ""))
    with pytest.raises(ConfigError, match="to draw a camera from"):
        draw_camera(camera, "", "chain.yaml", np.ones)
