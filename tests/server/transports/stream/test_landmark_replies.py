"""Where landmarks are at once; what a camera sees of them when the simulation has looked."""

from __future__ import annotations

import asyncio
import threading

from catoptra_protocol.stream.replies import Error, LandmarksReply, Reply
from catoptra_protocol.stream.requests import GetLandmarksRequest
from catoptra_server.frames.frame_request import CameraChannel
from catoptra_server.simulation import LandmarksRequested, SimulationEvent
from catoptra_server.simulation.landmark_visibility import LandmarkVisibility
from catoptra_server.transports.stream.landmark_replies import (
    camera_not_found,
    handle_landmarks_request,
)
from helpers.fake_simulation import LANDMARK
from helpers.loopback import run_scenario


async def query_landmarks(
    request: GetLandmarksRequest, visible: tuple[LandmarkVisibility, ...] | None
) -> Reply:
    """Return the answer, where the simulation's thread sees so much, at 1.5 s."""
    answers: asyncio.Queue[Reply] = asyncio.Queue()

    def post(sought: SimulationEvent) -> None:
        assert isinstance(sought, LandmarksRequested)
        assert sought.channel == CameraChannel("A", "")
        thread = threading.Thread(target=sought.reply, args=(1.5, visible))
        thread.start()
        thread.join()

    handle_landmarks_request(request, (LANDMARK,), send_reply=answers.put_nowait, post=post)
    return await answers.get()


def test_landmarks_when_no_camera_is_named_are_told_without_the_simulation() -> None:
    async def scenario() -> None:
        answer = await query_landmarks(GetLandmarksRequest(1), None)
        assert isinstance(answer, LandmarksReply)
        assert (answer.landmarks[0].name, answer.landmarks[0].visible) == ("a", None)
        assert answer.time_s is None

    run_scenario(scenario())


def test_landmarks_when_a_camera_is_named_are_told_as_it_sees_them() -> None:
    async def scenario() -> None:
        seen = LandmarkVisibility(LANDMARK, (3.0, 4.0), True)
        answer = await query_landmarks(GetLandmarksRequest(2, "A"), (seen,))
        assert isinstance(answer, LandmarksReply)
        (record,) = answer.landmarks
        assert (record.pixel, record.visible, answer.time_s) == ((3.0, 4.0), True, 1.5)

    run_scenario(scenario())


def test_landmarks_when_there_is_no_such_camera_are_refused() -> None:
    async def scenario() -> None:
        refused = Error(3, "there is no camera of robot 'A'")
        assert await query_landmarks(GetLandmarksRequest(3, "A", ""), None) == refused

    run_scenario(scenario())


def test_refusal_when_nobody_is_named_speaks_of_the_screen() -> None:
    said = "there is no camera 'Rear' of the robot on the screen"
    assert camera_not_found(4, "", "Rear") == Error(4, said)
