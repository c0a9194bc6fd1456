"""Requests of one client that wait for simulation or rendering: exactly one reply to each."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from catoptra_protocol.stream.replies import Error, Reply
from catoptra_server.runtime.faults import log_fault

log = logging.getLogger(__name__)

# More than any program has on its way that waits for its replies (SPEC.md 9.2).
MAX_PENDING = 64
# Text for clients; the traceback is in the log.
INTERNAL_FAULT = "an internal fault ended this request: see the server's log"

SendReply = Callable[[Reply], None]


class PendingRequest:
    """One request; the first reply is sent, later ones are dropped."""

    def __init__(self, id_: int, requests: PendingRequests) -> None:
        self.id = id_
        self._requests = requests

    def reply(self, reply: Reply) -> None:
        """Send a reply; on the loop."""
        self._requests.finish(self, reply)

    def reject(self, reason: str) -> None:
        """Send an error; on the loop."""
        self.reply(Error(self.id, reason))

    def reply_from_thread(self, make_reply: Callable[[], Reply]) -> None:
        """Send a reply that is made on the loop; from any thread."""
        self._requests.loop.call_soon_threadsafe(self._make_and_reply, make_reply)

    def _make_and_reply(self, make_reply: Callable[[], Reply]) -> None:
        try:
            reply = make_reply()
        except Exception:
            log_fault(log, "the reply to a request failed")
            reply = Error(self.id, INTERNAL_FAULT)
        self.reply(reply)


class PendingRequests:
    """The pending requests of one client, in the order of arrival."""

    def __init__(self, send_reply: SendReply) -> None:
        self.loop = asyncio.get_running_loop()
        self._send_reply = send_reply
        # A dict for its order; by object, since a client may repeat an id.
        self._requests: dict[PendingRequest, None] = {}

    def __len__(self) -> int:
        """Number of requests without a reply."""
        return len(self._requests)

    def add(self, id_: int) -> PendingRequest:
        """Add a request that will get its reply later."""
        request = PendingRequest(id_, self)
        self._requests[request] = None
        return request

    def finish(self, request: PendingRequest, reply: Reply) -> None:
        """Send the reply to a request, unless it had one or was cancelled."""
        if request in self._requests:
            del self._requests[request]
            self._send_reply(reply)

    def reject(self, id_: int, reason: str) -> None:
        """Send an error to the newest request of an id, pending or not."""
        for request in reversed(self._requests):
            if request.id == id_:
                request.reject(reason)
                return
        self._send_reply(Error(id_, reason))

    def reject_all(self, reason: str) -> None:
        """Send an error to every request."""
        for request in list(self._requests):
            request.reject(reason)

    def cancel_all(self) -> None:
        """Forget every request, without a reply: the client has disconnected."""
        self._requests.clear()
