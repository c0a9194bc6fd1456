"""Frame sources: the one protocol, and that of the stream."""

from __future__ import annotations

import dataclasses
from itertools import islice
from typing import Any

import pytest

from catoptra_client.frame_sources.frame_source import open_frame_source
from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.frame_sources.stream.stream_frame_source import (
    CameraSelection,
    StreamFrameSource,
)
from catoptra_protocol.errors import CatoptraError, ConnectionLostError
from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import Error
from catoptra_protocol.stream.requests import GetFrameRequest, ImageEncoding, Request
from client.frame_sources.stream.test_stream_client import reply_to_all
from client.scripted_server import serve_script
from helpers.scripted_stream import serve_stream_script


@pytest.mark.parametrize(
    "url",
    [
        *("", "127.0.0.1:5003", "http://a:1", "zmq://a:seven"),
        *("zmq://a:1?encoding=gif", "zmq://a:1?robots=A"),
    ],
)
def test_url_when_malformed_names_the_expected_form(url: str) -> None:
    with pytest.raises(CatoptraError, match="expected tcp://host:port"):
        open_frame_source(url)


@pytest.mark.parametrize("scheme", ["tcp", "zmq"])
def test_url_when_there_is_no_server_names_the_address(scheme: str) -> None:
    with pytest.raises(ConnectionLostError, match=r"127\.0\.0\.1:1"):
        open_frame_source(f"{scheme}://127.0.0.1:1", timeout_s=0.1)


@pytest.mark.parametrize(
    ("query", "keywords", "selection"),
    [
        ("", {}, CameraSelection()),
        (
            "?robot=R%201&camera=Rear&encoding=png",
            {},
            CameraSelection("R 1", "Rear", ImageEncoding.PNG),
        ),
        (
            "?robot=A&camera=Rear",
            {"camera": "Ahead", "encoding": ImageEncoding.RAW},
            CameraSelection("A", "Ahead", ImageEncoding.RAW),
        ),
    ],
    ids=["none", "by the url", "by keywords"],
)
def test_url_of_a_stream_opens_a_source_of_the_selected_camera(
    query: str, keywords: dict[str, Any], selection: CameraSelection
) -> None:
    with (
        serve_stream_script(reply_to_all) as port,
        open_frame_source(f"zmq://127.0.0.1:{port}{query}", **keywords) as source,
    ):
        assert isinstance(source, StreamFrameSource)
        assert source.selection == selection


def test_camera_when_selected_over_tcp_is_rejected_with_the_alternative() -> None:
    with pytest.raises(CatoptraError, match="select a robot and a camera over the stream"):
        open_frame_source("tcp://127.0.0.1:1?robot=A")
    with pytest.raises(CatoptraError, match="select a robot and a camera over the stream"):
        open_frame_source("tcp://127.0.0.1:1", robot="A")


def test_url_of_an_image_port_opens_an_image_client() -> None:
    with (
        serve_script(lambda connection: None) as port,
        open_frame_source(f"tcp://127.0.0.1:{port}") as source,
    ):
        assert isinstance(source, ImageClient)


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
