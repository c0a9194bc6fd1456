"""Several robots and cameras over the stream: origin of each frame, and directions of its pixels.

A room with one luminous red box. The camera model and the poses of a frame are compared with the
image: red exactly where the ray of a pixel intersects the box.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from catoptra_client.frame import Frame, FrameSource
from catoptra_client.frame_sources.frame_source import open_frame_source
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Bools
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world.objects import OrientedBox, box_distances
from helpers.deadline import Deadline
from helpers.server_process import DEADLINE_S, RunningServer, start_server, write_small_robot

BOX = OrientedBox(Pose.from_rpy((2.0, 0.4, -0.5)), (0.5, 0.6, 0.7))
WORLD = """[Catoptra.World]
Boxes=(Size=(X=0.5,Y=0.6,Z=0.7),Position=(X=2.0,Y=0.4,Z=-0.5),Colour=(R=255),Unlit=true)
Rectangles=(Size=(X=20,Y=20),Position=(X=0,Y=0,Z=0))
"""
# A camera that is pitched down a little, at any yaw.
REAR = (
    "Cameras=(ItemClass=class'USARBot.RobotCamera',ItemName=\"{}\","
    "Position=(X=0.1,Y=0.05,Z=-0.3),Direction=(X=0.0,Y=-0.1,Z={}))\n"
)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    """Server under lockstep, for robots with an omnidirectional and two perspective cameras."""
    folder = tmp_path_factory.mktemp("cameras")
    world = folder / "world.ini"
    world.write_text(WORLD, encoding="utf-8")
    robot = write_small_robot(folder)
    cameras = REAR.format("Ahead", 0.2) + REAR.format("Rear", 3.0)
    text = robot.read_text(encoding="utf-8")
    mark = "Cameras=("
    assert mark in text
    robot.write_text(text.replace(mark, cameras + mark, 1), encoding="utf-8")
    with start_server(folder, "--clock", "lockstep", robot=robot, world=world) as running:
        yield running
        assert running.terminate() == 0
        assert "Traceback" not in running.log.read_text()


@contextmanager
def spawn_beside_box(
    server: RunningServer, name: str, position_m: tuple[float, float], yaw_rad: float
) -> Iterator[StreamClient]:
    """A client with a robot that has the box in view; the robot is removed at the end."""
    with server.connect_stream() as client:
        client.spawn(
            "USARBot.OmniP2AT",
            name=name,
            location_m=(*position_m, 0.0),
            rotation_rad=(0.0, 0.0, yaw_rad),
        )
        yield client
        client.reset()


def stream_address(server: RunningServer, query: str = "") -> str:
    """URL of a camera's frames without loss."""
    return f"zmq://127.0.0.1:{server.stream_port}?encoding=png{query}"


def box_mask(frame: Frame) -> tuple[Bools, Bools]:
    """(h, w) True where the ray of a pixel hits the box, and (h, w) True where that is certain.

    Uncertain are pixels that the box covers in part, or that lie beside the mirror.
    """
    assert frame.camera is not None
    centres = pixel_sample_positions(frame.camera)[:, :, 0]
    corners = [centres + np.array((u, v)) for u in (-0.7, 0.0, 0.7) for v in (-0.7, 0.0, 0.7)]
    rays = [rays_hit_box(frame, pixels) for pixels in corners]
    every, some = np.all([hit for hit, _ in rays], axis=0), np.any([hit for hit, _ in rays], axis=0)
    inside = np.all([valid for _, valid in rays], axis=0)
    return every, inside & (every == some)


def rays_hit_box(frame: Frame, pixels: np.ndarray) -> tuple[Bools, Bools]:
    """Whether the ray of each pixel hits the box, and whether the pixel has a ray."""
    assert frame.world_from_robot is not None
    assert frame.robot_from_mirror is not None
    match frame.camera:
        case OmniCamera() as omni:
            directions, valid = direction_from_pixel(omni, pixels)
        case PerspectiveCamera() as flat:
            directions, valid = flat.direction_from_pixel(pixels)
        case None:
            raise AssertionError("the frame of a camera has no camera model")
    pose = frame.world_from_robot @ frame.robot_from_mirror
    rays = pose.rotate_directions(directions).reshape(-1, 3)
    origins = np.broadcast_to(pose.translation, rays.shape)
    hit = np.isfinite(box_distances([BOX], origins, rays)).reshape(valid.shape)
    return hit & valid, valid


