"""Limits of connections, of their time on the event loop, and of their acceptance."""

from __future__ import annotations

import asyncio
import resource
import threading
import time
from functools import partial

import pytest

from catoptra_server.serve.limits import LoopCalls, LoopShare, fit_connections, limits_table
from helpers.configs import REPOSITORY


@pytest.mark.parametrize(
    ("soft_limit", "share", "descriptors_each", "fitting"),
    [
        (1024, 0.25, 1, 64),
        (300, 0.25, 1, 50),
        (300, 0.5, 3, 33),
        (100, 0.25, 1, 1),
        (20, 0.25, 1, 1),
        (resource.RLIM_INFINITY, 0.25, 1, 64),
    ],
)
def test_limit_fits_into_the_share_of_the_descriptors(
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    soft_limit: int,
    share: float,
    descriptors_each: int,
    fitting: int,
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (soft_limit, soft_limit))
    limit = fit_connections(64, share=share, descriptors_each=descriptors_each, name="image")
    assert limit == fitting
    assert (f"the image port has {fitting} connections" in caplog.text) is (fitting < 64)


def test_specification_has_the_table_of_limits() -> None:
    assert limits_table() in (REPOSITORY / "protocol/SPEC.md").read_text(encoding="utf-8")


class Clock:
    """Time that passes by assignment."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_single_command_waits_for_nothing() -> None:
    account = LoopShare().open_account()
    with account.charge_block():
        pass
    assert account.remaining_wait_s == 0.0


def test_block_is_charged_with_its_processor_time() -> None:
    account = LoopShare(0.01).open_account()
    with account.charge_block():
        end_s = time.thread_time() + 0.05
        while time.thread_time() < end_s:
            pass
    assert account.remaining_wait_s > 0.0


@pytest.mark.parametrize(
    ("num_connections", "is_dialogue"), [(1, False), (2, False), (64, False), (2, True), (64, True)]
)
def test_flood_of_any_number_of_connections_takes_the_share_of_the_time(
    num_connections: int, is_dialogue: bool
) -> None:
    clock = Clock()
    share = LoopShare(0.3, 0.3, monotonic=clock)
    accounts = [share.open_account() for _ in range(num_connections)]
    begin_s, used_s = clock.now_s, 0.0
    while clock.now_s < begin_s + 8.0:
        ready = [one for one in accounts if one.remaining_wait_s <= 0.0]
        for account in ready:
            account.charge(0.0005, is_dialogue=is_dialogue)
            clock.now_s += 0.0005
            used_s += 0.0005
        clock.now_s += 0.0005
    # The burst at the begin comes on top.
    assert used_s / 8.0 == pytest.approx(0.3, rel=0.2)


def test_clients_below_an_equal_part_wait_for_nothing_beside_floods() -> None:
    clock = Clock()
    share = LoopShare(monotonic=clock)
    floods, viewers = ([share.open_account() for _ in range(count)] for count in (8, 8))
    for _ in range(3000):
        clock.now_s += 0.001
        for flood in floods:
            if flood.remaining_wait_s <= 0.0:
                flood.charge(0.005, is_dialogue=True)
        for viewer in viewers:
            viewer.charge(0.00001, is_dialogue=True)
        assert not any(viewer.remaining_wait_s for viewer in viewers)
    assert all(flood.remaining_wait_s > 0.0 for flood in floods)


def test_dialogue_alone_waits_for_nothing() -> None:
    clock = Clock()
    account = LoopShare(monotonic=clock).open_account()
    for _ in range(100):
        account.charge(0.05, is_dialogue=True)
        clock.now_s += 0.05
        assert account.remaining_wait_s == 0.0


def test_clients_however_many_wait_for_nothing_while_the_loop_has_time() -> None:
    clock = Clock()
    share = LoopShare(monotonic=clock)
    viewers = [share.open_account() for _ in range(64)]
    for _ in range(300):
        clock.now_s += 0.02
        for viewer in viewers:
            viewer.charge(0.0001, is_dialogue=True)
        assert not any(viewer.remaining_wait_s for viewer in viewers)


def test_wait_after_an_expensive_chunk_is_limited() -> None:
    account = LoopShare(monotonic=Clock()).open_account()
    account.charge(60.0)
    assert account.remaining_wait_s == 1.0


def test_dialogue_does_not_wait_for_what_floods_have_used() -> None:
    clock = Clock()
    share = LoopShare(monotonic=clock)
    flood, dialogue = share.open_account(), share.open_account()
    flood.charge(10.0)
    dialogue.charge(0.3, is_dialogue=True)
    assert dialogue.remaining_wait_s == 0.0


def test_use_is_forgotten() -> None:
    clock = Clock()
    account = LoopShare(monotonic=clock).open_account()
    account.charge(1.0)
    assert account.remaining_wait_s > 0.0
    clock.now_s += 20.0
    assert account.remaining_wait_s == 0.0


def test_connections_of_another_machine_share_an_account_and_those_of_this_one_do_not() -> None:
    share = LoopShare()
    accounts = [share.open_account(f"192.0.2.7:{port}") for port in (1, 2)]
    assert accounts[0] is accounts[1]
    assert share.open_account("::ffff:192.0.2.7:3") is accounts[0]
    assert share.open_account("192.0.2.8:1") is not accounts[0]
    for address in ("127.0.0.1:1", "::1:1", "::ffff:127.0.0.1:1"):
        assert share.open_account(address) is not share.open_account(address)


NUM_CALLS = 20_000


async def test_calls_of_a_thread_arrive_in_order_and_none_is_lost() -> None:
    received, end = list[int](), asyncio.Event()
    calls = LoopCalls()

    def produce() -> None:
        for number in range(NUM_CALLS):
            calls.call(partial(received.append, number))
        calls.call(end.set)

    thread = threading.Thread(target=produce)
    thread.start()
    await end.wait()
    thread.join()
    assert received == list(range(NUM_CALLS))


async def test_calls_before_the_loop_runs_wake_it_once() -> None:
    loop, wake_ups, received = asyncio.get_running_loop(), list[object](), list[int]()
    calls = LoopCalls()
    wake, loop.call_soon_threadsafe = loop.call_soon_threadsafe, wake_ups.append  # type: ignore[method-assign,assignment] # counted
    for number in range(100):
        calls.call(partial(received.append, number))
    loop.call_soon_threadsafe = wake  # type: ignore[method-assign]
    assert len(wake_ups) == 1
    loop.call_soon(wake_ups[0])  # type: ignore[arg-type]
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert received == list(range(100))


async def test_call_that_raises_does_not_end_the_others() -> None:
    loop, errors, received = asyncio.get_running_loop(), list[object](), list[int]()
    loop.set_exception_handler(lambda _, context: errors.append(context["exception"]))
    calls = LoopCalls()
    for function in (
        partial(received.append, 1),
        partial(divmod, 1, 0),
        partial(received.append, 2),
    ):
        calls.call(function)
    while len(received) < 2:
        await asyncio.sleep(0)
    assert received == [1, 2]
    assert [type(error) for error in errors] == [ZeroDivisionError]
