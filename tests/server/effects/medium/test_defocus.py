from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects import NUM_RINGS, SceneSummary
from catoptra_server.effects.kernels.lens_blur import (
    Aperture,
    circle_of_confusion_map,
    interior_mask,
)
from catoptra_server.effects.medium.defocus import Defocus
from helpers.blur_measurement import inner_pixels, make_point_source, measure_blur_diameters_px
from helpers.effect_measurement import CAPTURE_CONTEXT, make_test_pattern, max_grey_level_change
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=240)
TELECENTRIC = make_omni_camera(mirror=ParabolicMirror(0.03), width_px=240, rim_deg=110.0)
PITCH_M = 7.4e-6 * 360.0 / 240.0
DISTANT_SCENE = SceneSummary(1.0)


def make_defocus(f_number: float, focus_m: float = 0.0) -> Defocus:
    return Defocus(Aperture(f_number, PITCH_M, focus_m))


# Lenses on both sides of the criterion.
GRID = [
    (f_number, focus_m, rim_deg)
    for f_number in (1.4, 2.8, 5.6, 7.0, 11.0, 32.0)
    for focus_m in (0.0, 0.25, 0.6)
    for rim_deg in (60.0, 120.0)
]


@pytest.mark.parametrize(("f_number", "focus_m", "rim_deg"), GRID)
def test_bound_when_discs_are_measured_is_the_largest(
    f_number: float, focus_m: float, rim_deg: float
) -> None:
    camera = make_omni_camera(width_px=96, rim_deg=rim_deg)
    effect = Defocus(Aperture(f_number, 7.4e-6 * 360.0 / 96.0, focus_m))
    bound = effect.bound(DISTANT_SCENE, camera)
    measured = measure_blur_diameters_px(effect, camera, CAPTURE_CONTEXT)
    assert measured.max() <= bound.displacement_px * (1.0 + 1e-6)
    # The criterion's radii end at the rim; whole discs end a disc before.
    is_wide = bound.displacement_px > 0.5
    assert not is_wide or measured.max() > max(0.25, 0.8 * bound.displacement_px)


@pytest.mark.parametrize("camera", [CAMERA, TELECENTRIC])
def test_disc_when_measured_is_that_of_the_pixels_radius(camera: OmniCamera) -> None:
    effect = make_defocus(2.0)
    circle = circle_of_confusion_map(effect.aperture, camera)
    inner = inner_pixels(camera, 6.0)
    measured = measure_blur_diameters_px(effect, camera, CAPTURE_CONTEXT)
    np.testing.assert_allclose(
        measured[inner], np.abs(circle.infinity_diameter_px)[inner], atol=2e-5
    )


def test_disc_when_discs_are_many_pixels_wide_is_evenly_lit() -> None:
    effect = make_defocus(2.0, 1.0)
    row, column = 120, 170
    blurred = effect.apply(make_point_source(CAMERA, row, column), CAMERA, CAPTURE_CONTEXT)[..., 0]
    diameter = float(
        np.abs(circle_of_confusion_map(effect.aperture, CAMERA).infinity_diameter_px)[row, column]
    )
    assert diameter > 6.0
    v, u = np.mgrid[: CAMERA.height_px, : CAMERA.width_px]
    distance = np.hypot(u - column, v - row)
    fraction = blurred * 0.25 * math.pi * diameter**2
    np.testing.assert_allclose(fraction[distance < 0.5 * diameter - 1.0], 1.0, atol=0.1)
    assert not fraction[distance > 0.5 * diameter + 1.0].any()


def test_light_when_convolved_is_not_lost() -> None:
    # Neighbouring discs differ a little, so a single point's light is kept to first order only.
    for row, column in ((120, 125), (120, 190), (60, 60)):
        blurred = make_defocus(2.0).apply(
            make_point_source(CAMERA, row, column), CAMERA, CAPTURE_CONTEXT
        )
        assert blurred.sum() == pytest.approx(3.0, rel=0.02)
    image = make_test_pattern(1.0, CAMERA)
    assert make_defocus(2.0).apply(image, CAMERA, CAPTURE_CONTEXT).sum() == pytest.approx(
        image.sum(), rel=2e-3
    )


def test_even_light_when_convolved_stays_even_up_to_the_rim() -> None:
    image = np.where(interior_mask(CAMERA)[..., None], 0.4, np.zeros(3))
    np.testing.assert_allclose(
        make_defocus(2.0).apply(image, CAMERA, CAPTURE_CONTEXT), image, rtol=1e-13
    )


def test_bound_when_something_is_near_counts_its_disc() -> None:
    near = SceneSummary(1.0, min_distances_m=(0.15,) * NUM_RINGS)
    assert (
        make_defocus(4.0).bound(near, CAMERA).value
        > make_defocus(4.0).bound(DISTANT_SCENE, CAMERA).value
    )


def test_reason_names_lens_and_disc() -> None:
    reason = make_defocus(4.0).bound(DISTANT_SCENE, CAMERA).reason
    assert reason.startswith("F/4, focused at 268 mm: ")
    assert "0.8 px" in reason


def test_bound_in_grey_levels_holds_for_edges_and_is_tight() -> None:
    row, column = 120, 170
    for f_number in (2.0, 5.6, 16.0, 64.0):
        effect = make_defocus(f_number)
        point = make_point_source(CAMERA, row, column)
        bound = effect.bound(DISTANT_SCENE, CAMERA)
        changes = [
            max_grey_level_change(effect, image, CAMERA)
            for image in (point, point.max() - point, make_test_pattern(1.0, CAMERA))
        ]
        assert 0.2 * bound.value < max(changes) <= bound.value * (1.0 + 1e-9)
