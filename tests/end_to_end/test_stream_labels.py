"""Labels of a running server's cameras: exact, in both encodings, whichever renderer draws."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.labels import LABEL_CHANNELS
from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.stream.requests import FrameVariant, ImageEncoding
from helpers.configs import FIELD, OMNI_ROBOT, Edit, write_edited_copy
from helpers.opengl import device_or_skip
from helpers.server_process import start_server, write_small_robot

ALL = tuple(LABEL_CHANNELS)


@pytest.fixture(scope="module", params=["trace", "raster"])
def client(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory):
    if request.param == "raster":
        device_or_skip().close()
    folder = tmp_path_factory.mktemp(request.param)
    robot = write_small_robot(folder)
    arguments = ("--clock", "lockstep", "--renderer", request.param)
    with (
        start_server(folder, *arguments, robot=robot, world=FIELD) as server,
        server.connect_stream() as stream,
    ):
        stream.spawn("USARBot.OmniP2AT", name="Mine", location_m=(0.5, 0.3, 0.0))
        stream.step(0.2)
        yield stream


def test_channels_follow_the_picture(client: StreamClient) -> None:
    frame = client.get_frame(robot="Mine", encoding=ImageEncoding.RAW, channels=ALL)
    assert frame.labels is not None
    channels = frame.labels.truth.channels
    assert tuple(channels) == ALL
    assert all(values.shape[:2] == frame.rgb.shape[:2] for values in channels.values())
    names = {one.number: one.name for one in frame.labels.truth.objects}
    assert set(np.unique(channels["ids"])) - {0} == set(names)
    # The robot is in its own mirror, below it.
    assert "Mine" in names.values()
    assert {one.class_name for one in frame.labels.truth.objects} >= {"beacon", "wall", "robot"}


def test_points_lie_on_the_rays_of_the_header_s_camera(client: StreamClient) -> None:
    frame = client.get_frame(robot="Mine", channels=("range", "point", "valid"))
    assert frame.labels is not None
    assert isinstance(frame.camera, OmniCamera)
    assert frame.world_from_robot is not None
    assert frame.robot_from_mirror is not None
    channels = frame.labels.truth.channels
    rows, columns = np.nonzero(np.isfinite(channels["range"]))
    origins, directions, valid = ray_from_pixel(
        frame.camera, np.column_stack((columns, rows)) + 0.5
    )
    assert valid.all()
    pose = frame.world_from_robot @ frame.robot_from_mirror
    ends = pose.transform_points(origins + channels["range"][rows, columns, None] * directions)
    np.testing.assert_allclose(channels["point"][rows, columns], ends, atol=2e-3)
    assert channels["valid"][rows, columns].all()


def test_labels_of_the_other_hand_are_turned(client: StreamClient) -> None:
    own = client.get_frame(robot="Mine", channels=("ids",))
    turned = client.get_frame(
        robot="Mine", channels=("ids",), variant=FrameVariant(picture="flipped")
    )
    assert own.labels is not None
    assert turned.labels is not None
    np.testing.assert_array_equal(
        turned.labels.truth.channels["ids"], own.labels.truth.channels["ids"][:, ::-1]
    )


def test_picture_beside_labels_is_the_same(client: StreamClient) -> None:
    plain = client.get_frame(robot="Mine", encoding=ImageEncoding.RAW)
    labelled = client.get_frame(robot="Mine", encoding=ImageEncoding.RAW, channels=("ids",))
    np.testing.assert_array_equal(plain.rgb, labelled.rgb)
    assert plain.labels is None


def test_unknown_channels_are_rejected(client: StreamClient) -> None:
    with pytest.raises(CatoptraError, match="there is no channel 'depth'"):
        client.get_frame(robot="Mine", channels=("depth",))


def test_labels_of_an_ordinary_camera(tmp_path: Path) -> None:
    camera = (
        "Cameras=(ItemClass=class'USARBot.RobotCamera',ItemName=\"Ahead\","
        "Position=(X=0.1,Y=0.05,Z=-0.3),Direction=(X=0.0,Y=-0.1,Z=0.4))\nCameras="
    )
    robot = write_edited_copy(OMNI_ROBOT, tmp_path, Edit("Cameras=", camera))
    arguments = ("--clock", "lockstep")
    with (
        start_server(tmp_path, *arguments, robot=robot) as server,
        server.connect_stream() as stream,
    ):
        stream.spawn("USARBot.OmniP2AT", name="Mine", location_m=(0.0, 0.0, 0.0))
        frame = stream.get_frame(robot="Mine", camera="Ahead", channels=ALL)
    assert frame.labels is not None
    assert isinstance(frame.camera, PerspectiveCamera)
    assert frame.labels.truth.channels["valid"].all()
    assert len(frame.labels.truth.objects) > 1
