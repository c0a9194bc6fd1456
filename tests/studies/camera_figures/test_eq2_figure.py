"""Deviation of Eq. 2 from the camera model, against numbers derived independently."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_studies.camera_figures.radius_figures import eq2_deviation_px
from catoptra_studies.paper_values import PAPER_SIZE_PX
from catoptra_studies.study_subject import StudySubject

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
