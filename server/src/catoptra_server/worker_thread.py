"""A thread as the asyncio loop sees it: its start can be awaited, its failure ends the server."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable

log = logging.getLogger(__name__)


class WorkerThread:
    """A named thread. work: what it does; it calls its argument once it is ready.

    stop: makes the work end, from any thread. on_failure: called on the loop if the work raises.
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
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._main, name=name)

    async def start(self) -> None:
        """Start; return once it is ready, or raise why it is not."""
        self._thread.start()
        try:
            await self._ready
        except BaseException:
            self._stop()
            await asyncio.to_thread(self._thread.join)
            raise

    async def stop(self) -> None:
        """Make it end and wait for that; raise what ended it, if it was not this."""
        self._stop()
        await asyncio.to_thread(self._thread.join)
        if self._error is not None:
            raise self._error

    def _main(self) -> None:
        try:
            self._run(self._signal_ready)
        # The top of a thread: hand whatever it is to who waits for it, or end the server.
        except Exception as error:
            self._loop.call_soon_threadsafe(self._handle_failure, error)

    def _signal_ready(self) -> None:
        self._loop.call_soon_threadsafe(self._set_ready)

    def _set_ready(self) -> None:
        if not self._ready.done():
            self._ready.set_result(None)

    def _handle_failure(self, error: Exception) -> None:
        if self._ready.done():
            log.critical("the %s ended: %s", self._thread.name, error)
            self._error = error
            self._on_failure()
        else:
            self._ready.set_exception(error)
