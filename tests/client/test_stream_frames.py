"""One camera's frames: what is asked for, and what a refusal becomes."""

from __future__ import annotations

import dataclasses
from itertools import islice

import pytest

from catoptra_client.stream import StreamClient
from catoptra_client.stream_frames import StreamFrames, Watched
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.wire.stream import bytes_from_message
from catoptra_protocol.wire.stream_answers import Refused
from catoptra_protocol.wire.stream_requests import AskFrame, Encoding, Request
from client.test_stream import script
from helpers.scripted_stream import scripted_stream

REAR = Watched("A", "Rear", Encoding.RAW)


def test_frames_when_iterated_ask_for_the_camera_each_time() -> None:
    asked: list[Request] = []

    def keeping(request: Request) -> list[list[bytes]]:
        asked.append(request)
        return script(request)

    with scripted_stream(keeping) as port:
        with StreamFrames(StreamClient("127.0.0.1", port), REAR) as source:
            frames = list(islice(source.frames(), 2))
    assert [frame.sequence for frame in frames] == [1, 2]
    assert asked == [AskFrame(number, "A", "Rear", Encoding.RAW) for number in (1, 2)]


def test_frame_when_the_robot_left_raises_with_the_server_s_reason() -> None:
    def refusing(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(Refused(request.id, "there is no camera of robot 'A'"))]]

    with scripted_stream(refusing) as port:
        watched = dataclasses.replace(REAR, camera="")
        with StreamFrames(StreamClient("127.0.0.1", port), watched) as source:
            with pytest.raises(CatoptraError, match="refused: there is no camera of robot 'A'"):
                source.frame()
