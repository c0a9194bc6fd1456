"""One robot of a client, by a scripted simulation: exactly one reply to each request."""

from __future__ import annotations

import asyncio
import dataclasses
import threading
from dataclasses import dataclass, field

import pytest

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.stream.replies import Error, Ok, Reply, SensorReports
from catoptra_protocol.stream.requests import DriveRequest, PublishRequest, SpawnRequest
from catoptra_protocol.usarsim.commands import Drive, Init, Note, ShareControl
from catoptra_protocol.usarsim.reports import (
    InitResult,
    OdometryReading,
    Report,
    VehicleStatus,
    line_from_report,
)
from catoptra_server.serve.stream import session as session_module
from catoptra_server.serve.stream.session import (
    INTERNAL_FAULT,
    PendingRequests,
    ReportLines,
    RobotSession,
)
from catoptra_server.simulation.events import (
    ClientDisconnected,
    CommandReceived,
    NotePublished,
    ResetRequested,
    SharedRobotDriven,
    SimulationEvent,
    StepRequested,
    StepResult,
)


async def test_request_when_replied_twice_has_the_first_reply_only() -> None:
    sent: list[Reply] = []
    requests = PendingRequests(sent.append)
    first, second = requests.add(1), requests.add(1)  # ids of a client may repeat
    first.reply(Ok(1))
    first.reject("too late")
    assert (sent, len(requests)) == ([Ok(1)], 1)
    second.reject("refused")
    assert (sent[1:], len(requests)) == ([Error(1, "refused")], 0)


async def test_requests_when_all_are_rejected_have_their_ids_in_order() -> None:
    sent: list[Reply] = []
    requests = PendingRequests(sent.append)
    late = [requests.add(id_) for id_ in (3, 1, 2)]
    requests.reject_all("removed")
    assert sent == [Error(id_, "removed") for id_ in (3, 1, 2)]
    for request in late:
        request.reply(Ok(request.id))
    assert len(sent) == 3


async def test_requests_when_cancelled_have_no_reply() -> None:
    sent: list[Reply] = []
    requests = PendingRequests(sent.append)
    request = requests.add(1)
    requests.cancel_all()
    request.reply(Ok(1))
    assert (sent, len(requests)) == ([], 0)


async def test_request_when_rejected_by_its_id_is_the_newest_of_it_or_none() -> None:
    sent: list[Reply] = []
    requests = PendingRequests(sent.append)
    oldest, newest = requests.add(1), requests.add(1)
    requests.reject(1, "a fault")
    newest.reply(Ok(1))
    oldest.reply(Ok(1))
    requests.reject(2, "not pending")
    assert sent == [Error(1, "a fault"), Ok(1), Error(2, "not pending")]


async def test_reply_of_a_thread_is_made_on_the_loop(caplog: pytest.LogCaptureFixture) -> None:
    sent: asyncio.Queue[Reply] = asyncio.Queue()
    requests = PendingRequests(sent.put_nowait)
    request, failing = requests.add(1), requests.add(2)
    makers: list[threading.Thread] = []

    def make_reply() -> Reply:
        makers.append(threading.current_thread())
        return Ok(1)

    def raise_error() -> Reply:
        raise ZeroDivisionError

    await asyncio.to_thread(request.reply_from_thread, make_reply)
    await asyncio.to_thread(failing.reply_from_thread, raise_error)
    assert await sent.get() == Ok(1)
    assert makers == [threading.current_thread()]
    assert await sent.get() == Error(2, INTERNAL_FAULT)
    assert "ZeroDivisionError" in caplog.text


ODOMETRY = OdometryReading("Odometry", 1.0, 2.0, 0.5)
STATUS = VehicleStatus(1.0, 100)


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Report]:
    """Reports whose lines were made."""
    reports: list[Report] = []
    make_line = session_module.line_from_report

    def record(report: Report) -> bytes:
        reports.append(report)
        return make_line(report)

    monkeypatch.setattr(session_module, "line_from_report", record)
    return reports


