"""The camera as a part: it looks from its viewpoint and tells its law."""

from __future__ import annotations

import pytest

from catoptra_protocol.camera_conf import camera_from_pairs
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.wire.dialect import Dialect
from catoptra_server.imaging.multi_view import Tile
from catoptra_server.imaging.shot import OmniEye
from catoptra_server.sensors.omni_camera import OmniCameraSensor
from helpers.robots import CAMERA


def sensor_of() -> OmniCameraSensor:
    return OmniCameraSensor(CAMERA, viewpoint_height_m=0.6)


def test_take_when_the_robot_is_turned_is_at_the_viewpoint() -> None:
    take = sensor_of().take(Pose.from_rpy((1.0, 2.0, -0.1457), (0.0, 0.0, 0.5)), joints={})
    pose = take.exposure.world_from_mirror
    assert take.eye == OmniEye(CAMERA.camera, CAMERA.wish)
    assert pose.translation == pytest.approx((1.0, 2.0, -0.6))
    assert pose.rpy() == pytest.approx((0.0, 0.0, 0.5))


def test_take_when_fitted_to_a_tile_has_the_law_that_is_told() -> None:
    sensor, tile = sensor_of(), Tile(0, 0, 4, 3)
    take = sensor.take(Pose.identity(), joints={}, tile=tile)
    assert isinstance(take.eye, OmniEye)
    assert take.eye.camera.width_px == 4
    assert camera_from_pairs(sensor.law(tile))[0] == take.eye.camera


def test_configuration_when_read_back_is_the_same_law() -> None:
    (message,) = sensor_of().configuration().messages(Dialect.UT2004)
    camera, height_m = camera_from_pairs(message.pairs)
    assert (dict(message.pairs)["Name"], height_m) == ("OmniCam", 0.6)
    assert camera.horizon_radius_px == CAMERA.camera.horizon_radius_px


def test_configuration_when_it_has_a_tile_tells_both() -> None:
    sensor = sensor_of()
    sensor.tile = Tile(4, 0, 4, 3)
    (message,) = sensor.configuration().messages(Dialect.UDK)
    assert dict(message.pairs)["TextureOffsetX"] == "4"
    assert camera_from_pairs(message.pairs)[0].width_px == 4


def test_geometry_when_asked_is_the_effective_viewpoint() -> None:
    geometry = sensor_of().geometry()
    assert geometry.location_m == (0.0, 0.0, -0.4543)
