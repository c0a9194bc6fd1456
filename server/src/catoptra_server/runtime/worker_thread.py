"""Worker threads of an asyncio server: start and end can be awaited, a failure is reported."""

from __future__ import annotations

import asyncio
import logging
import os
import sys
import threading
from collections.abc import Callable

from catoptra_protocol.errors import CatoptraError

log = logging.getLogger(__name__)


class ThreadFailedError(CatoptraError):
    """A fault in a worker thread that nothing there could contain; its cause is the fault."""


class WorkerThread:
    """A named thread that is started and stopped from the asyncio loop.

    Args:
        name: name of the thread, for logs.
        run: the work; calls its argument once the work is ready, and returns after `stop`.
        stop: makes `run` return; may be called from any thread, and before `run` has begun.
        on_failure: called on the loop if `run` raises after it was ready.
    """

    def __init__(
        self,
        name: str,
        run: Callable[[Callable[[], None]], None],
        *,
        stop: Callable[[], None],
        on_failure: Callable[[], None],
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._run = run
        self._stop = stop
        self._on_failure = on_failure
        self._ready: asyncio.Future[None] = self._loop.create_future()
        self._error: ThreadFailedError | None = None
        self._thread = threading.Thread(target=self._main, name=name)

    async def start(self) -> None:
        """Start the thread, and wait until the work is ready.

        Raises:
            CatoptraError: the work cannot start, for a reason in words.
            ThreadFailedError: a fault of the start.
        """
        self._thread.start()
        try:
            await self._ready
        # Cancellation too: a thread that is not joined would keep the process alive.
        except BaseException:
            self._stop()
            await asyncio.to_thread(self._thread.join)
            raise

    async def stop(self) -> None:
        """Stop the work, and wait for the thread.

        Raises:
            ThreadFailedError: an earlier fault.
        """
        self._stop()
        await asyncio.to_thread(self._thread.join)
        if self._error is not None:
            raise self._error

    def _main(self) -> None:
        try:
            self._run(self._signal_ready)
        # The top of a thread, where Python would print any error and go on without the thread.
        except Exception as error:
            self._loop.call_soon_threadsafe(self._handle_failure, error)

    def _signal_ready(self) -> None:
        self._loop.call_soon_threadsafe(self._set_ready)

    def _set_ready(self) -> None:
        # `start` may have been cancelled in the meantime, which cancels the future.
        if not self._ready.done():
            self._ready.set_result(None)

    def _handle_failure(self, error: Exception) -> None:
        if self._ready.done():
            self._error = self._describe(error)
            self._on_failure()
        elif isinstance(error, CatoptraError):
            self._ready.set_exception(error)
        else:
            self._ready.set_exception(self._describe(error))

    def _describe(self, error: Exception) -> ThreadFailedError:
        name = self._thread.name
        log.critical("the %s thread failed: the server ends", name, exc_info=error)
        failure = ThreadFailedError(f"the {name} thread failed: {type(error).__name__}: {error}")
        failure.__cause__ = error
        return failure


def lower_thread_priority(niceness: int) -> None:
    """Lower the priority of the calling thread and of those that it starts.

    Args:
        niceness: 0 to 19; as of the command `nice`.
    """
    # Only Linux has a niceness of threads; elsewhere the call would change the whole process.
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), niceness)