def test_lines_are_those_of_the_control_port_without_ends() -> None:
    lines = ReportLines().get([ODOMETRY, STATUS])
    assert "".join(f"{line}\r\n" for line in lines).encode() == b"".join(
        map(line_from_report, [ODOMETRY, STATUS])
    )
    assert [line.split()[0] for line in lines] == ["SEN", "STA"]


def test_line_of_the_same_report_is_made_once(made: list[Report]) -> None:
    lines = ReportLines()
    assert lines.get([ODOMETRY, STATUS]) == lines.get([ODOMETRY, STATUS])
    assert made == [ODOMETRY, STATUS]


def test_line_of_another_report_is_made_though_equal(made: list[Report]) -> None:
    lines = ReportLines()
    for x_m in range(50):
        # Each report is dropped at once: a later one may have its address.
        report = dataclasses.replace(ODOMETRY, x_m=float(x_m))
        assert f"{x_m}.0000," in lines.get([report])[0]
    assert len(made) == 50


def test_lines_when_many_are_read_are_limited() -> None:
    lines = ReportLines()
    for number in range(1000):
        lines.get([dataclasses.replace(ODOMETRY, x_m=float(number))])
    assert len(lines) == 256


def test_report_without_a_valid_line_is_left_out(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(report: Report) -> bytes:
        raise LocalProtocolError("not finite")

    monkeypatch.setattr(session_module, "line_from_report", refuse)
    assert ReportLines().get([ODOMETRY]) == ()
    assert "not sent: not finite" in caplog.text


SPAWN = SpawnRequest(1, "USARBot.OmniP2AT", "Mine", None, "Centre")


@dataclass
class Recorder:
    """A session, and all that it posts, sends and reports."""

    has_room: bool = True
    posted: list[SimulationEvent] = field(default_factory=list)
    sent: list[Reply] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.pending = PendingRequests(self.sent.append)
        self.session = RobotSession(self._post, on_fault=self.faults.append)

    def _post(self, event: SimulationEvent) -> bool:
        self.posted.append(event)
        return self.has_room

    async def spawn(self, id_: int = 1) -> None:
        """Spawn a robot, with two reports."""
        self.session.spawn(SPAWN, self.pending.add(id_))
        self.session.finish_init(InitResult(0.0, "Mine"))
        self.session.deliver([ODOMETRY, STATUS])
        await settle()

    def answer_reset(self) -> None:
        """Reply to the newest event, a reset."""
        reset = self.posted[-1]
        assert isinstance(reset, ResetRequested)
        reset.reply()


async def settle() -> None:
    """Run what other threads have scheduled on the loop."""
    await asyncio.sleep(0)


def words(reply: Reply) -> list[str]:
    """First words of the reports of a reply."""
    assert isinstance(reply, SensorReports)
    return [line.split()[0] for line in reply.reports]


async def test_spawn_when_confirmed_is_answered_with_the_first_readings() -> None:
    recorder = Recorder()
    session = recorder.session
    session.spawn(SPAWN, recorder.pending.add(1))
    init = Init("USARBot.OmniP2AT", "Mine", None, (0.0, 0.0, 0.0), "Centre")
    assert recorder.posted == [CommandReceived(session, init)]
    assert (session.has_robot, session.expects_robot) == (False, True)
    session.finish_init(InitResult(0.0, "Mine", (1.0, 2.0, 0.0)))
    await settle()
    assert (session.has_robot, session.class_name) == (True, "USARBot.OmniP2AT")
    assert recorder.sent == []
    session.deliver([ODOMETRY, STATUS])
    await settle()
    (reply,) = recorder.sent
    assert words(reply) == ["SEN", "STA"]
    assert isinstance(reply, SensorReports)
    assert (reply.id, reply.moved_to) == (1, (1.0, 2.0, 0.0))


async def test_spawn_when_rejected_has_the_reason_and_may_be_repeated() -> None:
    recorder = Recorder()
    recorder.session.spawn(SPAWN, recorder.pending.add(1))
    recorder.session.finish_init(InitResult(0.0, failure="there is no class 'X'"))
    await settle()
    assert recorder.sent == [Error(1, "there is no class 'X'")]
    await recorder.spawn(2)
    assert words(recorder.sent[1]) == ["SEN", "STA"]


async def test_spawn_when_its_first_reading_fails_is_rejected_after_the_confirmation() -> None:
    recorder = Recorder()
    recorder.session.spawn(SPAWN, recorder.pending.add(1))
    recorder.session.finish_init(InitResult(0.0, "Mine"))
    recorder.session.finish_init(InitResult(0.0, failure="an internal fault"))
    recorder.session.deliver([STATUS])  # of no spawn
    await settle()
    assert recorder.sent == [Error(1, "an internal fault")]
    assert not recorder.session.has_robot


@pytest.mark.parametrize(
    ("spawn", "reason"),
    [
        (SpawnRequest(2, "a}b", None, None, "Centre"), "braces"),
        (SpawnRequest(2, "P2AT", "a" * 257, None, "Centre"), "256 characters"),
        (SpawnRequest(2, "P2AT", "a\x1b[2J", None, "Centre"), "control characters"),
        (SpawnRequest(2, "P2AT", None, None, "a\nDRIVE"), "control characters"),
    ],
)
async def test_spawn_when_a_name_is_impossible_has_the_reason(
    spawn: SpawnRequest, reason: str
) -> None:
    recorder = Recorder()
    recorder.session.spawn(spawn, recorder.pending.add(1))
    (reply,) = recorder.sent
    assert isinstance(reply, Error)
    assert reason in reply.reason
    assert not recorder.posted


async def test_spawn_when_there_is_or_will_be_a_robot_is_an_error() -> None:
    recorder = Recorder()
    recorder.session.spawn(SPAWN, recorder.pending.add(1))
    recorder.session.spawn(SPAWN, recorder.pending.add(2))
    (reply,) = recorder.sent
    assert isinstance(reply, Error)
    assert (reply.id, "reset first" in reply.reason) == (2, True)
    recorder.session.reset(recorder.pending.add(3))
    recorder.session.spawn(SPAWN, recorder.pending.add(4))
    assert len(recorder.sent) == 1


async def test_spawn_and_reset_and_spawn_when_sent_at_once_are_all_answered() -> None:
    recorder = Recorder()
    session = recorder.session
    session.spawn(SPAWN, recorder.pending.add(1))
    session.reset(recorder.pending.add(2))
    reset = recorder.posted[-1]
    session.spawn(SPAWN, recorder.pending.add(3))
    assert isinstance(reset, ResetRequested)
    # In the order of the commands, as the simulation executes them.
    session.finish_init(InitResult(0.0, "Mine"))
    session.deliver([STATUS])
    reset.reply()
    session.finish_init(InitResult(0.0, "Mine2"))
    session.deliver([ODOMETRY])
    await settle()
    assert [getattr(reply, "id", 0) for reply in recorder.sent] == [1, 2, 3]
    assert session.has_robot
    assert words(session.readings_reply(4)) == ["SEN"]


async def test_reset_removes_the_robot_at_once_and_is_answered_after_the_removal() -> None:
    recorder = Recorder()
    await recorder.spawn()
    recorder.session.reset(recorder.pending.add(2))
    assert not recorder.session.has_robot
    recorder.session.deliver([STATUS])  # of the robot that is being removed
    await settle()
    assert len(recorder.sent) == 1
    recorder.answer_reset()
    await settle()
    assert recorder.sent[1:] == [Ok(2)]
    assert words(recorder.session.readings_reply(3)) == []


async def test_step_is_answered_with_the_whole_cycle_and_its_end() -> None:
    recorder = Recorder()
    await recorder.spawn()
    recorder.session.step(0.2, recorder.pending.add(2))
    step = recorder.posted[-1]
    assert isinstance(step, StepRequested)
    assert step.duration_s == 0.2
    step.reply(StepResult(1.2, (OdometryReading("Odometry", 7.0, 2.0, 0.5),)))
    await settle()
    assert words(recorder.sent[1]) == ["SEN", "RES"]
    (odometry, _) = recorder.session.readings_reply(3).reports  # type: ignore[union-attr] # reports
    assert "7.0" in odometry


async def test_step_when_it_fails_is_an_error_with_the_reason() -> None:
    recorder = Recorder()
    recorder.session.step(0.2, recorder.pending.add(2))
    step = recorder.posted[-1]
    assert isinstance(step, StepRequested)
    step.reply(StepResult(0.0, failure="no step: the clock is real time"))
    await settle()
    assert recorder.sent == [Error(2, "no step: the clock is real time")]


async def test_drive_is_posted() -> None:
    recorder = Recorder()
    recorder.session.drive(DriveRequest(1, 1.0, None, True))
    expected = CommandReceived(recorder.session, Drive(1.0, None, True))
    assert recorder.posted == [expected]


async def test_queue_when_full_has_no_room_until_the_simulation_resumes() -> None:
    recorder = Recorder(has_room=False)
    recorder.session.drive(DriveRequest(1, 1.0, None, True))
    assert not recorder.session.has_room
    recorder.session.resume_reading()
    await settle()
    assert recorder.session.has_room


async def test_fault_of_the_robot_closes_the_session_and_later_replies_are_dropped() -> None:
    recorder = Recorder()
    await recorder.spawn()
    recorder.session.disconnect("a fault removed the robot")
    recorder.session.deliver([STATUS])
    await settle()
    assert recorder.faults == ["a fault removed the robot"]
    assert recorder.posted[-1] == ClientDisconnected(recorder.session)
    recorder.session.close()
    assert sum(isinstance(event, ClientDisconnected) for event in recorder.posted) == 1


async def test_reply_when_it_cannot_be_handled_is_a_fault(caplog: pytest.LogCaptureFixture) -> None:
    recorder = Recorder()
    recorder.session.finish_init(InitResult(0.0, "Nobody's"))  # without a spawn
    await settle()
    assert len(recorder.faults) == 1
    assert "IndexError" in caplog.text


async def test_spawn_when_confirmed_has_the_name_of_the_robot_in_its_reply() -> None:
    recorder = Recorder()
    await recorder.spawn()
    recorder.session.step(0.1, recorder.pending.add(2))
    step = recorder.posted[-1]
    assert isinstance(step, StepRequested)
    step.reply(StepResult(0.1, (ODOMETRY,)))
    await settle()
    names = [reply.robot for reply in recorder.sent if isinstance(reply, SensorReports)]
    assert names == ["Mine", ""]


@pytest.mark.parametrize(
    ("reason", "reply"),
    [("", Ok(2)), ("the owner does not share", Error(2, "the owner does not share"))],
)
async def test_drive_of_a_shared_robot_has_the_outcome_as_reply(reason: str, reply: Reply) -> None:
    recorder = Recorder()
    request = DriveRequest(2, 1.0, None, True, "Shared")
    recorder.session.drive_by_name(request, recorder.pending.add(2))
    (event,) = recorder.posted
    assert isinstance(event, SharedRobotDriven)
    assert (event.client, event.robot) == (recorder.session, "Shared")
    assert event.drive == Drive(1.0, None, normalized=True)
    assert recorder.sent == []
    event.reply(reason)
    await settle()
    assert recorder.sent == [reply]


@pytest.mark.parametrize(("reason", "reply"), [("", Ok(2)), ("8 names", Error(2, "8 names"))])
async def test_note_has_the_outcome_as_reply(reason: str, reply: Reply) -> None:
    recorder = Recorder()
    recorder.session.publish(PublishRequest(2, "ekf", "{}"), recorder.pending.add(2))
    (event,) = recorder.posted
    assert isinstance(event, NotePublished)
    assert event.note == Note("ekf", "{}")
    event.reply(reason)
    await settle()
    assert recorder.sent == [reply]


async def test_sharing_is_posted_as_a_command() -> None:
    recorder = Recorder()
    recorder.session.share_control(True)
    assert recorder.posted == [CommandReceived(recorder.session, ShareControl(True))]
