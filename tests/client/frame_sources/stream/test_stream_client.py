"""The stream client against a scripted server."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from catoptra_client.frame_sources.stream.stream_client import LandmarkProjection, StreamClient
from catoptra_protocol.camera_conf import pairs_from_perspective_camera
from catoptra_protocol.errors import (
    CatoptraError,
    ConnectionLostError,
    DeadlineExceededError,
    LocalProtocolError,
    RemoteProtocolError,
)
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import (
    CameraReply,
    Error,
    LandmarksReply,
    Ok,
    Reply,
    SensorReports,
    StartPosesReply,
    StateReply,
    StatusReply,
)
from catoptra_protocol.stream.requests import (
    DriveRequest,
    GetFrameRequest,
    GetLandmarksRequest,
    GetStartPosesRequest,
    GetStateRequest,
    GetStatusRequest,
    ImageEncoding,
    PublishRequest,
    Request,
    ResetRequest,
    ShareControlRequest,
)
from catoptra_protocol.usarsim.reports import OdometryReading, line_from_report
from helpers.scripted_stream import HEARTBEAT, Script, serve_stream_script
from helpers.stream_messages import HEADER, LANDMARK, UPRIGHT_TRANSFORM

HOST = "127.0.0.1"
# A timeout that expires in the test.
SHORT_S = 0.1
STATUS = StatusReply(1, 0, "Catoptra", "field", ("USARBot.OmniP2AT",), "realtime", 1, False, 0)
IMAGE = bytes(range(72))


def make_replies(request: Request) -> list[Reply]:
    """Replies of a well-behaved server."""
    match request:
        case GetStatusRequest(id_):
            return [dataclasses.replace(STATUS, id=id_)]
        case GetLandmarksRequest(id_, None):
            return [LandmarksReply(id_, (LANDMARK,))]
        case GetLandmarksRequest(id_):
            visible = dataclasses.replace(LANDMARK, pixel=(1.5, 2.5), visible=True)
            return [LandmarksReply(id_, (visible,), 0.25)]
        case GetStartPosesRequest(id_):
            return [StartPosesReply(id_, ())]
        case GetStateRequest(id_, robot):
            return [StateReply(id_, 1.5, (), robot, (), ())]
        case DriveRequest(id_) | ResetRequest(id_) | PublishRequest(id_) | ShareControlRequest(id_):
            return [Ok(id_)]
        case _:
            line = line_from_report(OdometryReading("Odometry", 1.0, 2.0, 0.5)).decode().strip()
            return [SensorReports(request.id, (line,))]


def reply_to_all(request: Request) -> list[list[bytes]]:
    """Reply to every request; frames differ in their numbers only."""
    if isinstance(request, GetFrameRequest):
        header = dataclasses.replace(HEADER, id=request.id, sequence=request.id, camera_model=None)
        return [[bytes_from_message(header), IMAGE]]
    return [[bytes_from_message(reply)] for reply in make_replies(request)]


def reply_with_error(request: Request) -> list[list[bytes]]:
    return [[bytes_from_message(Error(request.id, "no robot"))]]


def ignore_request(request: Request) -> list[list[bytes]]:
    return []


def test_client_when_every_request_has_a_reply_returns_their_values() -> None:
    with serve_stream_script(reply_to_all) as port, StreamClient.connect(HOST, port) as client:
        assert client.get_status().world == "field"
        assert client.spawn("USARBot.OmniP2AT") == [OdometryReading("Odometry", 1.0, 2.0, 0.5)]
        assert client.step(0.2) == client.get_readings()
        client.drive(1.0, 2.0)
        client.reset()
        (mark,) = client.get_landmarks()
        assert (mark.name, mark.upper_colour) == (LANDMARK.name, LANDMARK.upper_colour)
        assert client.get_landmark_projections("Mine") == (
            LandmarkProjection(mark, (1.5, 2.5), True, 0.25),
        )
        assert client.get_start_poses() == ()


def test_note_sharing_and_drive_of_another_robot_are_requested() -> None:
    requests: list[Request] = []

    def record(request: Request) -> list[list[bytes]]:
        requests.append(request)
        return reply_to_all(request)

    with serve_stream_script(record) as port, StreamClient(HOST, port) as client:
        client.publish("ekf", {"pose": np.array([1.0, 2.0, 0.5])})
        client.share_control()
        client.share_control(False)
        client.drive(1.0, None, robot="Theirs")
        assert client.get_state("Theirs").robot == "Theirs"
        with pytest.raises(LocalProtocolError, match="no JSON object"):
            client.publish("ekf", {"pose": np.array([np.nan])})
    assert requests == [
        PublishRequest(1, "ekf", '{"pose":[1.0,2.0,0.5]}'),
        ShareControlRequest(2, True),
        ShareControlRequest(3, False),
        DriveRequest(4, 1.0, None, False, "Theirs"),
        GetStateRequest(5, "Theirs"),
    ]


def test_frames_when_iterated_are_requested_one_by_one() -> None:
    with serve_stream_script(reply_to_all) as port, StreamClient.connect(HOST, port) as client:
        frames = list(itertools.islice(client.iter_frames(encoding=ImageEncoding.RAW), 3))
    assert [frame.sequence for frame in frames] == [2, 3, 4]
    assert frames[0].rgb.tobytes() == IMAGE
    assert frames[0].rgb.shape == (4, 6, 3)
    assert (frames[0].robot_name, frames[0].missed_frames, frames[0].dropped_frames) == (
        "Mine",
        2,
        0,
    )


def test_replies_when_late_or_unknown_or_heartbeats_are_skipped() -> None:
    def reply_with_noise(request: Request) -> list[list[bytes]]:
        late = [bytes_from_message(Ok(request.id - 1))]
        return [[HEARTBEAT], late, [b"\x81\xa4kind\xa8forecast"], *reply_to_all(request)]

    with serve_stream_script(reply_with_noise) as port, StreamClient.connect(HOST, port) as client:
        client.drive(1.0, 1.0)
        assert client.get_frame(encoding=ImageEncoding.RAW).sequence == 3


def test_request_when_rejected_raises_with_the_reason() -> None:
    with serve_stream_script(reply_with_error) as port, StreamClient(HOST, port) as client:
        with pytest.raises(CatoptraError, match=f"127.0.0.1:{port} rejected the request: no robot"):
            client.drive(1.0, 1.0)


def test_request_when_unreadable_raises_with_the_reason() -> None:
    def reply_unreadable(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(Error(0, "no msgpack"))]]

    with serve_stream_script(reply_unreadable) as port, StreamClient(HOST, port) as client:
        with pytest.raises(RemoteProtocolError, match="cannot read the request: no msgpack"):
            client.reset()


def test_reply_when_of_another_kind_is_rejected() -> None:
    def reply_with_wrong_kind(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(Ok(request.id))]]

    with serve_stream_script(reply_with_wrong_kind) as port, StreamClient(HOST, port) as client:
        with pytest.raises(RemoteProtocolError, match="replied with ok"):
            client.get_status()


def test_connection_when_there_is_no_server_names_the_address() -> None:
    with pytest.raises(ConnectionLostError, match=r"no stream server at .*--stream-port"):
        StreamClient.connect(HOST, 1, timeout_s=SHORT_S)


def test_server_when_it_sends_nothing_is_lost() -> None:
    with serve_stream_script(ignore_request) as port:
        with StreamClient(HOST, port, timeout_s=SHORT_S) as client:
            with pytest.raises(ConnectionLostError, match="no heartbeat"):
                client.get_frame()


def test_camera_when_perspective_is_a_model_without_a_height() -> None:
    pairs = dict(pairs_from_perspective_camera(PerspectiveCamera(64, 48, 0.8)))

    def reply_with_camera(request: Request) -> list[list[bytes]]:
        reply = CameraReply(request.id, "USARBot.P2AT", "Camera", pairs, UPRIGHT_TRANSFORM, None)
        return [[bytes_from_message(reply)]]

    with serve_stream_script(reply_with_camera) as port, StreamClient(HOST, port) as client:
        assert client.get_camera("Camera") == PerspectiveCamera(64, 48, 0.8)
        with pytest.raises(RemoteProtocolError, match="Mirror"):
            client.get_camera_and_height("Camera")


def test_server_when_it_sends_heartbeats_and_no_frame_is_slow() -> None:
    with serve_stream_script(ignore_request, sends_heartbeats=True) as port:
        with StreamClient(HOST, port, timeout_s=SHORT_S) as client:
            with pytest.raises(DeadlineExceededError, match="sends heartbeats but not a frame"):
                client.get_frame()


def test_frames_when_the_server_restarts_continue() -> None:
    with serve_stream_script(reply_to_all) as port:
        client = StreamClient.connect(HOST, port)
        first = client.get_frame(encoding=ImageEncoding.RAW)
    with client, serve_stream_script(reply_to_all, port=port):
        again = client.get_frame(encoding=ImageEncoding.RAW)
        assert again.sequence == first.sequence + 1


def lose_first_request() -> Script:
    """Ignore the first request for a frame, as a server that restarts."""
    ids: list[int] = []

    def reply(request: Request) -> list[list[bytes]]:
        ids.append(request.id)
        return reply_to_all(request) if len(ids) > 1 else []

    return reply


def test_request_for_a_frame_when_lost_is_repeated() -> None:
    with serve_stream_script(lose_first_request()) as port, StreamClient(HOST, port) as client:
        assert client.get_frame(encoding=ImageEncoding.RAW).sequence == 1
