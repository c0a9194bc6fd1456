"""Calls to the loop from other threads: all, in order, with few wake-ups."""

from __future__ import annotations

import asyncio
import threading
from functools import partial

from catoptra_server.serve.limits import LoopCalls
from helpers.loopback import run_scenario

NUM_CALLS = 20_000


def test_calls_of_a_thread_arrive_in_order_and_none_is_lost() -> None:
    async def scenario() -> None:
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

    run_scenario(scenario())


def test_calls_before_the_loop_runs_wake_it_once() -> None:
    async def scenario() -> None:
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

    run_scenario(scenario())


def test_call_that_raises_does_not_end_the_others() -> None:
    async def scenario() -> None:
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

    run_scenario(scenario())
