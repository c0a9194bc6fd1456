"""The stream client against a scripted server."""

from __future__ import annotations

import dataclasses
import itertools

import pytest

from catoptra_client.stream import StreamClient
from catoptra_client.stream_landmarks import SeenLandmark
from catoptra_protocol.errors import (
    CatoptraError,
    ConnectionLostError,
    RemoteProtocolError,
    ServerSlowError,
)
from catoptra_protocol.wire.reports import OdometryReading, line_from_report
from catoptra_protocol.wire.stream import bytes_from_message
from catoptra_protocol.wire.stream_answers import (
    Answer,
    Done,
    LandmarksAre,
    Refused,
    Reported,
    StartsAre,
    StatusIs,
)
from catoptra_protocol.wire.stream_requests import (
    AskDrive,
    AskFrame,
    AskLandmarks,
    AskReset,
    AskStarts,
    AskStatus,
    Encoding,
    Request,
)
from helpers.scripted_stream import PULSE, Script, scripted_stream
from helpers.stream_messages import HEADER, LANDMARK

HOST = "127.0.0.1"
SHORT_S = 0.1  # a timeout that is meant to pass
STATUS = StatusIs(1, 0, "Catoptra", "field", ("USARBot.OmniP2AT",), "realtime", 1, False, 0)
PICTURE = bytes(range(72))


def plain(request: Request) -> list[Answer]:
    """Return what a well-behaved server answers."""
    match request:
        case AskStatus(id_):
            return [dataclasses.replace(STATUS, id=id_)]
        case AskLandmarks(id_, None):
            return [LandmarksAre(id_, (LANDMARK,))]
        case AskLandmarks(id_):
            seen = dataclasses.replace(LANDMARK, pixel=(1.5, 2.5), visible=True)
            return [LandmarksAre(id_, (seen,), 0.25)]
        case AskStarts(id_):
            return [StartsAre(id_, ())]
        case AskDrive(id_) | AskReset(id_):
            return [Done(id_)]
        case _:
            line = line_from_report(OdometryReading("Odometry", 1.0, 2.0, 0.5)).decode().strip()
            return [Reported(request.id, (line,))]


def script(request: Request) -> list[list[bytes]]:
    """Answer everything; frames are all the same but for their numbers."""
    if isinstance(request, AskFrame):
        header = dataclasses.replace(HEADER, id=request.id, sequence=request.id, camera_law=None)
        return [[bytes_from_message(header), PICTURE]]
    return [[bytes_from_message(answer)] for answer in plain(request)]


def refusing(request: Request) -> list[list[bytes]]:
    return [[bytes_from_message(Refused(request.id, "no robot"))]]


def silent(request: Request) -> list[list[bytes]]:
    return []


def test_client_when_everything_is_answered_returns_what_was_said() -> None:
    with scripted_stream(script) as port, StreamClient.connect(HOST, port) as client:
        assert client.status().world == "field"
        assert client.spawn("USARBot.OmniP2AT") == [OdometryReading("Odometry", 1.0, 2.0, 0.5)]
        assert client.step(0.2) == client.readings()
        client.drive(1.0, 2.0)
        client.reset()
        (mark,) = client.landmarks()
        assert (mark.name, mark.upper_colour) == (LANDMARK.name, LANDMARK.upper_colour)
        assert client.landmarks_seen("Mine") == (SeenLandmark(mark, (1.5, 2.5), True, 0.25),)
        assert client.start_poses() == ()


def test_frames_when_iterated_are_asked_for_one_by_one() -> None:
    with scripted_stream(script) as port, StreamClient.connect(HOST, port) as client:
        frames = list(itertools.islice(client.frames(encoding=Encoding.RAW), 3))
    assert [frame.sequence for frame in frames] == [2, 3, 4]
    assert frames[0].rgb.tobytes() == PICTURE
    assert frames[0].rgb.shape == (4, 6, 3)
    assert (frames[0].robot, frames[0].missed, frames[0].dropped) == ("Mine", 2, 0)


def test_answers_when_old_or_unknown_or_pulses_come_between_are_passed_over() -> None:
    def chatty(request: Request) -> list[list[bytes]]:
        old = [bytes_from_message(Done(request.id - 1))]
        return [[PULSE], old, [b"\x81\xa4kind\xa4news"], *script(request)]

    with scripted_stream(chatty) as port, StreamClient.connect(HOST, port) as client:
        client.drive(1.0, 1.0)
        assert client.frame(encoding=Encoding.RAW).sequence == 3


def test_request_when_refused_raises_with_the_reason() -> None:
    with scripted_stream(refusing) as port, StreamClient(HOST, port) as client:
        with pytest.raises(CatoptraError, match=f"127.0.0.1:{port} refused: no robot"):
            client.drive(1.0, 1.0)


def test_request_when_the_server_cannot_read_us_says_so() -> None:
    def deaf(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(Refused(0, "no msgpack"))]]

    with scripted_stream(deaf) as port, StreamClient(HOST, port) as client:
        with pytest.raises(RemoteProtocolError, match="cannot read us: no msgpack"):
            client.reset()


def test_answer_when_of_another_kind_is_refused() -> None:
    def wrong(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(Done(request.id))]]

    with scripted_stream(wrong) as port, StreamClient(HOST, port) as client:
        with pytest.raises(RemoteProtocolError, match="answered with done"):
            client.status()


def test_server_when_there_is_none_is_named() -> None:
    with pytest.raises(ConnectionLostError, match=r"no stream server at .*--stream-port"):
        StreamClient.connect(HOST, 1, timeout_s=SHORT_S)


def test_server_when_silent_altogether_is_lost() -> None:
    with scripted_stream(silent) as port:
        with StreamClient(HOST, port, timeout_s=SHORT_S) as client:
            with pytest.raises(ConnectionLostError, match="nothing heard"):
                client.frame()


def test_server_when_it_lives_and_sends_no_frame_is_slow() -> None:
    with scripted_stream(silent, pulses=True) as port:
        with StreamClient(HOST, port, timeout_s=SHORT_S) as client:
            with pytest.raises(ServerSlowError, match="lives but did not send a frame"):
                client.frame()


def test_frames_when_the_server_was_away_go_on() -> None:
    with scripted_stream(script) as port:
        client = StreamClient.connect(HOST, port)
        first = client.frame(encoding=Encoding.RAW)
    with client, scripted_stream(script, port=port):
        again = client.frame(encoding=Encoding.RAW)
        assert again.sequence == first.sequence + 1


def lossy() -> Script:
    """Lose the first request for a frame, as a server does that restarts."""
    asked: list[int] = []

    def answer(request: Request) -> list[list[bytes]]:
        asked.append(request.id)
        return script(request) if len(asked) > 1 else []

    return answer


def test_request_for_a_frame_when_lost_is_repeated() -> None:
    with scripted_stream(lossy()) as port, StreamClient(HOST, port) as client:
        assert client.frame(encoding=Encoding.RAW).sequence == 1
