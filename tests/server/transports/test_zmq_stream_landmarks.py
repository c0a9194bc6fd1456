"""Where landmarks are at once; what a camera sees of them when the simulation has looked."""

from __future__ import annotations

import asyncio
import threading

from catoptra_protocol.wire.stream_answers import Answer, LandmarksAre, Refused
from catoptra_protocol.wire.stream_requests import AskLandmarks
from catoptra_server.imaging.shot import CameraChannel
from catoptra_server.simulation import LandmarksSought, Request
from catoptra_server.simulation.sightings import Sighting
from catoptra_server.transports.zmq_stream_landmarks import answer_landmarks, nothing_shown
from helpers.loopback import play
from helpers.stream_scene import LANDMARK


async def answered(request: AskLandmarks, seen: tuple[Sighting, ...] | None) -> Answer:
    """Return the answer, where the simulation's thread sees so much, at 1.5 s."""
    answers: asyncio.Queue[Answer] = asyncio.Queue()

    def post(sought: Request) -> None:
        assert isinstance(sought, LandmarksSought)
        assert sought.channel == CameraChannel("A", "")
        thread = threading.Thread(target=sought.reply, args=(1.5, seen))
        thread.start()
        thread.join()

    answer_landmarks(request, (LANDMARK,), answer=answers.put_nowait, post=post)
    return await answers.get()


def test_landmarks_when_no_camera_is_named_are_told_without_the_simulation() -> None:
    async def scene() -> None:
        answer = await answered(AskLandmarks(1), None)
        assert isinstance(answer, LandmarksAre)
        assert (answer.landmarks[0].name, answer.landmarks[0].visible) == ("a", None)
        assert answer.time_s is None

    play(scene())


def test_landmarks_when_a_camera_is_named_are_told_as_it_sees_them() -> None:
    async def scene() -> None:
        seen = Sighting(LANDMARK, (3.0, 4.0), True)
        answer = await answered(AskLandmarks(2, "A"), (seen,))
        assert isinstance(answer, LandmarksAre)
        (record,) = answer.landmarks
        assert (record.pixel, record.visible, answer.time_s) == ((3.0, 4.0), True, 1.5)

    play(scene())


def test_landmarks_when_there_is_no_such_camera_are_refused() -> None:
    async def scene() -> None:
        refused = Refused(3, "there is no camera of robot 'A'")
        assert await answered(AskLandmarks(3, "A", ""), None) == refused

    play(scene())


def test_refusal_when_nobody_is_named_speaks_of_the_screen() -> None:
    said = "there is no camera 'Rear' of the robot on the screen"
    assert nothing_shown(4, "", "Rear") == Refused(4, said)
