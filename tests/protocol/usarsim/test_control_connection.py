"""Conversations in memory, both roles."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.usarsim.commands import (
    Drive,
    GetConf,
    GetGeo,
    GetStartPoses,
    Init,
    StepCommand,
)
from catoptra_protocol.usarsim.control_connection import ControlClient, ControlServer
from catoptra_protocol.usarsim.grammar import Dialect
from catoptra_protocol.usarsim.reports import (
    CommandResult,
    Greeting,
    OdometryReading,
    SonarReadings,
    VehicleStatus,
)

GREETING = Greeting("BotDeathMatch", "field")


def greet_client() -> ControlServer:
    server = ControlServer()
    server.send(GREETING)
    return server


def test_conversation_in_memory_delivers_both_ways() -> None:
    server, client = ControlServer(), ControlClient()
    assert client.receive(server.send(GREETING)) == [GREETING]
    assert server.receive(client.send(GetStartPoses())) == [GetStartPoses()]
    assert server.receive(client.send(Init("P2AT"))) == [Init("P2AT")]
    assert server.receive(client.send(StepCommand(0.2))) == [StepCommand(0.2)]
    reports = [VehicleStatus(0.2, 1199), OdometryReading("O", 0.0, 0.0, 0.0)]
    data = b"".join(
        server.send(report) for report in (*reports, CommandResult(0.2, "Step", "Clock"))
    )
    assert client.receive(data) == [*reports, CommandResult(0.2, "Step", "Clock")]


def test_server_before_its_greeting_rejects_any_other_message() -> None:
    server = ControlServer()
    with pytest.raises(LocalProtocolError, match="greet"):
        server.receive(b"INIT\n")
    with pytest.raises(LocalProtocolError, match="VehicleStatus before the greeting"):
        server.send(VehicleStatus(0.0, 1200))
    assert server.send(GREETING).startswith(b"NFO")


def test_server_after_its_greeting_rejects_a_second_greeting() -> None:
    with pytest.raises(LocalProtocolError, match="once"):
        greet_client().send(GREETING)


def test_greeting_when_invalid_leaves_the_state_unchanged() -> None:
    server = ControlServer()
    with pytest.raises(LocalProtocolError, match="cannot be sent"):
        server.send(Greeting("A", "B}"))
    assert server.send(GREETING).startswith(b"NFO")


def test_server_accepts_commands_after_init_in_its_segment() -> None:
    data = (
        b"INIT {ClassName A}\r\nGETGEO {Type Robot}\r\nGETCONF {Type Robot}\r\nDRIVE {Left 1}\r\n"
    )
    expected = [Init("A"), GetGeo("Robot"), GetConf("Robot"), Drive(left=1.0)]
    assert greet_client().receive(data) == expected


def test_server_hands_over_every_init_since_the_first_may_be_refused() -> None:
    data = b"INIT {ClassName Unknown}\nINIT {ClassName A}\n"
    assert greet_client().receive(data) == [Init("Unknown"), Init("A")]


def test_server_drops_motion_commands_beyond_the_limits_and_continues() -> None:
    joints = b"".join(b"{J%d 1}" % i for i in range(257))
    data = b"DRIVE {Left 1e300}\nMULTIDRIVE " + joints + b"\nDRIVE {Left 1}\n"
    assert greet_client().receive(data) == [Drive(left=1.0)]


def test_server_ignores_stray_text() -> None:
    assert greet_client().receive(b"\r\n\0\0 hello {x}\nPING\n{}\n\xff\xfe\nGETSTARTPOSES\n") == [
        GetStartPoses()
    ]


def test_client_when_a_report_is_malformed_raises_after_earlier_reports_and_continues() -> None:
    client, odometry = ControlClient(), OdometryReading("O", 1.0, 2.0, 3.0)
    sound = b"SEN {Type Odometry} {Name O} {Pose 1,2,3}\r\n"
    malformed = b"STA {Type GroundVehicle} {Time 1}\r\n"
    assert client.receive(sound + malformed + sound) == [odometry]
    with pytest.raises(RemoteProtocolError, match="Battery"):
        client.receive(b"")
    assert client.receive(b"") == [odometry]


PIECES = st.sampled_from(
    [
        b"INIT {ClassName A} {Location 1 2 3}",
        b"DRIVE {Left 1.0}{Right -1}",
        b"GETCONF {Type Camera}",
        b"STEP {Time .1}",
        b"\r",
        b"\n",
        b"\r\n",
        b"{",
        b"}",
        b"\xff",
    ]
)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.lists(PIECES | st.binary(max_size=8)), st.integers(1, 9))
def test_server_in_any_segmentation_receives_the_same(pieces: list[bytes], size: int) -> None:
    data = b"".join(pieces)
    server = greet_client()
    cut = [c for i in range(0, len(data), size) for c in server.receive(data[i : i + size])]
    assert cut == greet_client().receive(data)


def test_conversation_in_udk_is_read_by_the_same_client() -> None:
    server, client = ControlServer(Dialect.UDK), ControlClient()
    assert client.receive(server.send(GREETING)) == [GREETING]
    sonars = server.send(SonarReadings(1.0, (("F1", 4.0), ("F2", 2.0))))
    assert client.receive(sonars) == [
        SonarReadings(1.0, (("F1", 4.0),)),
        SonarReadings(1.0, (("F2", 2.0),)),
    ]
    assert server.send(CommandResult(1.0, "Odometry", "O")) == b""
    assert client.receive(server.send(VehicleStatus(1.0, 9))) == [VehicleStatus(1.0, 9)]
