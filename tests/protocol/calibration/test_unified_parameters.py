"""Cameras as unified spheres."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.calibration.model_fits import unified_parameters
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import (
    DoubleSphereLens,
    EnhancedUnifiedLens,
    EquidistantLens,
    StereographicLens,
    UnifiedLens,
)
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, ParabolicMirror
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import RadialProjection

ALL: list[RadialProjection] = [
    PAPER_MIRROR,
    ParabolicMirror(0.03),
    StereographicLens(),
    UnifiedLens(0.7, 0.1, 0.01),
    EnhancedUnifiedLens(0.4),
    DoubleSphereLens(0.0, 0.6),
    DoubleSphereLens(0.5, 0.0),
]


@pytest.mark.parametrize("projection", ALL)
def test_radius_is_mei_s(projection: RadialProjection) -> None:
    camera = camera_with_inscribed_rim(
        projection, width_px=360, height_px=360, rim_rad=math.radians(95.0)
    )
    unified = unified_parameters(camera)
    theta = np.radians(np.linspace(0.0, 95.0, 20))
    m = np.sin(theta) / (unified.xi + np.cos(theta))
    expected = unified.gamma_px * m * (1.0 + unified.k1 * m**2 + unified.k2 * m**4)
    assert camera.radius_px_from_t(np.tan(0.5 * theta)) == pytest.approx(expected, rel=1e-12)
    assert unified.focal_length_px * (1.0 + unified.xi) == pytest.approx(unified.gamma_px)


def test_numbers_of_the_paper_s_camera_are_those_of_the_reference() -> None:
    camera = camera_with_inscribed_rim(
        PAPER_MIRROR, width_px=360, height_px=360, rim_rad=math.radians(120.0)
    )
    unified = unified_parameters(camera)
    assert unified.xi == pytest.approx(0.9954941783, abs=1e-10)
    assert unified.gamma_px == pytest.approx(102.98653, abs=1e-5)
    assert unified.alpha == pytest.approx(0.498871001, abs=1e-9)
    assert unified.focal_length_px == pytest.approx(51.609537, abs=1e-6)


@pytest.mark.parametrize(
    "projection", [EquidistantLens(), EnhancedUnifiedLens(0.4, 1.1), DoubleSphereLens(0.3, 0.2)]
)
def test_projection_that_is_no_sphere_is_refused(projection: RadialProjection) -> None:
    camera = camera_with_inscribed_rim(projection, width_px=9, height_px=9, rim_rad=1.0)
    with pytest.raises(DomainError, match="no unified sphere"):
        unified_parameters(camera)
