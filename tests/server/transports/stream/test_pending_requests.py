"""Exactly one reply to each request."""

from __future__ import annotations

import asyncio
import threading

import pytest

from catoptra_protocol.stream.replies import Error, Ok, Reply
from catoptra_server.serve.stream.session import INTERNAL_FAULT, PendingRequests
from helpers.loopback import run_scenario


def test_request_when_replied_twice_has_the_first_reply_only() -> None:
    async def scenario() -> None:
        sent: list[Reply] = []
        requests = PendingRequests(sent.append)
        first, second = requests.add(1), requests.add(1)  # ids of a client may repeat
        first.reply(Ok(1))
        first.reject("too late")
        assert (sent, len(requests)) == ([Ok(1)], 1)
        second.reject("refused")
        assert (sent[1:], len(requests)) == ([Error(1, "refused")], 0)

    run_scenario(scenario())


def test_requests_when_all_are_rejected_have_their_ids_in_order() -> None:
    async def scenario() -> None:
        sent: list[Reply] = []
        requests = PendingRequests(sent.append)
        late = [requests.add(id_) for id_ in (3, 1, 2)]
        requests.reject_all("removed")
        assert sent == [Error(id_, "removed") for id_ in (3, 1, 2)]
        for request in late:
            request.reply(Ok(request.id))
        assert len(sent) == 3

    run_scenario(scenario())


def test_requests_when_cancelled_have_no_reply() -> None:
    async def scenario() -> None:
        sent: list[Reply] = []
        requests = PendingRequests(sent.append)
        request = requests.add(1)
        requests.cancel_all()
        request.reply(Ok(1))
        assert (sent, len(requests)) == ([], 0)

    run_scenario(scenario())


def test_request_when_rejected_by_its_id_is_the_newest_of_it_or_none() -> None:
    async def scenario() -> None:
        sent: list[Reply] = []
        requests = PendingRequests(sent.append)
        oldest, newest = requests.add(1), requests.add(1)
        requests.reject(1, "a fault")
        newest.reply(Ok(1))
        oldest.reply(Ok(1))
        requests.reject(2, "not pending")
        assert sent == [Error(1, "a fault"), Ok(1), Error(2, "not pending")]

    run_scenario(scenario())


def test_reply_of_a_thread_is_made_on_the_loop(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario() -> None:
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

    run_scenario(scenario())
    assert "ZeroDivisionError" in caplog.text