def assert_red_where_model_predicts(frame: Frame) -> None:
    """Assert that the image is red exactly where the ray of a pixel hits the box."""
    expected, certain = box_mask(frame)
    red = frame.rgb.astype(int)
    is_red = (red[..., 0] > 200) & (red[..., 1] < 60) & (red[..., 2] < 60)
    assert np.count_nonzero(expected & certain) > 10
    assert np.count_nonzero(certain) > 0.7 * np.count_nonzero(frame.rgb.any(axis=-1))
    assert np.array_equal(is_red[certain], expected[certain])


def test_pixels_of_any_camera_look_in_the_directions_of_its_model(server: RunningServer) -> None:
    with (
        spawn_beside_box(server, "A", (0.0, 0.0), 0.0),
        spawn_beside_box(server, "B", (-1.0, 1.0), 3.0),
    ):
        for query in ("&robot=A", "&robot=A&camera=Ahead", "&robot=B&camera=rear"):
            with open_frame_source(stream_address(server, query)) as source:
                frame = source.get_frame()
            assert frame.robot_name == query[7]
            assert_red_where_model_predicts(frame)


def test_frame_of_a_camera_by_name_is_of_that_robot_and_kind(server: RunningServer) -> None:
    with (
        spawn_beside_box(server, "A", (0.0, 0.0), 0.0),
        spawn_beside_box(server, "B", (-1.0, 1.0), 3.0),
    ):
        with open_frame_source(stream_address(server), robot="B", camera="Ahead") as source:
            flat = source.get_frame()
        with open_frame_source(stream_address(server), robot="B") as source:
            omni = source.get_frame()
        with open_frame_source(stream_address(server)) as source:
            default = source.get_frame()
    assert (flat.robot_name, flat.camera_name) == ("B", "Ahead")
    assert isinstance(flat.camera, PerspectiveCamera)
    assert flat.rgb.shape == (240, 320, 3)
    assert (omni.robot_name, omni.camera_name) == ("B", "OmniCamPillar_Link4")
    assert isinstance(omni.camera, OmniCamera)
    assert default.robot_name == "A"  # the robot that was spawned first
    assert flat.world_from_robot is not None
    assert flat.world_from_robot.translation[0] == pytest.approx(-1.0)


def receive_until_error(source: FrameSource) -> None:
    """Receive frames until the server has noticed a closed connection, and the source raises."""
    deadline = Deadline("end of the frames", DEADLINE_S)
    for _ in source.iter_frames():
        deadline.check()


def test_camera_when_its_robot_disconnects_is_rejected_with_the_reason(
    server: RunningServer,
) -> None:
    with open_frame_source(stream_address(server, "&robot=A&camera=Rear")) as source:
        with pytest.raises(CatoptraError, match="there is no camera 'Rear' of robot 'A'"):
            source.get_frame()
        with server.connect_stream() as client:
            client.spawn("USARBot.OmniP2AT", name="A", location_m=(0.0, 0.0, 0.0))
            assert source.get_frame().robot_name == "A"
        with pytest.raises(CatoptraError, match="there is no camera 'Rear' of robot 'A'"):
            receive_until_error(source)
        with spawn_beside_box(server, "A", (0.0, 0.0), 0.0):
            assert source.get_frame().robot_name == "A"


def test_camera_when_the_robot_has_none_of_that_name_is_rejected(server: RunningServer) -> None:
    with (
        spawn_beside_box(server, "A", (0.0, 0.0), 0.0),
        open_frame_source(stream_address(server), camera="Up") as source,
    ):
        with pytest.raises(CatoptraError, match="camera 'Up' of the robot on the image port"):
            source.get_frame()
