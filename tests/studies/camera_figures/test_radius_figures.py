"""Radii of rings in a frame, and the deviation of Eq. 2 against numbers derived independently."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.numerics import Floats
from catoptra_studies.camera_figures.figure_spec import FigureInputs
from catoptra_studies.camera_figures.radius_figures import (
    NUM_SECTORS,
    eq2_deviation_px,
    measure_ring_radii,
)
from catoptra_studies.paper_values import PAPER_SIZE_PX
from catoptra_studies.plot_style import Image
from catoptra_studies.study_subject import StudySubject


@pytest.fixture(scope="module")
def measured(inputs: FigureInputs) -> Floats:
    camera = inputs.rings.resize_camera(PAPER_SIZE_PX)
    image = inputs.rings.render_frame(PAPER_SIZE_PX, samples=6)
    return measure_ring_radii(image, rim_radius_px=camera.rim_radius_px)


def model_radii_px(subject: StudySubject, rings: int) -> tuple[Floats, Floats]:
    """Radii of the rings by the camera model, and by Eq. 2."""
    camera = subject.resize_camera(PAPER_SIZE_PX)
    t = np.tan(np.radians(0.5 * 5.0 * np.arange(1, rings + 1)))
    exact = camera.projection.radius_ratio_from_t(t)
    return camera.horizon_radius_px * exact, camera.horizon_radius_px * t


def test_every_ring_within_the_rim_is_found(measured: Floats) -> None:
    assert measured.shape == (NUM_SECTORS, 23)


def test_rings_follow_the_camera_model_in_every_sector(
    measured: Floats, subject: StudySubject
) -> None:
    exact, _ = model_radii_px(subject, 23)

    # The paper's claim made sharp: a tenth of a pixel.
    assert np.abs(measured - exact).max() < 0.1
    assert np.abs(measured.mean(axis=0) - exact).max() < 0.05


def test_eq2_deviates_measurably_beyond_the_horizon(
    measured: Floats, subject: StudySubject
) -> None:
    _, eq2 = model_radii_px(subject, 23)

    # 0.540 px at 115 degrees by Eq. 2 and the camera model; pixels are good to 0.02 px there.
    assert measured.mean(axis=0)[-1] - eq2[-1] == pytest.approx(0.540, abs=0.02)


def test_ring_when_synthetic_is_measured_without_a_camera_model() -> None:
    assert measure_ring_radii(make_ring(40.3), rim_radius_px=80.0) == pytest.approx(40.3, abs=0.1)


def test_image_without_rings_is_rejected_with_a_remedy() -> None:
    white = np.full((180, 180, 3), 255, dtype=np.uint8)

    with pytest.raises(CatoptraError, match="--rings-world must be"):
        measure_ring_radii(white, rim_radius_px=80.0)


def make_ring(radius_px: float) -> Image:
    """A dark ring two pixels wide, of 8 x 8 samples a pixel."""
    steps = (np.arange(180 * 8) + 0.5) / 8 - 90.0
    distance = np.hypot(*np.meshgrid(steps, steps))
    light = np.where(np.abs(distance - radius_px) < 1.0, 0.0, 255.0)
    mean = light.reshape(180, 8, 180, 8).mean(axis=(1, 3))
    return np.repeat(np.rint(mean).astype(np.uint8)[..., None], 3, axis=-1)


def test_synthetic_ring_has_its_area() -> None:
    area = (255.0 - make_ring(40.3)[..., 0].astype(float)).sum() / 255.0
    assert area == pytest.approx(4.0 * math.pi * 40.3, rel=0.01)


# degrees, px with the same h, px with the same rim
TABLE = [
    (0, 0.0, 0.0),
    (20, -0.0399, -0.1229),
    (60, -0.0900, -0.3616),
    (90, 0.0, -0.4704),
    (100, 0.1174, -0.4432),
    (110, 0.3484, -0.3233),
    (120, 0.8147, 0.0),
]


@pytest.mark.parametrize(("theta_deg", "same_h", "same_rim"), TABLE)
def test_eq2_deviates_as_derived(
    subject: StudySubject, theta_deg: float, same_h: float, same_rim: float
) -> None:
    camera = subject.resize_camera(PAPER_SIZE_PX)
    deviations = eq2_deviation_px(camera, np.radians(np.array(float(theta_deg))))

    assert deviations == pytest.approx((same_h, same_rim), abs=6e-5)  # half the last digit
