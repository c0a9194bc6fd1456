"""The stream's answer to where landmarks are, and to which of them a camera sees."""

from __future__ import annotations

import asyncio
import dataclasses
from collections.abc import Callable, Sequence

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.wire.stream_answers import Answer, LandmarkRecord, LandmarksAre, Refused
from catoptra_protocol.wire.stream_requests import AskLandmarks
from catoptra_server.imaging.shot import CameraChannel
from catoptra_server.simulation import LandmarksSought, Request
from catoptra_server.simulation.sightings import Sighting


def answer_landmarks(
    request: AskLandmarks,
    known: Sequence[Landmark],
    *,
    answer: Callable[[Answer], None],
    post: Callable[[Request], None],
) -> None:
    """Answer at once, or as soon as the simulation has looked through the camera in question."""
    if request.robot is None and request.camera is None:
        answer(LandmarksAre(request.id, tuple(map(_record, known))))
        return
    loop = asyncio.get_running_loop()

    def reply(time_s: float, seen: tuple[Sighting, ...] | None) -> None:
        loop.call_soon_threadsafe(answer, _answer(request, time_s, seen))

    post(LandmarksSought(CameraChannel(request.robot or "", request.camera or ""), reply))


def nothing_shown(id_: int, robot: str, camera: str) -> Refused:
    """Return the refusal of a camera that is not there."""
    whose = f"robot {robot!r}" if robot else "the robot on the screen"
    which = f"camera {camera!r}" if camera else "camera"
    return Refused(id_, f"there is no {which} of {whose}")


def _answer(request: AskLandmarks, time_s: float, seen: tuple[Sighting, ...] | None) -> Answer:
    if seen is None:
        return nothing_shown(request.id, request.robot or "", request.camera or "")
    records = (
        dataclasses.replace(_record(one.landmark), pixel=one.pixel, visible=one.visible)
        for one in seen
    )
    return LandmarksAre(request.id, tuple(records), time_s)


def _record(landmark: Landmark) -> LandmarkRecord:
    fields = dataclasses.fields(Landmark)
    return LandmarkRecord(**{field.name: getattr(landmark, field.name) for field in fields})
