"""The omnidirectional camera of a robot: pose, camera model and replies."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_protocol.usarsim.grammar import Dialect
from catoptra_server.frames.multi_view import Tile
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.simulation.sensors.omni_camera import OmniCameraSensor
from helpers.robots import CAMERA, make_p2at


def make_sensor() -> OmniCameraSensor:
    return OmniCameraSensor(CAMERA, make_p2at())


def test_spec_when_without_a_tile_is_of_the_description() -> None:
    sensor = make_sensor()
    assert sensor.camera_spec() == OmniCameraSpec(CAMERA.camera, CAMERA.render_settings)
    pose = sensor.robot_from_camera({})
    assert np.array_equal(pose.translation, CAMERA.robot_from_mirror.translation)


def test_spec_when_fitted_to_a_tile_has_the_published_camera_model() -> None:
    sensor, tile = make_sensor(), Tile(0, 0, 4, 3)
    spec = sensor.camera_spec(tile)
    assert spec.camera.width_px == 4
    assert omni_camera_from_pairs(sensor.camera_model(tile))[0] == spec.camera


def test_camera_model_when_published_with_each_frame_is_formatted_once() -> None:
    sensor = make_sensor()
    assert sensor.camera_model() is sensor.camera_model()


def test_configuration_when_read_back_is_the_same_camera_model() -> None:
    (message,) = make_sensor().configuration().to_messages(Dialect.UT2004)
    camera, height_m = omni_camera_from_pairs(message.pairs)
    assert (dict(message.pairs)["Name"], height_m) == ("OmniCam", 0.6)
    assert camera.horizon_radius_px == CAMERA.camera.horizon_radius_px


def test_configuration_when_tiled_has_the_tile_and_its_camera_model() -> None:
    sensor = make_sensor()
    sensor.tile = Tile(4, 0, 4, 3)
    (message,) = sensor.configuration().to_messages(Dialect.UDK)
    assert dict(message.pairs)["TextureOffsetX"] == "4"
    assert omni_camera_from_pairs(message.pairs)[0].width_px == 4


def test_geometry_when_requested_is_the_effective_viewpoint() -> None:
    geometry = make_sensor().geometry()
    assert geometry.location_m == (0.0, 0.0, -0.4543)
