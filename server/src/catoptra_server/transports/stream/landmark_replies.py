"""Replies to landmark requests: true positions, and projections into a camera."""

from __future__ import annotations

import asyncio
import dataclasses
from collections.abc import Callable, Sequence

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.stream.replies import Error, LandmarkRecord, LandmarksReply, Reply
from catoptra_protocol.stream.requests import GetLandmarksRequest
from catoptra_server.frames.frame_request import CameraChannel
from catoptra_server.simulation import LandmarksRequested, SimulationEvent
from catoptra_server.simulation.landmark_visibility import LandmarkVisibility


def handle_landmarks_request(
    request: GetLandmarksRequest,
    landmarks: Sequence[Landmark],
    *,
    send_reply: Callable[[Reply], None],
    post: Callable[[SimulationEvent], None],
) -> None:
    """Reply at once, or with a camera as soon as the simulation has projected the landmarks.

    Args:
        request: Request of the client.
        landmarks: True landmarks of the world.
        send_reply: Sends the reply; called on the loop.
        post: Hands an event to the simulation.
    """
    # True positions never change, so no event is needed.
    if request.robot is None and request.camera is None:
        send_reply(LandmarksReply(request.id, tuple(map(_record_from_landmark, landmarks))))
        return
    # The simulation replies in its own thread; sockets belong to the loop.
    loop = asyncio.get_running_loop()

    def reply(time_s: float, visibilities: tuple[LandmarkVisibility, ...] | None) -> None:
        loop.call_soon_threadsafe(send_reply, _landmarks_reply(request, time_s, visibilities))

    post(LandmarksRequested(CameraChannel(request.robot or "", request.camera or ""), reply))


def camera_not_found(id_: int, robot: str, camera: str) -> Error:
    """Error for a camera that does not exist, with its name."""
    owner = f"robot {robot!r}" if robot else "the robot on the image port"
    name = f"camera {camera!r}" if camera else "camera"
    return Error(id_, f"there is no {name} of {owner}")


def _landmarks_reply(
    request: GetLandmarksRequest,
    time_s: float,
    visibilities: tuple[LandmarkVisibility, ...] | None,
) -> Reply:
    if visibilities is None:
        return camera_not_found(request.id, request.robot or "", request.camera or "")
    records = (
        dataclasses.replace(
            _record_from_landmark(one.landmark), pixel=one.pixel, visible=one.is_visible
        )
        for one in visibilities
    )
    return LandmarksReply(request.id, tuple(records), time_s)


def _record_from_landmark(landmark: Landmark) -> LandmarkRecord:
    fields = dataclasses.fields(Landmark)
    return LandmarkRecord(**{field.name: getattr(landmark, field.name) for field in fields})
