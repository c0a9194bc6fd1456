"""Replies to landmark requests: true positions, and projections into a camera."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.stream.replies import Error, LandmarkRecord, LandmarksReply, Reply
from catoptra_protocol.stream.requests import GetLandmarksRequest
from catoptra_server.frames.frame import CameraChannel
from catoptra_server.simulation import Fault, LandmarksRequested
from catoptra_server.simulation.sight import LandmarkVisibility
from catoptra_server.transports.stream.pending_requests import PendingRequest
from catoptra_server.transports.stream.robot_session import RobotSession


def landmarks_reply(id_: int, landmarks: Sequence[Landmark]) -> LandmarksReply:
    """Reply with the true positions, without a camera's view."""
    return LandmarksReply(id_, tuple(map(_record_from_landmark, landmarks)))


def request_projections(
    request: GetLandmarksRequest, pending: PendingRequest, session: RobotSession
) -> None:
    """Have the simulation project the landmarks into a camera, and reply then.

    Args:
        request: Request with a robot or a camera, or with two empty names.
        pending: Receives the reply.
        session: Client of the simulation.
    """

    def reply(time_s: float, result: tuple[LandmarkVisibility, ...] | Fault | None) -> None:
        pending.reply_from_thread(partial(_projections_reply, request, time_s, result))

    channel = CameraChannel(request.robot or "", request.camera or "")
    session.post(LandmarksRequested(session, channel, reply))


def camera_not_found(id_: int, robot: str, camera: str) -> Error:
    """Error for a camera that does not exist, with its name."""
    owner = f"robot {robot!r}" if robot else "the robot on the image port"
    name = f"camera {camera!r}" if camera else "camera"
    return Error(id_, f"there is no {name} of {owner}")


def _projections_reply(
    request: GetLandmarksRequest,
    time_s: float,
    result: tuple[LandmarkVisibility, ...] | Fault | None,
) -> Reply:
    if result is None:
        return camera_not_found(request.id, request.robot or "", request.camera or "")
    if isinstance(result, Fault):
        return Error(request.id, result.reason)
    records = (
        dataclasses.replace(
            _record_from_landmark(one.landmark), pixel=one.pixel, visible=one.is_visible
        )
        for one in result
    )
    return LandmarksReply(request.id, tuple(records), time_s)


def _record_from_landmark(landmark: Landmark) -> LandmarkRecord:
    fields = dataclasses.fields(Landmark)
    return LandmarkRecord(**{field.name: getattr(landmark, field.name) for field in fields})
