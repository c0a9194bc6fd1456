from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import LightSource
from catoptra_server.effects.kernels.light_sources import (
    find_light_sources,
    max_px2_per_steradian,
    max_source_light_px,
    source_light_px,
)
from catoptra_server.world.objects import CameraState, FogMedium
from catoptra_server.world.world_description import DirectionalLight, HemisphereLight, PointLight
from helpers.effect_measurement import CAMERA

FLAT_CAMERA = PerspectiveCamera(160, 120, math.radians(90.0))
# A camera that looks along the world's y.
STATE = CameraState(Pose.from_rpy((1.0, 2.0, 0.0), (0.0, 0.0, 0.5 * math.pi)))
NOTHING = np.full((120, 160), np.inf, dtype=np.float32)
SUN = DirectionalLight((0.0, -1.0, 0.0), (0.9, 0.8, 0.7))
LAMP = PointLight((1.0, 6.0, 0.0), (8.0, 4.0, 2.0))


def test_sun_straight_ahead_is_in_the_middle_with_its_irradiance() -> None:
    (source,) = find_light_sources((SUN,), FLAT_CAMERA, STATE, NOTHING)
    assert source.pixel == pytest.approx((80.0, 60.0))
    assert source.irradiance == pytest.approx((0.9, 0.8, 0.7))


def test_lamp_loses_by_the_square_of_its_distance() -> None:
    (source,) = find_light_sources((LAMP,), FLAT_CAMERA, STATE, NOTHING)
    assert source.irradiance == pytest.approx((0.5, 0.25, 0.125))


def test_lights_from_behind_and_of_the_sky_are_no_sources() -> None:
    behind = DirectionalLight((0.0, 1.0, 0.0), (1.0, 1.0, 1.0))
    sky = HemisphereLight((1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    assert find_light_sources((behind, sky), FLAT_CAMERA, STATE, NOTHING) == ()


@pytest.mark.parametrize(("range_m", "num_seen"), [(3.8, 0), (3.99, 1), (4.5, 1)])
def test_surface_hides_what_is_behind_it(range_m: float, num_seen: int) -> None:
    ranges = np.full_like(NOTHING, range_m)
    assert len(find_light_sources((LAMP,), FLAT_CAMERA, STATE, ranges)) == num_seen
    assert find_light_sources((SUN,), FLAT_CAMERA, STATE, ranges) == ()


def test_fog_takes_from_a_lamp_as_from_a_surface() -> None:
    foggy = CameraState(STATE.world_from_mirror, fog=FogMedium(0.25, (0.5, 0.5, 0.5)))
    (source,) = find_light_sources((LAMP,), FLAT_CAMERA, foggy, NOTHING)
    assert source.irradiance == pytest.approx(np.array((0.5, 0.25, 0.125)) / math.e)
    (sun,) = find_light_sources((SUN,), FLAT_CAMERA, foggy, NOTHING)
    assert sun.irradiance == (0.0, 0.0, 0.0)


def test_light_of_a_source_is_that_of_a_small_bright_disc() -> None:
    # Pixels of radiance L over a solid angle A have as much light as a source of pi E = L A.
    direction = CAMERA.direction_from_pixel(pixel_sample_positions(CAMERA)[:, :, 0])[0]
    pixel = (60.5, 70.5)
    towards = CAMERA.direction_from_pixel(np.array(pixel))[0]
    half_rad = 0.15
    inside = direction @ towards > math.cos(half_rad)
    solid_angle = 2.0 * math.pi * (1.0 - math.cos(half_rad))
    light = float(source_light_px(LightSource(pixel, (1.0, 1.0, 1.0)), CAMERA)[0])
    offset = np.hypot(*np.subtract(pixel, CAMERA.centre_px))
    shade = float(CAMERA.relative_illumination(np.array(offset)))
    assert light == pytest.approx(math.pi * shade * inside.sum() / solid_angle, rel=0.06)


def test_bound_of_all_sources_is_never_below_one_of_them() -> None:
    viewpoint = STATE.world_from_mirror.translation
    bound = max_source_light_px((SUN, LAMP), CAMERA, viewpoint)
    assert bound == pytest.approx(math.pi * 1.4 * max_px2_per_steradian(CAMERA))
    for u in np.linspace(2.0, 94.0, 93).tolist():
        light = source_light_px(LightSource((u, 48.0), (1.4, 1.0, 1.0)), CAMERA)
        assert light.max() <= bound
    assert max_source_light_px((), CAMERA, viewpoint) == 0.0
