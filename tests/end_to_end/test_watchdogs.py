"""The tests' own watchdogs: no server outlives its parent, and a wait names the line that hangs."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from helpers import loopback
from helpers.child_server import EXIT_PARENT_GONE
from helpers.deadline import Deadline
from helpers.server_process import DEADLINE_S, start_server


def test_server_when_its_parent_closes_the_pipe_ends_at_once(tmp_path: Path) -> None:
    with start_server(tmp_path) as server:
        assert server.process.stdin is not None
        # As the kernel does where the test process is killed.
        server.process.stdin.close()
        assert server.process.wait(DEADLINE_S) == EXIT_PARENT_GONE


def test_scenario_when_one_wait_hangs_fails_at_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario() -> None:
        await asyncio.Event().wait()

    monkeypatch.setattr(loopback, "DEADLINE_S", 0.5)
    with pytest.raises(pytest.fail.Exception, match=r"test_watchdogs.py:\d+: await asyncio.Event"):
        loopback.run_scenario(scenario())


async def test_scenario_when_longer_than_the_deadline_of_a_wait_passes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(loopback, "DEADLINE_S", 1.0)
    first, second = asyncio.Event(), asyncio.Event()
    asyncio.get_running_loop().call_later(0.7, first.set)
    asyncio.get_running_loop().call_later(1.4, second.set)
    await first.wait()
    await second.wait()


def test_deadline_when_passed_names_the_event() -> None:
    with pytest.raises(AssertionError, match="no reply within 0 s"):
        Deadline("reply", 0.0).check()
