"""The camera as a part: it draws from its viewpoint and tells its law."""

from __future__ import annotations

import pytest

from catoptra_protocol.camera_conf import camera_from_pairs
from catoptra_protocol.optics.frames import Pose
from catoptra_server.sensors.omni_camera import OmniCameraSensor
from helpers.robots import CAMERA, FakeView


def test_exposure_when_the_robot_is_turned_is_at_the_viewpoint() -> None:
    view = FakeView()
    sensor = OmniCameraSensor(CAMERA, view, viewpoint_height_m=0.6)
    image = sensor.expose(Pose.from_rpy((1.0, 2.0, -0.1457), (0.0, 0.0, 0.5)))
    pose = view.exposures[0].world_from_mirror
    assert image.rgb.shape == (6, 8, 3)
    assert pose.translation == pytest.approx((1.0, 2.0, -0.6))
    assert pose.rpy() == pytest.approx((0.0, 0.0, 0.5))


def test_configuration_when_read_back_is_the_same_law() -> None:
    sensor = OmniCameraSensor(CAMERA, FakeView(), viewpoint_height_m=0.6)
    configuration = sensor.configuration()
    camera, height_m = camera_from_pairs(configuration.pairs)
    assert (configuration.get("Name"), height_m) == ("OmniCam", 0.6)
    assert camera.horizon_radius_px == CAMERA.camera.horizon_radius_px


def test_geometry_when_asked_is_the_effective_viewpoint() -> None:
    geometry = OmniCameraSensor(CAMERA, FakeView(), viewpoint_height_m=0.6).geometry()
    assert geometry.location_m == (0.0, 0.0, -0.4543)
