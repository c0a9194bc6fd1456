from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.effects import CaptureContext, LightSource, SceneSummary
from catoptra_server.effects.kernels.grey_levels import measure_change
from catoptra_server.effects.kernels.light_sources import max_px2_per_steradian
from catoptra_server.effects.medium.veiling_glare import VeilingGlare
from helpers.effect_measurement import CAMERA, assert_criterion, make_test_pattern
from server.effects.kernels.test_light_sources import FLAT_CAMERA

GLARE = VeilingGlare(0.02, 0.5, 5e-5, 7.4e-6)
CONTEXT = CaptureContext()


def make_point(row: int, column: int) -> Floats:
    image = np.zeros((120, 160, 3))
    image[row, column] = 1.0
    return image


def spread_directly(effect: VeilingGlare, image: Floats) -> Floats:
    """S * L of the head of the module, pixel by pixel instead of cell by cell; of one channel."""
    height, width = image.shape
    v, u = np.arange(1 - height, height), np.arange(1 - width, width)
    shape = 1.0 / (1.0 + (v[:, None] ** 2 + u**2) / effect.shoulder_px**2)
    kernel = np.fft.rfft2(np.fft.ifftshift(shape / shape.sum()))
    size = shape.shape
    convolved = np.fft.irfft2(kernel * np.fft.rfft2(image, size), size)[:height, :width]
    return (1 - effect.veil_fraction) * convolved + effect.veil_fraction * image.mean()


def test_veil_alone_gives_each_pixel_the_same_part_of_a_point() -> None:
    veil = replace(GLARE, veil_fraction=1.0)
    changed = veil.apply(make_point(60, 80), FLAT_CAMERA, CONTEXT)
    expected = 0.02 / (120 * 160) + 0.98 * make_point(60, 80)
    np.testing.assert_allclose(changed, expected, rtol=1e-12)


@pytest.mark.parametrize("veil_fraction", [0.0, 0.5, 1.0])
def test_no_light_is_gained_and_only_what_leaves_the_picture_is_lost(veil_fraction: float) -> None:
    glare = replace(GLARE, veil_fraction=veil_fraction)
    for place in ((60, 80), (0, 0)):
        total = float(glare.apply(make_point(*place), FLAT_CAMERA, CONTEXT)[..., 0].sum())
        assert 1.0 - 0.02 * (1.0 - veil_fraction) < total <= 1.0 + 1e-12


def test_black_spot_in_a_wide_white_field_receives_the_index() -> None:
    # ISO 9358; the middle of the picture misses the light from beyond its edge.
    field = np.ones((120, 160, 3))
    field[57:63, 77:83] = 0.0
    spot = GLARE.apply(field, FLAT_CAMERA, CONTEXT)[60, 80]
    assert spot == pytest.approx(0.02, rel=0.3)
    veil = replace(GLARE, veil_fraction=1.0)
    assert veil.apply(field, FLAT_CAMERA, CONTEXT)[60, 80] == pytest.approx(0.02, rel=2e-3)


def test_two_places_give_each_other_the_same() -> None:
    # Centres of cells of 4 px: there nothing is interpolated but between four pixels.
    there = GLARE.apply(make_point(22, 31), FLAT_CAMERA, CONTEXT)[81, 102]
    back = GLARE.apply(make_point(81, 102), FLAT_CAMERA, CONTEXT)[22, 31]
    np.testing.assert_allclose(there, back, rtol=0.05)


def test_point_in_the_middle_spreads_alike_to_all_sides() -> None:
    camera = PerspectiveCamera(120, 120, 1.5)
    image = np.zeros((120, 120, 3))
    image[56:64, 56:64] = 1.0
    changed = GLARE.apply(image, camera, CONTEXT)
    for turned in (changed[::-1], changed[:, ::-1], changed.transpose(1, 0, 2)):
        np.testing.assert_allclose(changed, turned, rtol=1e-12)


def test_cells_differ_from_the_definition_by_what_the_module_states() -> None:
    camera = PerspectiveCamera(640, 480, 1.5)
    image = np.zeros((480, 640, 3))
    image[:, :320] = 1.0
    glare = GLARE.apply(image, camera, CONTEXT) - 0.98 * image
    expected = 0.02 * spread_directly(GLARE, image[..., 0])
    error = np.abs(glare[..., 0] - expected).max()
    assert 0.03 * 0.02 < error < 0.07 * 0.02


def test_source_spreads_around_its_place_by_the_scatter_function() -> None:
    # On the axis the image has f^2 pixels per steradian: 80 px at 90 degrees across 160 px.
    black = np.zeros((120, 160, 3))
    source = LightSource((80.0, 60.0), (2.0, 1.0, 0.0))
    glare = GLARE.apply(black, FLAT_CAMERA, CaptureContext(sources=(source,)))
    v, u = np.arange(-119, 120), np.arange(-159, 160)
    radius = 5e-5 / 7.4e-6
    total = (1.0 / (1.0 + (v[:, None] ** 2 + u**2) / radius**2)).sum()
    light = math.pi * 80.0**2
    for column in (80, 83, 110):
        square = (column + 0.5 - 80.0) ** 2 + 0.5**2
        expected = 0.01 * light * (1 / (1 + square / radius**2) / total + 1 / (120 * 160))
        # The sum ends with whole cells, a few pixels farther than the picture.
        assert glare[60, column] == pytest.approx([2 * expected, expected, 0.0], rel=0.02)


def test_bound_holds_with_sources_at_any_place() -> None:
    rng = np.random.default_rng(8)
    for brightest in (0.0, 1e-3, 0.5, 3.0):
        for _ in range(10):
            u, v = rng.uniform(10.0, 86.0, 2).tolist()
            irradiance = float(rng.uniform(0.0, 2.0)) * 10.0 ** float(rng.uniform(-4.0, 1.0))
            source = LightSource((u, v), (irradiance, 0.0, 0.5 * irradiance))
            summary = make_summary(brightest, irradiance)
            pattern = make_test_pattern(brightest)
            changed = GLARE.apply(pattern, CAMERA, CaptureContext(sources=(source,)))
            levels = measure_change(pattern, changed).largest
            assert levels <= GLARE.bound(summary, CAMERA).value + 1e-9
            assert changed.max() <= GLARE.update_summary(summary).max_radiance + 1e-12


def test_criterion_leaves_out_what_nobody_sees() -> None:
    assert_criterion(
        off=[(replace(GLARE, index=1e-5), 1.0), (GLARE, 1e-3)], on=[(GLARE, 1.0), (GLARE, 0.2)]
    )


def test_lights_of_a_world_enable_it_in_the_dark() -> None:
    assert GLARE.bound(make_summary(0.0, 1.0), CAMERA).value > 20.0
    assert GLARE.bound(make_summary(0.0, 0.0), CAMERA).value == 0.0


def make_summary(max_radiance: float, irradiance: float) -> SceneSummary:
    light_px = math.pi * irradiance * max_px2_per_steradian(CAMERA)
    return SceneSummary(max_radiance, source_light_px=light_px)
