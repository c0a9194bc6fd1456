"""Replies to state requests: all robots, and the newest readings and notes of one."""

from __future__ import annotations

from functools import partial

from catoptra_protocol.stream.replies import Error, NoteRecord, Reply, RobotState, StateReply
from catoptra_protocol.stream.requests import GetStateRequest
from catoptra_server.simulation import Fault, StateRequested
from catoptra_server.simulation.robot import FleetState, RobotSnapshot
from catoptra_server.transports.stream.pending_requests import PendingRequest
from catoptra_server.transports.stream.report_lines import ReportLines
from catoptra_server.transports.stream.robot_session import RobotSession
from catoptra_server.transports.stream.server_info import transform_from_pose


def request_state(
    request: GetStateRequest,
    pending: PendingRequest,
    session: RobotSession,
    report_lines: ReportLines,
) -> None:
    """Have the simulation collect the state, and reply then.

    Args:
        request: Request of the client.
        pending: Receives the reply.
        session: Client of the simulation.
        report_lines: Makes the lines of the readings.
    """

    def reply(time_s: float, state: FleetState | Fault) -> None:
        pending.reply_from_thread(partial(_state_reply, request.id, time_s, state, report_lines))

    session.post(StateRequested(session, request.robot, reply))


def _state_reply(
    id_: int, time_s: float, state: FleetState | Fault, report_lines: ReportLines
) -> Reply:
    if isinstance(state, Fault):
        return Error(id_, state.reason)
    return StateReply(
        id=id_,
        time_s=time_s,
        robots=tuple(map(_robot_state, state.robots)),
        robot=state.robot,
        reports=report_lines.get(state.reports),
        notes=tuple(
            NoteRecord(published.note.name, published.time_s, published.note.text)
            for published in state.notes
        ),
    )


def _robot_state(snapshot: RobotSnapshot) -> RobotState:
    return RobotState(
        name=snapshot.name,
        class_name=snapshot.class_name,
        world_from_robot=transform_from_pose(snapshot.world_from_robot),
        world_from_start=transform_from_pose(snapshot.world_from_start),
        wheel_speeds_rad_s=snapshot.wheel_speeds_rad_s,
        shares_control=snapshot.shares_control,
    )
