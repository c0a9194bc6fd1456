"""A future whose result resumes the waiting coroutine at once.

A future of asyncio resumes its coroutine a turn of the loop later: another call of the system, and
another chance for other threads to take the interpreter. Two such waits of each raw frame over TCP
cost 0.1 of 1.5 ms of processor time (tests/cost/serving.py).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator
from contextvars import Context, copy_context
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class ImmediateFuture(Generic[T]):
    """A result that one coroutine awaits, on the thread of the event loop.

    Compatible with asyncio's tasks in the sense of `asyncio.isfuture`. The coroutine runs inside
    the call that sets the result, unless that call comes from a coroutine itself.
    """

    # Protocol of asyncio's tasks: set when the future is yielded to the task, which clears it.
    _asyncio_future_blocking = False

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        """Create a future of a loop, without a result."""
        self._loop = loop
        self._resume: Callable[[ImmediateFuture[T]], object] | None = None
        self._context: Context | None = None
        self._is_done = False
        self._result: T | None = None
        self._error: BaseException | None = None

    def __await__(self) -> Generator[ImmediateFuture[T], None, T]:
        """Wait for the result, or for the exception."""
        if not self._is_done:
            self._asyncio_future_blocking = True
            yield self
        return self.result()

    def done(self) -> bool:
        """Whether there is a result or an exception, or the future is cancelled."""
        return self._is_done

    def set_result(self, result: T) -> None:
        """Set the result, and resume the coroutine.

        Raises:
            InvalidStateError: The future is done.
        """
        if self._is_done:
            raise asyncio.InvalidStateError
        self._result = result
        self._finish()

    def set_exception(self, error: BaseException) -> None:
        """Set an exception, and resume the coroutine; errors as of `set_result`."""
        if self._is_done:
            raise asyncio.InvalidStateError
        self._error = error
        self._finish()

    def cancel(self, msg: str | None = None) -> bool:
        """Cancel the future; called by the coroutine's task."""
        if self._is_done:
            return False
        self._error = asyncio.CancelledError() if msg is None else asyncio.CancelledError(msg)
        # Whoever cancels does not expect the coroutine to run meanwhile.
        self._finish(at_once=False)
        return True

    def result(self) -> T:
        """Result of a future that is done; raises its exception."""
        if self._error is not None:
            raise self._error
        return self._result  # type: ignore[return-value] # a T since `set_result`

    def get_loop(self) -> asyncio.AbstractEventLoop:
        """Loop of the future; called by the coroutine's task."""
        return self._loop

    def add_done_callback(
        self, callback: Callable[[Any], object], *, context: Context | None = None
    ) -> None:
        """Set the function that resumes the coroutine; called by its task."""
        self._resume, self._context = callback, context or copy_context()

    def _finish(self, *, at_once: bool = True) -> None:
        self._is_done = True
        resume, context = self._resume, self._context
        if resume is None or context is None:
            return
        # One coroutine cannot be resumed inside another one.
        if at_once and asyncio.current_task(self._loop) is None:
            context.run(resume, self)
        else:
            self._loop.call_soon(resume, self, context=context)
