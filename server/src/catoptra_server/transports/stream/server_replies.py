"""Replies to requests about the server itself, which need neither simulation nor rendering."""

from __future__ import annotations

from catoptra_protocol.stream.messages import SCHEMA_VERSION
from catoptra_protocol.stream.replies import CameraReply, Error, StatusReply
from catoptra_server.transports.stream.robot_session import RobotSession
from catoptra_server.transports.stream.server_info import ServerInfo, transform_from_pose
from catoptra_server.transports.stream.stream_context import StreamContext


def camera_reply(
    id_: int, camera: str, info: ServerInfo, robot: RobotSession
) -> CameraReply | Error:
    """Reply with the camera of a name, that of the client's robot first."""
    found = info.find_camera(camera, spawned_as=robot.class_name if robot.has_robot else "")
    if found is None:
        known = ", ".join(name for _, name in info.cameras) or "none"
        return Error(id_, f"no camera {camera[:80]!r}: this server's robots have {known}")
    (class_name, name), camera_info = found
    mount = transform_from_pose(camera_info.robot_from_mirror)
    model = dict(camera_info.camera_model)
    return CameraReply(id_, class_name, name, model, mount, camera_info.plan)


def status_reply(
    id_: int, context: StreamContext, robot: RobotSession, *, num_sent: int
) -> StatusReply:
    """Reply with the identity of the server, and its state for one client."""
    info = context.server_info
    return StatusReply(
        version=SCHEMA_VERSION,
        id=id_,
        server=info.server,
        world=info.world,
        class_names=info.class_names,
        clock=info.clock,
        num_clients=len(context.clients),
        has_robot=robot.has_robot,
        sent_frames=num_sent,
    )
