"""The camera as a part: it looks from its viewpoint and tells its law."""

from __future__ import annotations

import pytest

from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.dialect import Dialect
from catoptra_server.frames.multi_view import Tile
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.sensors.omni_camera import OmniCameraSensor
from helpers.robots import CAMERA


def make_sensor() -> OmniCameraSensor:
    return OmniCameraSensor(CAMERA, viewpoint_height_m=0.6)


def test_take_when_the_robot_is_turned_is_at_the_viewpoint() -> None:
    take = make_sensor().view_request(
        Pose.from_rpy((1.0, 2.0, -0.1457), (0.0, 0.0, 0.5)), joint_angles_rad={}
    )
    pose = take.camera_state.world_from_mirror
    assert take.camera == OmniCameraSpec(CAMERA.camera, CAMERA.render_settings)
    assert pose.translation == pytest.approx((1.0, 2.0, -0.6))
    assert pose.to_rpy() == pytest.approx((0.0, 0.0, 0.5))


def test_take_when_fitted_to_a_tile_has_the_law_that_is_told() -> None:
    sensor, tile = make_sensor(), Tile(0, 0, 4, 3)
    take = sensor.view_request(Pose.identity(), joint_angles_rad={}, tile=tile)
    assert isinstance(take.camera, OmniCameraSpec)
    assert take.camera.camera.width_px == 4
    assert omni_camera_from_pairs(sensor.camera_model(tile))[0] == take.camera.camera


def test_configuration_when_read_back_is_the_same_law() -> None:
    (message,) = make_sensor().configuration().to_messages(Dialect.UT2004)
    camera, height_m = omni_camera_from_pairs(message.pairs)
    assert (dict(message.pairs)["Name"], height_m) == ("OmniCam", 0.6)
    assert camera.horizon_radius_px == CAMERA.camera.horizon_radius_px


def test_configuration_when_it_has_a_tile_tells_both() -> None:
    sensor = make_sensor()
    sensor.tile = Tile(4, 0, 4, 3)
    (message,) = sensor.configuration().to_messages(Dialect.UDK)
    assert dict(message.pairs)["TextureOffsetX"] == "4"
    assert omni_camera_from_pairs(message.pairs)[0].width_px == 4


def test_geometry_when_asked_is_the_effective_viewpoint() -> None:
    geometry = make_sensor().geometry()
    assert geometry.location_m == (0.0, 0.0, -0.4543)
