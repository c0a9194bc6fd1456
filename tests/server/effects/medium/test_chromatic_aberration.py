from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions, visible_radii_px
from catoptra_server.effects import SceneSummary
from catoptra_server.effects.medium.chromatic_aberration import ChromaticAberration
from helpers.bilinear import sample_bilinear
from helpers.displacement_measurement import (
    add_margin,
    assert_displacement_negligible,
    assert_displacement_not_negligible,
    measure_displacement_px,
)
from helpers.effect_measurement import (
    CAMERA,
    CAPTURE_CONTEXT,
    make_test_pattern,
    max_grey_level_change,
)

FRAMED_CAMERA = add_margin()
RIM_PX = FRAMED_CAMERA.rim_radius_px
ABERRATION = ChromaticAberration(1.02, 0.985)


def test_image_when_no_colour_is_larger_keeps_every_bit() -> None:
    image = make_test_pattern(2.0)
    np.testing.assert_array_equal(
        ChromaticAberration().apply(image, CAMERA, CAPTURE_CONTEXT), image
    )


def test_green_keeps_every_bit() -> None:
    image = make_test_pattern(2.0)
    np.testing.assert_array_equal(
        ABERRATION.apply(image, CAMERA, CAPTURE_CONTEXT)[..., 1], image[..., 1]
    )


@pytest.mark.parametrize(("colour", "magnification"), [(0, 1.02), (2, 0.985)])
def test_colour_when_magnified_is_read_that_much_nearer_the_axis(
    colour: int, magnification: float
) -> None:
    image = make_test_pattern(1.0)
    pixels = pixel_sample_positions(CAMERA)[:, :, 0]
    centre = np.asarray(CAMERA.centre_px)
    u, v = np.moveaxis(centre + (pixels - centre) / magnification, -1, 0)
    expected = sample_bilinear(image, u, v)[..., colour]
    # Offsets are float32: 1e-7 px of radiance up to 1.
    measured = ABERRATION.apply(image, CAMERA, CAPTURE_CONTEXT)[..., colour]
    np.testing.assert_allclose(measured, expected, atol=2e-6)


def test_bright_disc_when_magnified_has_more_light_by_the_square() -> None:
    radius = np.hypot(
        *np.moveaxis(
            pixel_sample_positions(FRAMED_CAMERA)[:, :, 0] - FRAMED_CAMERA.centre_px, -1, 0
        )
    )
    disc = np.repeat(np.clip(30.5 - radius, 0.0, 1.0)[..., None], 3, axis=-1)
    shares = ABERRATION.apply(disc, FRAMED_CAMERA, CAPTURE_CONTEXT).sum(axis=(0, 1)) / disc.sum(
        axis=(0, 1)
    )
    np.testing.assert_allclose(shares, (1.02**2, 1.0, 0.985**2), rtol=1e-3)


@pytest.mark.parametrize("over", [0.0, 0.05, 0.3, 0.49])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_colours_when_hardly_apart_are_disabled(over: float, sign: float) -> None:
    # A twentieth less than `over` px, since 1 / m exceeds 1 - m.
    assert_displacement_negligible(
        ChromaticAberration(1.0 + 0.95 * sign * over / RIM_PX), FRAMED_CAMERA
    )
    assert_displacement_negligible(
        ChromaticAberration(1.0, 1.0 - sign * 0.95 * over / RIM_PX), FRAMED_CAMERA
    )


@pytest.mark.parametrize("over", [0.52, 0.6, 2.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_colours_when_apart_are_enabled(over: float, sign: float) -> None:
    effect = ChromaticAberration(1.0 + 0.5 * over / RIM_PX, 1.0 + sign * over / RIM_PX)
    assert_displacement_not_negligible(effect, FRAMED_CAMERA)


def test_bound_when_colours_are_apart_is_what_the_rim_is_moved_by() -> None:
    moved = measure_displacement_px(ABERRATION, FRAMED_CAMERA).max(axis=(0, 1))
    bound = ABERRATION.bound(SceneSummary(1.0), FRAMED_CAMERA).displacement_px
    assert moved[0] == pytest.approx(bound, rel=0.05)
    assert moved[1] == 0.0
    assert bound == pytest.approx(0.02 * visible_radii_px(FRAMED_CAMERA)[1])


@pytest.mark.parametrize("magnification", [1.0002, 1.001, 1.02])
def test_bound_in_grey_levels_holds_for_edges(magnification: float) -> None:
    effect = ChromaticAberration(magnification, 1.0 / magnification)
    bound = effect.bound(SceneSummary(1.0), CAMERA).value
    stripes = make_test_pattern() > 0.0
    stripes[:, ::2] = False
    assert 0.3 * bound < max_grey_level_change(effect, stripes.astype(np.float64)) <= bound
