"""Angles between samples against the camera model's scale."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.image_scale import compute_image_scale
from catoptra_protocol.optics.mirrors import (
    PAPER_MIRROR,
    HyperbolicMirror,
    Mirror,
    ParabolicMirror,
)
from catoptra_server.render.raster.device import fit_spacing
from helpers.worlds import make_omni_camera

MIRRORS: list[tuple[Mirror, float]] = [
    (PAPER_MIRROR, 120.0),
    (PAPER_MIRROR, 40.0),
    (PAPER_MIRROR, 140.0),
    (HyperbolicMirror(3.0, 0.2), 105.0),
    (ParabolicMirror(0.03), 110.0),
]


@pytest.mark.parametrize(("mirror", "rim_deg"), MIRRORS)
@pytest.mark.parametrize("samples", [1, 4])
def test_spacing_is_the_reciprocal_of_the_scale(
    mirror: Mirror, rim_deg: float, samples: int
) -> None:
    camera = make_omni_camera(mirror=mirror, rim_deg=rim_deg)
    scale = compute_image_scale(camera)
    cosine = np.cos(2.0 * np.arctan(scale.t))
    expected = 1.0 / (samples * np.stack((scale.radial, scale.tangential), axis=-1))
    # A level changes by a 70th of the way to the next.
    np.testing.assert_allclose(fit_spacing(camera, samples).at(cosine), expected, rtol=0.01)


def test_spacing_outside_the_image_is_that_of_its_border() -> None:
    spacing = fit_spacing(make_omni_camera(rim_deg=60.0), 1)
    np.testing.assert_array_equal(spacing.at(np.array([-1.0])), spacing.at(np.array([0.5])))
