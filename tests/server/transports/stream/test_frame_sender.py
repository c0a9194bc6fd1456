"""Frames of one client: the newest one, once per request."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import Error
from catoptra_protocol.stream.requests import GetFrameRequest, ImageEncoding
from helpers.fake_simulation import FakeSimulation, serve_fake_simulation
from helpers.loopback import run_scenario
from helpers.stream_messages import CAMERA_MODEL
from helpers.stream_peer import connect_raw_peer


def test_frame_when_requested_has_a_complete_header() -> None:
    async def scenario() -> None:
        async with serve_fake_simulation(FakeSimulation()) as server:
            with connect_raw_peer(server.port) as peer:
                header, image = await peer.get_frame()
                assert image == bytes([1]) * (8 * 6 * 3)
                assert (header.robot, header.camera, header.sequence) == ("OmniP2AT", "Omni", 1)
                assert header.time_s == 0.1
                assert header.world_from_robot.position_m == (0.01, 0.0, -0.2)
                assert header.camera_model == CAMERA_MODEL
                assert header.plan == "traced"
                assert [(one.name, one.enabled) for one in header.effects] == [("Blooming", False)]
                assert header.robot_from_mirror is not None
                assert header.robot_from_mirror.position_m == (0.1, 0.0, -0.5)
                assert (header.width_px, header.height_px) == (8, 6)
                assert header.stage_ms == {"trace": 2.0}
                assert header.age_s > 0.0

    run_scenario(scenario())


@pytest.mark.parametrize("encoding", [ImageEncoding.JPEG, ImageEncoding.PNG])
def test_frame_when_of_an_encoding_is_a_file_of_that_type(encoding: ImageEncoding) -> None:
    async def scenario() -> None:
        async with serve_fake_simulation(FakeSimulation(32, 16)) as server:
            with connect_raw_peer(server.port) as peer:
                header, image = await peer.get_frame(encoding)
                assert header.encoding is encoding
                assert image.startswith({"jpeg": b"\xff\xd8", "png": b"\x89PNG"}[encoding.value])
                bgr = cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_COLOR)
                assert bgr is not None
                assert (bgr == 1).all()

    run_scenario(scenario())


def test_request_when_repeated_has_one_reply() -> None:
    async def scenario() -> None:
        async with serve_fake_simulation(FakeSimulation()) as server:
            with connect_raw_peer(server.port) as peer:
                data = bytes_from_message(GetFrameRequest(9, "", "", ImageEncoding.RAW))
                await peer.send(data)
                await peer.send(data)
                assert (await peer.receive())[0].id == 9  # type: ignore[union-attr] # a header
                await peer.send(data)
                assert (await peer.get_frame())[0].sequence == 2

    run_scenario(scenario())


def test_frames_when_rendered_for_others_are_counted_as_missed() -> None:
    async def scenario() -> None:
        async with serve_fake_simulation(FakeSimulation()) as server:
            with connect_raw_peer(server.port) as slow, connect_raw_peer(server.port) as fast:
                await slow.get_frame()
                for _ in range(5):
                    await fast.get_frame()
                header, _ = await slow.get_frame()
                assert (header.sequence, header.missed_frames) == (7, 5)

    run_scenario(scenario())


@pytest.mark.parametrize(("robot", "camera"), [("Other", ""), ("", "Rear")])
def test_camera_when_missing_is_an_error_with_its_name(robot: str, camera: str) -> None:
    async def scenario() -> None:
        async with serve_fake_simulation(FakeSimulation()) as server:
            with connect_raw_peer(server.port) as peer:
                reply = await peer.send_request(
                    GetFrameRequest(1, robot, camera, ImageEncoding.RAW)
                )
                assert isinstance(reply, Error)
                assert (robot or camera) in reply.reason

    run_scenario(scenario())


def test_camera_when_named_and_present_is_sent() -> None:
    async def scenario() -> None:
        async with serve_fake_simulation(FakeSimulation()) as server:
            with connect_raw_peer(server.port) as peer:
                reply = await peer.send_request(
                    GetFrameRequest(1, "OmniP2AT", "Omni", ImageEncoding.RAW)
                )
                assert not isinstance(reply, Error)

    run_scenario(scenario())
