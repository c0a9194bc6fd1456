"""One camera's frames: what is asked for, and what a refusal becomes."""

from __future__ import annotations

import dataclasses
from itertools import islice

import pytest
from client.test_stream import reply_to_all

from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.frame_sources.stream.stream_frame_source import (
    CameraSelection,
    StreamFrameSource,
)
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import Error
from catoptra_protocol.stream.requests import GetFrameRequest, ImageEncoding, Request
from helpers.scripted_stream import serve_stream_script

REAR_CAMERA = CameraSelection("A", "Rear", ImageEncoding.RAW)


def test_frames_when_iterated_ask_for_the_camera_each_time() -> None:
    asked: list[Request] = []

    def record_request(request: Request) -> list[list[bytes]]:
        asked.append(request)
        return reply_to_all(request)

    with serve_stream_script(record_request) as port:
        with StreamFrameSource(StreamClient("127.0.0.1", port), REAR_CAMERA) as source:
            frames = list(islice(source.iter_frames(), 2))
    assert [frame.sequence for frame in frames] == [1, 2]
    assert asked == [GetFrameRequest(number, "A", "Rear", ImageEncoding.RAW) for number in (1, 2)]


def test_frame_when_the_robot_left_raises_with_the_server_s_reason() -> None:
    def reply_with_error(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(Error(request.id, "there is no camera of robot 'A'"))]]

    with serve_stream_script(reply_with_error) as port:
        watched = dataclasses.replace(REAR_CAMERA, camera="")
        with StreamFrameSource(StreamClient("127.0.0.1", port), watched) as source:
            with pytest.raises(CatoptraError, match="refused: there is no camera of robot 'A'"):
                source.get_frame()
