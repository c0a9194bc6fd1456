from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_server.effects.defocus import Defocus
from catoptra_server.effects.scene_summary import RINGS, SceneSummary
from catoptra_server.effects.shared.lens_blur import Aperture, pixel_law, whole_pixels
from helpers.blur import inner_pixels, point, seen_diameters_px
from helpers.effects import CAPTURE, THRESHOLD, assert_summary_holds, card
from helpers.worlds import omni_camera

CAMERA = omni_camera(width_px=240)
TELECENTRIC = omni_camera(mirror=ParabolicMirror(0.03), width_px=240, rim_deg=110.0)
PITCH_M = 7.4e-6 * 360.0 / 240.0
FAR = SceneSummary(1.0)


def defocus(f_number: float, focus_m: float = 0.0) -> Defocus:
    return Defocus(Aperture(f_number, PITCH_M, focus_m))


# Lenses of which the criterion calls for some and not for others.
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
    camera = omni_camera(width_px=96, rim_deg=rim_deg)
    effect = Defocus(Aperture(f_number, 7.4e-6 * 360.0 / 96.0, focus_m))
    bound = effect.bound(FAR, camera)
    seen = seen_diameters_px(effect, camera, CAPTURE)
    assert seen.max() <= bound.value * (1.0 + 1e-6)
    # The criterion's radii end at the rim, what is gathered from within it a disc before.
    is_on = bound.value > THRESHOLD
    assert not is_on or seen.max() > max(0.5 * THRESHOLD, 0.8 * bound.value)


def test_grid_when_decided_has_both_sides() -> None:
    bounds = [defocus(f_number, focus_m).bound(FAR, CAMERA).value for f_number, focus_m, _ in GRID]
    assert min(bounds) < THRESHOLD < max(bounds)


@pytest.mark.parametrize("camera", [CAMERA, TELECENTRIC])
def test_disc_when_measured_is_that_of_the_pixels_radius(camera: OmniCamera) -> None:
    effect = defocus(2.0)
    law = pixel_law(effect.aperture, camera)
    inner = inner_pixels(camera, 6.0)
    seen = seen_diameters_px(effect, camera, CAPTURE)
    np.testing.assert_allclose(seen[inner], np.abs(law.fixed_px)[inner], atol=2e-5)


def test_disc_when_discs_are_many_pixels_wide_is_evenly_lit() -> None:
    effect = defocus(2.0, 1.0)
    row, column = 120, 170
    spread = effect.apply(point(CAMERA, row, column), CAMERA, CAPTURE)[..., 0]
    diameter = float(np.abs(pixel_law(effect.aperture, CAMERA).fixed_px)[row, column])
    assert diameter > 6.0
    v, u = np.mgrid[: CAMERA.height_px, : CAMERA.width_px]
    distance = np.hypot(u - column, v - row)
    share = spread * 0.25 * math.pi * diameter**2
    np.testing.assert_allclose(share[distance < 0.5 * diameter - 1.0], 1.0, atol=0.1)
    assert not share[distance > 0.5 * diameter + 1.0].any()


def test_light_when_it_is_gathered_is_not_lost() -> None:
    # Neighbours' discs differ a little, so a single point's light is kept to first order only.
    for row, column in ((120, 125), (120, 190), (60, 60)):
        spread = defocus(2.0).apply(point(CAMERA, row, column), CAMERA, CAPTURE)
        assert spread.sum() == pytest.approx(3.0, rel=0.02)
    light = card(1.0, CAMERA)
    assert defocus(2.0).apply(light, CAMERA, CAPTURE).sum() == pytest.approx(light.sum(), rel=2e-3)


def test_even_light_when_it_is_gathered_stays_even_up_to_the_rim() -> None:
    light = np.where(whole_pixels(CAMERA)[..., None], 0.4, np.zeros(3))
    np.testing.assert_allclose(defocus(2.0).apply(light, CAMERA, CAPTURE), light, rtol=1e-13)


def test_summary_behind_the_lens_holds() -> None:
    assert_summary_holds(Defocus(Aperture(1.0, 3e-5, 0.0)), 2.0)


def test_bound_when_something_is_near_counts_its_disc() -> None:
    near = SceneSummary(1.0, nearest_m=(0.15,) * RINGS)
    assert defocus(4.0).bound(near, CAMERA).value > defocus(4.0).bound(FAR, CAMERA).value


def test_reason_when_asked_tells_lens_and_disc() -> None:
    reason = defocus(4.0).bound(FAR, CAMERA).reason
    assert reason.startswith("F/4, focused at 268 mm: ")
    assert "0.8 px" in reason


def test_maps_when_asked_twice_are_the_same_arrays() -> None:
    one, other = (defocus(4.0).uniforms(CAMERA, CAPTURE, lambda: 0.0) for _ in range(2))
    assert one["row"] is other["row"]
    assert one["weights"] is other["weights"]
