"""Replies to requests about a point of a camera's image."""

from __future__ import annotations

from functools import partial

from catoptra_protocol.stream.replies import Error, PixelReply, Reply
from catoptra_protocol.stream.requests import GetPixelRequest
from catoptra_server.frames.frame import CameraChannel
from catoptra_server.simulation import Fault, PixelRequested
from catoptra_server.simulation.sight import PixelView
from catoptra_server.transports.stream.landmark_replies import camera_not_found
from catoptra_server.transports.stream.pending_requests import PendingRequest
from catoptra_server.transports.stream.robot_session import RobotSession


def request_pixel(request: GetPixelRequest, pending: PendingRequest, session: RobotSession) -> None:
    """Have the simulation cast the ray through a point of an image, and reply then.

    Args:
        request: Request of the client.
        pending: Receives the reply.
        session: Client of the simulation.
    """

    def reply(time_s: float, view: PixelView | Fault | None) -> None:
        pending.reply_from_thread(partial(_pixel_reply, request, time_s, view))

    channel = CameraChannel(request.robot, request.camera)
    session.post(PixelRequested(session, channel, (request.u_px, request.v_px), reply))


def _pixel_reply(request: GetPixelRequest, time_s: float, view: PixelView | Fault | None) -> Reply:
    if view is None:
        return camera_not_found(request.id, request.robot, request.camera)
    if isinstance(view, Fault):
        return Error(request.id, view.reason)
    return PixelReply(
        id=request.id,
        time_s=time_s,
        theta_rad=view.theta_rad,
        azimuth_rad=view.azimuth_rad,
        range_m=view.range_m,
        object=view.object_name,
        bound_px=view.bound_px,
    )
