"""Frames of one camera: the requests, and the error of a missing camera."""

from __future__ import annotations

import dataclasses
from itertools import islice

import pytest

from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.frame_sources.stream.stream_frame_source import (
    CameraSelection,
    StreamFrameSource,
)
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import Error
from catoptra_protocol.stream.requests import GetFrameRequest, ImageEncoding, Request
from client.frame_sources.stream.test_stream_client import reply_to_all
from helpers.scripted_stream import serve_stream_script

REAR_CAMERA = CameraSelection("A", "Rear", ImageEncoding.RAW)


def test_frames_when_iterated_request_the_camera_each_time() -> None:
    requests: list[Request] = []

    def record_request(request: Request) -> list[list[bytes]]:
        requests.append(request)
        return reply_to_all(request)

    with serve_stream_script(record_request) as port:
        with StreamFrameSource(StreamClient("127.0.0.1", port), REAR_CAMERA) as source:
            frames = list(islice(source.iter_frames(), 2))
    assert [frame.sequence for frame in frames] == [1, 2]
    assert requests == [
        GetFrameRequest(number, "A", "Rear", ImageEncoding.RAW) for number in (1, 2)
    ]


def test_frame_when_the_robot_is_gone_raises_with_the_server_s_reason() -> None:
    def reply_with_error(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(Error(request.id, "there is no camera of robot 'A'"))]]

    with serve_stream_script(reply_with_error) as port:
        selection = dataclasses.replace(REAR_CAMERA, camera="")
        with StreamFrameSource(StreamClient("127.0.0.1", port), selection) as source:
            with pytest.raises(
                CatoptraError, match="rejected the request: there is no camera of robot 'A'"
            ):
                source.get_frame()
