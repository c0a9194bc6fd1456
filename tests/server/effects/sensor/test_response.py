from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects import EffectMode, EffectSetting, EffectSettings, SceneSummary
from catoptra_server.effects.sensor.response import EFFECT_TYPE, Response
from catoptra_server.world.world_description import srgb_from_linear
from helpers.effect_measurement import CAMERA, CAPTURE_CONTEXT, assert_criterion

SHOULDER = Response(0.4, 4.0)
CURVES = [SHOULDER, Response(0.0, 1000.0), Response(0.95, 1.05), Response(0.0, 1.05)]
MEASURED = [
    Response(0.4, 4.0, EFFECT_TYPE.curves["bt709"]),
    Response(0.4, 4.0, ((0.0, 0.0), (0.02, 10.0), (0.3, 150.0), (1.0, 225.0), (3.0, 250.0))),
]
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


@pytest.mark.parametrize("response", CURVES + MEASURED)
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


@pytest.mark.parametrize("response", MEASURED)
def test_measured_curve_shows_its_rows_and_the_last_beyond(response: Response) -> None:
    light, grey = np.array(response.curve).T
    # A bend in the dark is between two entries of the table.
    shown = 255.0 * srgb_from_linear(bend(response, light))
    np.testing.assert_allclose(shown, grey, atol=0.2, rtol=0.0)
    assert bend(response, [1e5])[0] == pytest.approx(bend(response, light[-1:])[0])
    np.testing.assert_array_equal(bend(response, [-0.1, 0.0]), [-0.1, 0.0])


@pytest.mark.parametrize("response", MEASURED)
def test_no_change_behind_a_curve_is_larger_than_its_gains_and_contrast_say(
    response: Response,
) -> None:
    lights = 10.0 ** np.random.default_rng(3).uniform(-5.0, 1.0, (2, 100_000))
    lights[1, ::2] = lights[0, ::2] * 1.01
    low, high = np.sort(lights, axis=0)
    truth = srgb_from_linear(bend(response, high)) - srgb_from_linear(bend(response, low))
    gain = np.minimum(response.gains[1], 1.0 / high)
    stated = srgb_from_linear(gain * high) - srgb_from_linear(gain * low)
    assert (truth <= response.contrast * stated + 1e-9).all()
    assert response.contrast < 1.3
    settings = EffectSettings((EffectSetting(response, EffectMode.AUTO),), max_change=2.0)
    assert settings.threshold.max_change == 2.0 / response.contrast
