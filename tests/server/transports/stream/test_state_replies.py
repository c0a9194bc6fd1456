"""Replies to state requests, once the simulation has collected the state."""

from __future__ import annotations

import asyncio
import threading

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.messages import (
    bytes_from_message,
    json_from_message,
    reply_from_bytes,
    reply_from_json,
)
from catoptra_protocol.stream.replies import Error, NoteRecord, Reply, StateReply
from catoptra_protocol.stream.requests import GetStateRequest
from catoptra_protocol.usarsim.commands import Note
from catoptra_protocol.usarsim.reports import OdometryReading, RangeScanReading
from catoptra_server.serve.stream.replies import request_state
from catoptra_server.serve.stream.session import PendingRequests, ReportLines, RobotSession
from catoptra_server.simulation import Fault, SimulationEvent, StateRequested
from catoptra_server.simulation.robot import FleetState, PublishedNote, RobotSnapshot
from helpers.loopback import run_scenario

POSE = Pose.from_rpy((1.0, 2.0, -0.2), (0.0, 0.0, 0.5))
START = Pose.from_rpy((0.0, 0.0, -0.2))
STATE = FleetState(
    (RobotSnapshot("A", "USARBot.P2AT", POSE, START, (1.0, -1.0), True),),
    "A",
    (OdometryReading("Odometry", 1.0, 2.0, 0.5),),
    (PublishedNote(Note("ekf", '{"pose":[1.0,2.0,0.5]}'), 1.25),),
)


async def query_state(result: FleetState | Fault) -> Reply:
    """Reply to a request for robot A, with this result of the simulation's thread at 1.5 s."""
    replies: asyncio.Queue[Reply] = asyncio.Queue()

    def post(event: SimulationEvent) -> bool:
        assert isinstance(event, StateRequested)
        assert (event.client, event.robot) == (session, "A")
        thread = threading.Thread(target=event.reply, args=(1.5, result))
        thread.start()
        thread.join()
        return True

    session = RobotSession(post, on_fault=print)
    pending = PendingRequests(replies.put_nowait)
    request_state(GetStateRequest(7, "A"), pending.add(7), session, ReportLines())
    return await replies.get()


def test_state_has_robots_lines_and_notes() -> None:
    async def scenario() -> None:
        reply = await query_state(STATE)
        assert isinstance(reply, StateReply)
        assert (reply.id, reply.time_s, reply.robot) == (7, 1.5, "A")
        (robot,) = reply.robots
        assert robot.world_from_robot.position_m == (1.0, 2.0, -0.2)
        assert robot.world_from_start.position_m == (0.0, 0.0, -0.2)
        assert (robot.wheel_speeds_rad_s, robot.shares_control) == ((1.0, -1.0), True)
        assert reply.reports == ("SEN {Type Odometry} {Name Odometry} {Pose 1.0000,2.0000,0.5000}",)
        assert reply.notes == (NoteRecord("ekf", 1.25, '{"pose":[1.0,2.0,0.5]}'),)

    run_scenario(scenario())


def test_state_when_the_simulation_failed_is_an_error() -> None:
    async def scenario() -> None:
        assert await query_state(Fault("see the log")) == Error(7, "see the log")

    run_scenario(scenario())


def test_state_of_the_largest_fleet_fits_into_a_reply() -> None:
    async def scenario() -> None:
        robots = tuple(
            RobotSnapshot("r" * 256, "c" * 256, POSE, START, (1.1, -1.1), True) for _ in range(64)
        )
        scan = RangeScanReading(1.5, "Scanner", 0.0175, 3.1416, (20.0 / 3.0,) * 361)
        text = '{"x":"' + 8184 * "\\" + '"}'
        notes = tuple(PublishedNote(Note(f"{n}" * 64, text), 1.25) for n in range(8))
        reply = await query_state(FleetState(robots, "r" * 256, (scan,) * 16, notes))
        assert reply_from_bytes(bytes_from_message(reply)) == reply
        assert reply_from_json(json_from_message(reply)) == reply

    run_scenario(scenario())
