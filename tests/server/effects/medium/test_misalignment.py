from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects import SceneSummary
from catoptra_server.effects.medium.misalignment import Misalignment, lookup_maps
from catoptra_server.world.world_description import srgb_from_linear
from helpers.displacement_measurement import (
    add_margin,
    assert_displacement_negligible,
    assert_displacement_not_negligible,
)
from helpers.effect_measurement import (
    CAMERA,
    CAPTURE_CONTEXT,
    make_test_pattern,
    max_grey_level_change,
)
from helpers.worlds import make_omni_camera

FRAMED_CAMERA = add_margin()
ORTHOGRAPHIC = make_omni_camera(mirror=ParabolicMirror(0.03), rim_deg=110.0, width_px=96)
MISALIGNMENT = Misalignment(6e-4, -4e-4, 1e-3, 2e-3, 0.0)


def test_image_when_the_camera_stands_where_it_belongs_keeps_every_bit() -> None:
    image = make_test_pattern(2.0)
    np.testing.assert_array_equal(Misalignment().apply(image, CAMERA, CAPTURE_CONTEXT), image)
    assert Misalignment().bound(SceneSummary(1.0), CAMERA).value == 0.0


def test_image_when_an_orthographic_camera_is_a_pixel_aside_moves_whole() -> None:
    pixel_m = 0.03 / ORTHOGRAPHIC.horizon_radius_px
    image = make_test_pattern(2.0, ORTHOGRAPHIC)
    moved = Misalignment(y_m=-2.0 * pixel_m).apply(image, ORTHOGRAPHIC, CAPTURE_CONTEXT)
    kept = lookup_maps(Misalignment(y_m=-2.0 * pixel_m), ORTHOGRAPHIC)[1]
    expected = kept[:, :-2, None] * image[:, 2:]
    assert (kept == 1.0).sum() > 0.6 * kept.size
    # Offsets are rounded to float32, by at most 1e-7 px, of radiance up to 2.
    np.testing.assert_allclose(moved[:, :-2], expected, atol=1e-6)


def test_light_when_the_image_is_even_stays_or_is_lost_at_the_rim() -> None:
    even = np.ones((96, 96, 3))
    warped = MISALIGNMENT.apply(even, CAMERA, CAPTURE_CONTEXT)
    lookup, kept = lookup_maps(MISALIGNMENT, CAMERA)
    np.testing.assert_allclose(warped, np.broadcast_to(kept[..., None], warped.shape))
    # Half of a pixel at the edge of the mirror.
    assert (kept[lookup[..., 2] == 1.0] >= 0.5).all()
    assert (0.0 < kept).sum() > lookup[..., 2].sum()


@pytest.mark.parametrize(
    "effect",
    [
        Misalignment(1e-7, 0.0, 0.0),
        Misalignment(0.0, 3e-4, 0.0),
        Misalignment(0.0, 0.0, 2.5e-3),
        Misalignment(0.0, 0.0, -2.5e-3),
        Misalignment(pitch_rad=1e-3),
    ],
)
def test_camera_when_hardly_off_is_disabled(effect: Misalignment) -> None:
    assert_displacement_negligible(effect, FRAMED_CAMERA)


@pytest.mark.parametrize(
    "effect",
    [
        Misalignment(4.5e-4, 0.0, 0.0),
        Misalignment(0.0, -1e-3, 0.0),
        Misalignment(0.0, 0.0, 3.5e-3),
        Misalignment(0.0, 0.0, -4e-3),
        Misalignment(roll_rad=2e-3),
        MISALIGNMENT,
    ],
)
def test_camera_when_off_is_enabled(effect: Misalignment) -> None:
    assert_displacement_not_negligible(effect, FRAMED_CAMERA)


def test_orthographic_camera_when_farther_away_is_disabled() -> None:
    assert_displacement_negligible(Misalignment(axial_m=0.05), ORTHOGRAPHIC)


def test_camera_when_it_no_longer_sees_the_mirror_is_enabled_by_the_whole_image() -> None:
    camera = make_omni_camera(mirror=HyperbolicMirror(11.546, 0.01), width_px=48)
    far_off = Misalignment(0.02, 0.02, -0.05)
    assert not lookup_maps(far_off, camera)[0][..., 2].any()
    assert far_off.bound(SceneSummary(1.0), camera).displacement_px == pytest.approx(
        48.0 * 2.0**0.5
    )
    assert not far_off.apply(np.ones((48, 48, 3)), camera, CAPTURE_CONTEXT).any()


@pytest.mark.parametrize("offset_m", [1e-9, 1e-6, 1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("samples", [1, 3])
def test_bound_in_grey_levels_holds_for_edges_and_the_rim(offset_m: float, samples: int) -> None:
    effect = Misalignment(x_m=offset_m)
    bound = effect.bound(SceneSummary(1.0), CAMERA).value
    covered = camera_coverage(CAMERA, samples)
    for image in (make_test_pattern(), np.ones((96, 96, 3))):
        change = max_grey_level_change(effect, image * covered[..., None])
        assert change <= bound * (1.0 + 1e-6) + 1e-4
    assert (bound < 2.0) == (offset_m == 1e-9)


@pytest.mark.parametrize(
    ("width_px", "offset_m"), [(241, 1e-9), (241, 1e-6), (241, 1e-3), (640, 1e-9), (640, 1e-4)]
)
def test_rim_of_a_camera_that_is_off_is_as_smooth_as_without(
    width_px: int, offset_m: float
) -> None:
    camera = make_omni_camera(width_px=width_px)
    effect = Misalignment(x_m=offset_m)
    white = np.repeat(camera_coverage(camera, 3)[..., None], 3, axis=-1)
    moved = effect.apply(white, camera, CAPTURE_CONTEXT)
    levels = 255.0 * np.abs(srgb_from_linear(moved) - srgb_from_linear(white)).max()
    assert levels <= effect.bound(SceneSummary(1.0), camera).value * (1.0 + 1e-6) + 1e-4
    # Steps from pixel to pixel: those of a jagged rim are larger.
    steps, calm = (
        sum(np.square(np.diff(one[..., 1], axis=axis)).sum() for axis in (0, 1))
        for one in (moved, white)
    )
    assert steps <= 1.01 * calm


@cache
def camera_coverage(camera: OmniCamera, samples: int) -> Floats:
    """Fraction of the samples of each pixel that see the mirror, (h, w), as renderers have it."""
    return camera.direction_from_pixel(pixel_sample_positions(camera, samples))[1].mean(axis=2)
