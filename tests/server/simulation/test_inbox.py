"""The inbox: bounded work of each client, departures first, newest wins where only it counts."""

from __future__ import annotations

import math
import threading
from functools import partial

import pytest

from catoptra_protocol.usarsim.commands import Command, Drive, GetStartPoses
from catoptra_server.frames.frame import IMAGE_PORT, CameraChannel, FrameRequested
from catoptra_server.simulation.events import (
    MAX_ALL_WAITING_STEP_S,
    MAX_WAITING,
    AccuracyTargetChanged,
    ClientDisconnected,
    CommandReceived,
    Fault,
    Inbox,
    ResetRequested,
    SharedRobotDriven,
    StepRequested,
    StopRequested,
)
from helpers.loopback import DEADLINE_S
from helpers.robots import FakeClient


def make_inbox(*, keep_order: bool = True) -> Inbox:
    return Inbox(keep_order=keep_order, monotonic=lambda: 0.0)


def take_commands(inbox: Inbox) -> list[Command]:
    commands = []
    while (event := inbox.take_work()) is not None:
        assert isinstance(event, CommandReceived)
        commands.append(event.command)
    return commands


def test_queue_when_full_says_so_and_resumes_once_half_empty() -> None:
    inbox, client, other = make_inbox(), FakeClient(), FakeClient()
    event = CommandReceived(client, GetStartPoses())
    assert [inbox.post(event) for _ in range(MAX_WAITING)] == [True] * (MAX_WAITING - 1) + [False]
    assert inbox.post(CommandReceived(other, GetStartPoses()))
    for taken in range(1, MAX_WAITING + 1):
        inbox.take_work()
        assert client.num_resumes == (taken >= MAX_WAITING // 2)
    assert other.num_resumes == 0


def test_work_of_a_departed_client_is_dropped() -> None:
    inbox, gone, other = make_inbox(), FakeClient(), FakeClient()
    for client in (gone, other, gone):
        inbox.post(CommandReceived(client, GetStartPoses()))
    inbox.post(ClientDisconnected(gone))
    assert inbox.has_urgent
    assert inbox.take_urgent() == [ClientDisconnected(gone)]
    assert inbox.take_work() == CommandReceived(other, GetStartPoses())
    assert inbox.take_work() is None


@pytest.mark.parametrize(
    ("older", "newer", "is_superseded"),
    [
        (Drive(1.0, 1.0), Drive(2.0, 2.0), True),
        (Drive(1.0, None), Drive(2.0, 2.0), True),
        (Drive(1.0, 1.0), Drive(2.0, None), False),
        (Drive(1.0, 1.0, light=True), Drive(2.0, 2.0), False),
        (Drive(1.0, 1.0, normalized=True), Drive(2.0, 2.0), True),
        (GetStartPoses(), Drive(2.0, 2.0), False),
    ],
)
def test_drive_is_superseded_by_one_that_sets_as_much(
    older: Command, newer: Command, is_superseded: bool
) -> None:
    inbox, client, other = make_inbox(), FakeClient(), FakeClient()
    inbox.post(CommandReceived(client, older))
    inbox.post(CommandReceived(other, GetStartPoses()))
    inbox.post(CommandReceived(client, newer))
    assert (older not in take_commands(inbox)) is is_superseded


def test_target_when_superseded_is_answered() -> None:
    inbox, client, replies = make_inbox(), FakeClient(), list[object]()
    for budget_ms in (1.0, 2.0):
        reply = partial(lambda ms, *reply: replies.append((ms, reply)), budget_ms)
        inbox.post(AccuracyTargetChanged(client, "", None, budget_ms, reply))
    assert replies == [(1.0, (Fault("superseded by a newer request"), ""))]
    event = inbox.take_work()
    assert isinstance(event, AccuracyTargetChanged)
    assert event.budget_ms == 2.0
    assert inbox.take_work() is None


@pytest.mark.parametrize(
    ("robot", "newer", "is_superseded"),
    [("R", Drive(2.0, 2.0), True), ("R", Drive(2.0, None), False), ("S", Drive(2.0, 2.0), False)],
)
def test_drive_of_a_shared_robot_is_superseded_by_one_that_sets_as_much(
    robot: str, newer: Drive, is_superseded: bool
) -> None:
    inbox, client = make_inbox(), FakeClient()
    inbox.post(SharedRobotDriven(client, "R", Drive(1.0, 1.0), lambda reason: None))
    inbox.post(SharedRobotDriven(client, robot, newer, lambda reason: None))
    taken = [inbox.take_work(), inbox.take_work()]
    assert (None in taken) is is_superseded


def test_drives_of_a_shared_robot_when_superseded_have_the_reply_of_the_newest() -> None:
    inbox, client, replies = make_inbox(), FakeClient(), list[tuple[int, str]]()
    for number in range(3):
        reply = partial(lambda number, reason: replies.append((number, reason)), number)
        inbox.post(SharedRobotDriven(client, "R", Drive(float(number), 1.0), reply))
    event = inbox.take_work()
    assert isinstance(event, SharedRobotDriven)
    assert (event.drive.left, inbox.take_work()) == (2.0, None)
    event.reply("not shared")
    assert replies == [(0, "not shared"), (1, "not shared"), (2, "not shared")]


def test_target_of_another_value_waits_beside_the_older() -> None:
    inbox, client = make_inbox(), FakeClient()
    inbox.post(AccuracyTargetChanged(client, "", 1.0, None, lambda *reply: None))
    inbox.post(AccuracyTargetChanged(client, "", None, 5.0, lambda *reply: None))
    assert inbox.take_work() is not None
    assert inbox.take_work() is not None


def step(client: FakeClient, duration_s: float) -> StepRequested:
    return StepRequested(client, duration_s, lambda result: None)


def take_refusals(inbox: Inbox) -> list[bool]:
    refusals = []
    while (event := inbox.take_work()) is not None:
        assert isinstance(event, StepRequested)
        refusals.append(bool(event.refusal))
    return refusals


def test_steps_when_too_long_in_all_are_refused_in_their_turn() -> None:
    inbox, clients = make_inbox(), [FakeClient() for _ in range(5)]
    assert inbox.post(step(clients[0], 40.0))
    for duration_s in (40.0, 20.0, 1.0, 0.0):
        inbox.post(step(clients[0], duration_s))
    assert take_refusals(inbox) == [False, True, False, True, False]
    # Taken steps wait no longer; the limit of all holds beside that of each.
    for client in clients:
        inbox.post(step(client, 59.0))
    num_admitted = math.floor(MAX_ALL_WAITING_STEP_S / 59.0)
    assert take_refusals(inbox).count(False) == num_admitted


def test_steps_of_a_departed_client_wait_no_longer() -> None:
    inbox, gone, other = make_inbox(), FakeClient(), FakeClient()
    inbox.post(step(gone, 60.0))
    inbox.post(step(FakeClient(), 60.0))
    inbox.post(ClientDisconnected(gone))
    inbox.post(step(other, 60.0))
    assert take_refusals(inbox) == [False, False]


@pytest.mark.parametrize("duration_s", [math.nan, -1.0, math.inf])
def test_step_without_a_duration_does_not_count(duration_s: float) -> None:
    inbox, client = make_inbox(), FakeClient()
    inbox.post(step(client, duration_s))
    inbox.post(step(client, 60.0))
    refusals = take_refusals(inbox)
    assert refusals[1] is False


def test_frame_requests_of_a_channel_are_one() -> None:
    inbox, camera = make_inbox(), CameraChannel("R", "")
    for number in (3.0, 5.0, 4.0):
        inbox.post(FrameRequested(number, camera))
    inbox.post(FrameRequested(math.inf, IMAGE_PORT))
    assert inbox.take_urgent() == [FrameRequested(5.0, camera), FrameRequested(math.inf)]
    assert inbox.take_urgent() == []


def test_urgent_events_come_in_the_order_of_arrival_and_frame_requests_last() -> None:
    inbox, client = make_inbox(), FakeClient()
    for event in (FrameRequested(1, IMAGE_PORT), ClientDisconnected(client), StopRequested()):
        inbox.post(event)
    assert inbox.has_urgent
    expected = [ClientDisconnected(client), StopRequested(), FrameRequested(1, IMAGE_PORT)]
    assert inbox.take_urgent() == expected
    assert not inbox.has_urgent


@pytest.mark.parametrize("for_work", [True, False])
def test_work_ends_the_wait_only_if_there_is_time_for_it(for_work: bool) -> None:
    inbox, has_ended = make_inbox(), threading.Event()

    def wait() -> None:
        inbox.wait(None, for_work=for_work)
        has_ended.set()

    thread = threading.Thread(target=wait)
    thread.start()
    assert not inbox.has_work
    inbox.post(CommandReceived(FakeClient(), GetStartPoses()))
    assert inbox.has_work
    if not for_work:
        assert not has_ended.is_set()
        inbox.post(FrameRequested(1, IMAGE_PORT))
    assert has_ended.wait(DEADLINE_S)
    thread.join()


def test_work_that_arrives_after_a_mark_is_left() -> None:
    inbox, client = make_inbox(), FakeClient()
    inbox.post(CommandReceived(client, GetStartPoses()))
    mark = inbox.newest_arrival
    inbox.post(CommandReceived(client, GetStartPoses()))
    assert inbox.take_work(arrived_by=mark) is not None
    assert inbox.take_work(arrived_by=mark) is None
    assert inbox.take_work() is not None


def test_client_above_its_share_waits_behind_the_others() -> None:
    for keep_order in (False, True):
        inbox, heavy, light = make_inbox(keep_order=keep_order), FakeClient(), FakeClient()
        for client in (heavy, heavy, light):
            inbox.post(CommandReceived(client, GetStartPoses()))
        inbox.take_work()
        inbox.charge(heavy, 1.0)
        event = inbox.take_work()
        assert event is not None
        assert event.client is (heavy if keep_order else light)


def test_client_above_its_share_that_leaves_waits_behind_nobody() -> None:
    inbox, leaving, successor = make_inbox(keep_order=False), FakeClient(), FakeClient()
    inbox.post(CommandReceived(leaving, GetStartPoses()))
    inbox.take_work()
    inbox.charge(leaving, 1.0)
    last = ResetRequested(leaving, lambda: None, is_last=True)
    for event in (CommandReceived(leaving, GetStartPoses()), last):
        inbox.post(event)
    inbox.post(CommandReceived(successor, GetStartPoses()))
    clients = []
    while (work := inbox.take_work()) is not None:
        clients.append(work.client)
    assert clients == [leaving, leaving, successor]
