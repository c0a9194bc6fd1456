"""One subscriber's slot: the newest frame, once, to whoever asked."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from catoptra_protocol.wire.stream import bytes_from_message
from catoptra_protocol.wire.stream_answers import Refused
from catoptra_protocol.wire.stream_requests import AskFrame, Encoding
from helpers.loopback import play
from helpers.stream_messages import LAW
from helpers.stream_peer import raw_peer
from helpers.stream_scene import Scene, streaming


def test_frame_when_asked_for_has_a_header_that_tells_everything() -> None:
    async def scene() -> None:
        async with streaming(Scene()) as server:
            with raw_peer(server.port) as peer:
                header, picture = await peer.frame()
                assert picture == bytes([1]) * (8 * 6 * 3)
                assert (header.robot, header.camera, header.sequence) == ("OmniP2AT", "Omni", 1)
                assert header.time_s == 0.1
                assert header.world_from_robot.position_m == (0.01, 0.0, -0.2)
                assert header.camera_law == LAW
                assert header.plan == "traced"
                assert [(one.name, one.is_on) for one in header.effects] == [("Bloom", False)]
                assert header.robot_from_mirror is not None
                assert header.robot_from_mirror.position_m == (0.1, 0.0, -0.5)
                assert (header.width_px, header.height_px) == (8, 6)
                assert header.stage_ms == {"trace": 2.0}
                assert header.age_s > 0.0

    play(scene())


@pytest.mark.parametrize("encoding", [Encoding.JPEG, Encoding.PNG])
def test_frame_when_of_an_encoding_is_a_file_of_that_kind(encoding: Encoding) -> None:
    async def scene() -> None:
        async with streaming(Scene(32, 16)) as server:
            with raw_peer(server.port) as peer:
                header, picture = await peer.frame(encoding)
                assert header.encoding is encoding
                assert picture.startswith({"jpeg": b"\xff\xd8", "png": b"\x89PNG"}[encoding.value])
                bgr = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
                assert bgr is not None
                assert (bgr == 1).all()

    play(scene())


def test_request_when_repeated_is_answered_once() -> None:
    async def scene() -> None:
        async with streaming(Scene()) as server:
            with raw_peer(server.port) as peer:
                ask = bytes_from_message(AskFrame(9, "", "", Encoding.RAW))
                await peer.send(ask)
                await peer.send(ask)
                assert (await peer.receive())[0].id == 9  # type: ignore[union-attr] # a header
                await peer.send(ask)
                assert (await peer.frame())[0].sequence == 2

    play(scene())


def test_frames_when_drawn_for_others_are_counted_as_missed() -> None:
    async def scene() -> None:
        async with streaming(Scene()) as server:
            with raw_peer(server.port) as slow, raw_peer(server.port) as fast:
                await slow.frame()
                for _ in range(5):
                    await fast.frame()
                header, _ = await slow.frame()
                assert (header.sequence, header.missed) == (7, 5)

    play(scene())


@pytest.mark.parametrize(("robot", "camera"), [("Other", ""), ("", "Rear")])
def test_camera_when_there_is_no_such_one_is_refused_with_its_name(robot: str, camera: str) -> None:
    async def scene() -> None:
        async with streaming(Scene()) as server:
            with raw_peer(server.port) as peer:
                answer = await peer.ask(AskFrame(1, robot, camera, Encoding.RAW))
                assert isinstance(answer, Refused)
                assert (robot or camera) in answer.reason

    play(scene())


def test_camera_when_named_and_shown_is_sent() -> None:
    async def scene() -> None:
        async with streaming(Scene()) as server:
            with raw_peer(server.port) as peer:
                answer = await peer.ask(AskFrame(1, "OmniP2AT", "Omni", Encoding.RAW))
                assert not isinstance(answer, Refused)

    play(scene())
