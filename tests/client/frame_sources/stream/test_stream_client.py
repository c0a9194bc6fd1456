"""The stream client against a scripted server."""

from __future__ import annotations

import dataclasses
import itertools

import pytest

from catoptra_client.frame_sources.stream.landmark_projections import LandmarkProjection
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.errors import (
    CatoptraError,
    ConnectionLostError,
    DeadlineExceededError,
    RemoteProtocolError,
)
from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import (
    Error,
    LandmarksReply,
    Ok,
    Reply,
    SensorReports,
    StartPosesReply,
    StatusReply,
)
from catoptra_protocol.stream.requests import (
    DriveRequest,
    GetFrameRequest,
    GetLandmarksRequest,
    GetStartPosesRequest,
    GetStatusRequest,
    ImageEncoding,
    Request,
    ResetRequest,
)
from catoptra_protocol.usarsim.reports import OdometryReading, line_from_report
from helpers.scripted_stream import HEARTBEAT, Script, serve_stream_script
from helpers.stream_messages import HEADER, LANDMARK

HOST = "127.0.0.1"
SHORT_S = 0.1  # a timeout that is meant to pass
STATUS = StatusReply(1, 0, "Catoptra", "field", ("USARBot.OmniP2AT",), "realtime", 1, False, 0)
PICTURE = bytes(range(72))


def make_replies(request: Request) -> list[Reply]:
    """Return what a well-behaved server answers."""
    match request:
        case GetStatusRequest(id_):
            return [dataclasses.replace(STATUS, id=id_)]
        case GetLandmarksRequest(id_, None):
            return [LandmarksReply(id_, (LANDMARK,))]
        case GetLandmarksRequest(id_):
            seen = dataclasses.replace(LANDMARK, pixel=(1.5, 2.5), visible=True)
            return [LandmarksReply(id_, (seen,), 0.25)]
        case GetStartPosesRequest(id_):
            return [StartPosesReply(id_, ())]
        case DriveRequest(id_) | ResetRequest(id_):
            return [Ok(id_)]
        case _:
            line = line_from_report(OdometryReading("Odometry", 1.0, 2.0, 0.5)).decode().strip()
            return [SensorReports(request.id, (line,))]


def reply_to_all(request: Request) -> list[list[bytes]]:
    """Answer everything; frames are all the same but for their numbers."""
    if isinstance(request, GetFrameRequest):
        header = dataclasses.replace(HEADER, id=request.id, sequence=request.id, camera_law=None)
        return [[bytes_from_message(header), PICTURE]]
    return [[bytes_from_message(answer)] for answer in make_replies(request)]


def reply_with_error(request: Request) -> list[list[bytes]]:
    return [[bytes_from_message(Error(request.id, "no robot"))]]


def ignore_request(request: Request) -> list[list[bytes]]:
    return []


def test_client_when_everything_is_answered_returns_what_was_said() -> None:
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


def test_frames_when_iterated_are_asked_for_one_by_one() -> None:
    with serve_stream_script(reply_to_all) as port, StreamClient.connect(HOST, port) as client:
        frames = list(itertools.islice(client.iter_frames(encoding=ImageEncoding.RAW), 3))
    assert [frame.sequence for frame in frames] == [2, 3, 4]
    assert frames[0].rgb.tobytes() == PICTURE
    assert frames[0].rgb.shape == (4, 6, 3)
    assert (frames[0].robot_name, frames[0].missed_frames, frames[0].dropped_frames) == (
        "Mine",
        2,
        0,
    )


def test_answers_when_old_or_unknown_or_pulses_come_between_are_passed_over() -> None:
    def reply_with_noise(request: Request) -> list[list[bytes]]:
        old = [bytes_from_message(Ok(request.id - 1))]
        return [[HEARTBEAT], old, [b"\x81\xa4kind\xa4news"], *reply_to_all(request)]

    with serve_stream_script(reply_with_noise) as port, StreamClient.connect(HOST, port) as client:
        client.drive(1.0, 1.0)
        assert client.get_frame(encoding=ImageEncoding.RAW).sequence == 3


def test_request_when_refused_raises_with_the_reason() -> None:
    with serve_stream_script(reply_with_error) as port, StreamClient(HOST, port) as client:
        with pytest.raises(CatoptraError, match=f"127.0.0.1:{port} refused: no robot"):
            client.drive(1.0, 1.0)


def test_request_when_the_server_cannot_read_us_says_so() -> None:
    def reply_unreadable(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(Error(0, "no msgpack"))]]

    with serve_stream_script(reply_unreadable) as port, StreamClient(HOST, port) as client:
        with pytest.raises(RemoteProtocolError, match="cannot read us: no msgpack"):
            client.reset()


def test_answer_when_of_another_kind_is_refused() -> None:
    def reply_with_wrong_kind(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(Ok(request.id))]]

    with serve_stream_script(reply_with_wrong_kind) as port, StreamClient(HOST, port) as client:
        with pytest.raises(RemoteProtocolError, match="answered with done"):
            client.get_status()


def test_server_when_there_is_none_is_named() -> None:
    with pytest.raises(ConnectionLostError, match=r"no stream server at .*--stream-port"):
        StreamClient.connect(HOST, 1, timeout_s=SHORT_S)


def test_server_when_silent_altogether_is_lost() -> None:
    with serve_stream_script(ignore_request) as port:
        with StreamClient(HOST, port, timeout_s=SHORT_S) as client:
            with pytest.raises(ConnectionLostError, match="nothing heard"):
                client.get_frame()


def test_server_when_it_lives_and_sends_no_frame_is_slow() -> None:
    with serve_stream_script(ignore_request, sends_heartbeats=True) as port:
        with StreamClient(HOST, port, timeout_s=SHORT_S) as client:
            with pytest.raises(DeadlineExceededError, match="lives but did not send a frame"):
                client.get_frame()


def test_frames_when_the_server_was_away_go_on() -> None:
    with serve_stream_script(reply_to_all) as port:
        client = StreamClient.connect(HOST, port)
        first = client.get_frame(encoding=ImageEncoding.RAW)
    with client, serve_stream_script(reply_to_all, port=port):
        again = client.get_frame(encoding=ImageEncoding.RAW)
        assert again.sequence == first.sequence + 1


def lose_first_request() -> Script:
    """Lose the first request for a frame, as a server does that restarts."""
    asked: list[int] = []

    def reply(request: Request) -> list[list[bytes]]:
        asked.append(request.id)
        return reply_to_all(request) if len(asked) > 1 else []

    return reply


def test_request_for_a_frame_when_lost_is_repeated() -> None:
    with serve_stream_script(lose_first_request()) as port, StreamClient(HOST, port) as client:
        assert client.get_frame(encoding=ImageEncoding.RAW).sequence == 1
