"""Parts of the event loop's time, by a clock of the test."""

from __future__ import annotations

import time

import pytest

from catoptra_server.serve.limits import LoopShare


class Clock:
    """Time that passes by assignment."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_single_command_waits_for_nothing() -> None:
    share = LoopShare(0.3)
    account = share.open_account()
    with account.charge_block():
        pass
    account.charge_read()
    assert share.remaining_wait_s(account) < 0.0


def test_flood_of_reads_or_of_work_waits() -> None:
    share = LoopShare(0.3)
    reading, working = share.open_account(), share.open_account()
    for _ in range(200):
        reading.charge_read()
    assert share.remaining_wait_s(reading) > 0.0
    with working.charge_block():
        end_s = time.thread_time() + 0.05
        while time.thread_time() < end_s:
            pass
    assert share.remaining_wait_s(working) > 0.0


@pytest.mark.parametrize("num_connections", [1, 2, 64])
def test_flood_of_any_number_of_connections_takes_the_share_of_the_time(
    num_connections: int,
) -> None:
    clock = Clock()
    share = LoopShare(0.3, monotonic=clock)
    accounts = [share.open_account() for _ in range(num_connections)]
    begin_s, used_s = clock.now_s, 0.0
    while clock.now_s < begin_s + 20.0:
        ready = [one for one in accounts if share.remaining_wait_s(one) <= 0.0]
        for account in ready:
            share.charge(account, 0.002)
            clock.now_s += 0.002
            used_s += 0.002
        clock.now_s += 0.0005
    # The bursts at the begin come on top.
    assert used_s / 20.0 == pytest.approx(0.3, rel=0.2)


def test_wait_after_an_expensive_chunk_is_limited() -> None:
    clock = Clock()
    share = LoopShare(0.3, monotonic=clock)
    account = share.open_account()
    share.charge(account, 60.0)
    assert share.remaining_wait_s(account) == pytest.approx(1.0)


def test_dialogue_waits_for_nothing_however_long_it_lasts() -> None:
    clock = Clock()
    share = LoopShare(0.3, monotonic=clock)
    account = share.open_account()
    for _ in range(1000):
        account.charge(0.001)
        account.write_off()
        account.charge_read()
        clock.now_s += 0.001
        assert share.remaining_wait_s(account) < 0.0


def test_connection_that_stopped_counts_no_more() -> None:
    clock = Clock()
    share = LoopShare(0.5, monotonic=clock)
    first, second = share.open_account(), share.open_account()
    share.charge(first, 0.01)
    clock.now_s += 10.0
    share.charge(second, 0.05)
    assert share.remaining_wait_s(second) == pytest.approx(0.05 / 0.5 - 0.02)
