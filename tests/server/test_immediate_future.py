"""A future that resumes its coroutine at once, and otherwise is one of asyncio's."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextvars import ContextVar

import pytest

from catoptra_server.immediate_future import ImmediateFuture
from helpers.loopback import run_scenario

Number = ImmediateFuture[int]


async def start_waiting(future: Number, events: list[object]) -> asyncio.Task[None]:
    """Task that waits for a future, and records how the wait ends."""

    async def wait() -> None:
        try:
            events.append(await future)
        except (ValueError, asyncio.CancelledError) as error:
            events.append(type(error))
            raise

    task = asyncio.create_task(wait())
    await asyncio.sleep(0)
    return task


def run_with_future(
    scenario: Callable[[Number, asyncio.Task[None], list[object]], Awaitable[None]],
) -> None:
    async def run() -> None:
        future, events = Number(asyncio.get_running_loop()), list[object]()
        assert asyncio.isfuture(future)
        await scenario(future, await start_waiting(future, events), events)

    run_scenario(run())


async def call_from_loop(function: Callable[[], object]) -> None:
    """Call a function as the loop calls protocols: not inside a task."""
    called = asyncio.Event()
    asyncio.get_running_loop().call_soon(lambda: (function(), called.set()))
    await called.wait()


def test_result_when_set_by_a_callback_resumes_the_coroutine_inside_the_call() -> None:
    async def scenario(future: Number, task: asyncio.Task[None], events: list[object]) -> None:
        def set_result() -> None:
            future.set_result(5)
            events.append("returned")

        await call_from_loop(set_result)
        await task
        assert events == [5, "returned"]
        assert future.done()
        assert future.result() == await future == 5

    run_with_future(scenario)


def test_result_when_set_by_a_coroutine_resumes_the_other_one_afterwards() -> None:
    async def scenario(future: Number, task: asyncio.Task[None], events: list[object]) -> None:
        future.set_result(5)
        events.append("returned")
        await task
        assert events == ["returned", 5]

    run_with_future(scenario)


def test_future_when_done_takes_no_other_result() -> None:
    async def scenario(future: Number, task: asyncio.Task[None], events: list[object]) -> None:
        future.set_result(5)
        with pytest.raises(asyncio.InvalidStateError):
            future.set_result(6)
        with pytest.raises(asyncio.InvalidStateError):
            future.set_exception(ValueError("late"))
        await task
        assert events == [5]

    run_with_future(scenario)


def test_exception_when_set_is_raised_in_the_coroutine() -> None:
    async def scenario(future: Number, task: asyncio.Task[None], events: list[object]) -> None:
        await call_from_loop(lambda: future.set_exception(ValueError("gone")))
        with pytest.raises(ValueError, match="gone"):
            await task
        assert events == [ValueError]

    run_with_future(scenario)


def test_task_when_cancelled_cancels_the_future_and_is_resumed_later() -> None:
    async def scenario(future: Number, task: asyncio.Task[None], events: list[object]) -> None:
        def cancel() -> None:
            assert task.cancel("enough")
            assert future.done()
            assert not future.cancel()
            events.append("returned")

        await call_from_loop(cancel)
        with pytest.raises(asyncio.CancelledError):
            await task
        assert events == ["returned", asyncio.CancelledError]
        assert task.cancelled()

    run_with_future(scenario)


def test_task_when_it_ends_inside_the_call_leaves_the_caller_unharmed() -> None:
    async def scenario(future: Number, task: asyncio.Task[None], events: list[object]) -> None:
        # Several coroutines are resumed by one callback, one after the other.
        other = Number(asyncio.get_running_loop())
        second = await start_waiting(other, events)
        await call_from_loop(lambda: (future.set_result(1), other.set_result(2)))
        await asyncio.gather(task, second)
        assert events == [1, 2]

    run_with_future(scenario)


def test_coroutine_when_resumed_has_its_own_context() -> None:
    variable: ContextVar[str] = ContextVar("variable", default="outside")

    async def scenario() -> None:
        future, seen = Number(asyncio.get_running_loop()), list[str]()

        async def wait() -> None:
            variable.set("inside")
            await future
            seen.append(variable.get())

        task = asyncio.create_task(wait())
        await asyncio.sleep(0)
        await call_from_loop(lambda: future.set_result(1))
        await task
        assert (seen, variable.get()) == (["inside"], "outside")

    run_scenario(scenario())
