"""Deadlines of single waits: a wait that fails names the event that did not occur."""

from __future__ import annotations

import time


class Deadline:
    """The moment until which one event may be awaited.

    A loop that polls, or that reads past messages of other kinds, checks the deadline in each turn:
    a socket's timeout alone never ends a loop to which the server keeps sending.
    """

    def __init__(self, event: str, timeout_s: float) -> None:
        self._event = event
        self._timeout_s = timeout_s
        self._end_s = time.monotonic() + timeout_s

    def check(self) -> None:
        """Fail the test once the deadline has passed."""
        assert time.monotonic() < self._end_s, f"no {self._event} within {self._timeout_s:g} s"
