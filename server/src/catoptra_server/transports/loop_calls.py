"""Calls from other threads to the event loop, many at one wake-up.

Each `call_soon_threadsafe` writes to a pipe: some 400 a second were a fifth of the simulation's
time under load.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable


class LoopCalls:
    """Calls that the event loop executes in the order of `call`."""

    def __init__(self) -> None:
        """Create an empty queue; to be called from the event loop."""
        self._loop = asyncio.get_running_loop()
        self._calls: deque[Callable[[], object]] = deque()
        self._is_scheduled = False

    def call(self, function: Callable[[], object]) -> None:
        """Have the loop call a function soon; from any thread."""
        # Appended before the flag is read, while the loop clears the flag before it looks at the
        # queue: a function is never left behind.
        self._calls.append(function)
        if not self._is_scheduled:
            self._is_scheduled = True
            self._loop.call_soon_threadsafe(self._run)

    def _run(self) -> None:
        self._is_scheduled = False
        # Only the functions so far: others of the loop's callbacks come between.
        for _ in range(len(self._calls)):
            # By the loop itself, which reports an exception and goes on with the next.
            self._loop.call_soon(self._calls.popleft())
