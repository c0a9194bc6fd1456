"""True landmarks at once; projections once the simulation has computed them."""

from __future__ import annotations

import asyncio
import threading

from catoptra_protocol.stream.replies import Error, LandmarksReply, Reply
from catoptra_protocol.stream.requests import GetLandmarksRequest
from catoptra_server.frames.frame import CameraChannel
from catoptra_server.serve.stream.replies import (
    camera_not_found,
    landmarks_reply,
    request_projections,
)
from catoptra_server.serve.stream.session import PendingRequests, RobotSession
from catoptra_server.simulation import Fault, LandmarksRequested, SimulationEvent
from catoptra_server.simulation.sight import LandmarkVisibility
from helpers.fake_simulation import LANDMARK
from helpers.loopback import run_scenario


async def query_projections(
    request: GetLandmarksRequest, result: tuple[LandmarkVisibility, ...] | Fault | None
) -> Reply:
    """Reply to a request, with this result of the simulation's thread at 1.5 s."""
    replies: asyncio.Queue[Reply] = asyncio.Queue()

    def post(event: SimulationEvent) -> bool:
        assert isinstance(event, LandmarksRequested)
        assert (event.client, event.channel) == (session, CameraChannel("A", ""))
        thread = threading.Thread(target=event.reply, args=(1.5, result))
        thread.start()
        thread.join()
        return True

    session = RobotSession(post, on_fault=print)
    pending = PendingRequests(replies.put_nowait)
    request_projections(request, pending.add(request.id), session)
    return await replies.get()


def test_landmarks_without_a_camera_are_the_true_ones() -> None:
    reply = landmarks_reply(1, (LANDMARK,))
    assert (reply.landmarks[0].name, reply.landmarks[0].visible) == ("a", None)
    assert reply.time_s is None


def test_landmarks_of_a_camera_have_their_projections() -> None:
    async def scenario() -> None:
        projected = LandmarkVisibility(LANDMARK, (3.0, 4.0), True)
        reply = await query_projections(GetLandmarksRequest(2, "A"), (projected,))
        assert isinstance(reply, LandmarksReply)
        (record,) = reply.landmarks
        assert (record.pixel, record.visible, reply.time_s) == ((3.0, 4.0), True, 1.5)

    run_scenario(scenario())


def test_landmarks_of_a_missing_camera_are_an_error() -> None:
    async def scenario() -> None:
        error = Error(3, "there is no camera of robot 'A'")
        assert await query_projections(GetLandmarksRequest(3, "A", ""), None) == error

    run_scenario(scenario())


def test_landmarks_when_their_projection_failed_are_an_error_with_the_reason() -> None:
    async def scenario() -> None:
        reply = await query_projections(GetLandmarksRequest(3, "A", ""), Fault("a fault"))
        assert reply == Error(3, "a fault")

    run_scenario(scenario())


def test_error_when_no_robot_is_named_speaks_of_the_image_port() -> None:
    reason = "there is no camera 'Rear' of the robot on the image port"
    assert camera_not_found(4, "", "Rear") == Error(4, reason)
