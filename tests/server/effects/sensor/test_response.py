from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects import SceneSummary
from catoptra_server.effects.sensor.response import Response
from catoptra_server.world.world_description import srgb_from_linear
from helpers.effect_measurement import CAMERA, CAPTURE_CONTEXT, assert_criterion

SHOULDER = Response(0.4, 4.0)
CURVES = [SHOULDER, Response(0.0, 1000.0), Response(0.95, 1.05), Response(0.0, 1.05)]
LIGHT = np.append(np.linspace(0.0, 1.2, 20001), np.geomspace(1.21, 2000.0, 2000))


def bend(response: Response, light: object) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    image = np.broadcast_to(np.asarray(light, dtype=np.float64)[..., None], (1, np.size(light), 3))
    return response.apply(image, CAMERA, CAPTURE_CONTEXT)[0, :, 0]


def test_light_below_the_knee_is_left_and_the_white_point_is_white() -> None:
    np.testing.assert_array_equal(bend(SHOULDER, [-0.1, 0.0, 0.2, 0.4]), [-0.1, 0.0, 0.2, 0.4])
    np.testing.assert_allclose(bend(SHOULDER, [4.0, 50.0]), 1.0, rtol=1e-15)
    # By hand: x = 1, w = 6, so 0.4 + 0.6 (1 + 1 / 36) / 2.
    np.testing.assert_allclose(bend(SHOULDER, [1.0]), 0.4 + 0.6 * (37.0 / 72.0), rtol=1e-15)


@pytest.mark.parametrize("response", CURVES)
def test_curve_rises_and_is_nowhere_steeper_than_its_gains_say(response: Response) -> None:
    shown = bend(response, LIGHT)
    slope = np.diff(shown) / np.diff(LIGHT)
    assert slope.min() >= -1e-12
    assert slope.max() <= response.gains[1] + 1e-9
    # Concave: bounds of earlier effects take it for a gain between these.
    assert np.diff(slope).max() < 1e-9


@pytest.mark.parametrize("response", CURVES)
@pytest.mark.parametrize("brightest", [0.39, 0.41, 0.7, 1.0, 3.0, 1000.0])
def test_bound_holds_and_is_near(response: Response, brightest: float) -> None:
    light = np.linspace(0.0, brightest, 20001)
    change = 255.0 * np.abs(srgb_from_linear(light) - srgb_from_linear(bend(response, light)))
    bound = response.bound(SceneSummary(brightest), CAMERA).value
    assert change.max() <= bound <= change.max() + 0.5
    assert (
        bend(response, light).max() <= response.update_summary(SceneSummary(brightest)).max_radiance
    )


def test_criterion_enables_a_curve_that_light_reaches() -> None:
    assert_criterion(off=[(SHOULDER, 0.4), (Response(0.95, 1.05), 0.9)], on=[(SHOULDER, 1.0)])
