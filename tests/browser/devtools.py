"""Client of the DevTools protocol: one WebSocket to the browser, one session a tab.

The socket is served by an event loop in a thread of its own, so that tests are plain functions that
call and wait. Each wait has a limit. Source: chromedevtools.github.io/devtools-protocol.
"""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any, TypeVar

import aiohttp

Message = dict[str, Any]
_Value = TypeVar("_Value")
# Thirty times the slowest call of a busy machine; a call that takes so long has failed.
CALL_LIMIT_S = 20.0
_POLL_S = 0.02


class DevToolsError(AssertionError):
    """The browser rejected a call, or a wait reached its limit."""


class LoopThread:
    """An event loop in a thread, for the length of a block."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)

    def __enter__(self) -> LoopThread:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def submit(self, work: Coroutine[Any, Any, _Value]) -> Future[_Value]:
        """Start a coroutine in the loop."""
        return asyncio.run_coroutine_threadsafe(work, self._loop)

    def run(self, work: Coroutine[Any, Any, _Value], limit_s: float = CALL_LIMIT_S + 5.0) -> _Value:
        """Run a coroutine in the loop, and wait for its result."""
        return self.submit(work).result(limit_s)


def wait_until(
    condition: Callable[[], _Value], event: str, limit_s: float, *, poll_s: float = _POLL_S
) -> _Value:
    """Poll a condition until its value is true; the value.

    Raises:
        DevToolsError: The limit was reached.
    """
    end_s = time.monotonic() + limit_s
    while not (value := condition()):
        if time.monotonic() > end_s:
            raise DevToolsError(f"no {event} within {limit_s:g} s; last value: {value!r}")
        time.sleep(poll_s)
    return value


def pause(duration_s: float) -> None:
    """Let the page run for the length of a measurement."""
    time.sleep(duration_s)


class DevTools:
    """The connection to a browser."""

    def __init__(self, thread: LoopThread, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._thread = thread
        self._socket = socket
        self._last_id = 0
        self._lock = threading.Lock()
        self._replies: dict[int, Future[Message]] = {}
        self._has_ended = False
        self._handlers: dict[str, Callable[[str, Message], None]] = {}
        self._reader = thread.submit(self._receive())

    def call(
        self, method: str, *, session: str = "", limit_s: float = CALL_LIMIT_S, **params: object
    ) -> Message:
        """Call a method of the browser or, in a session, of a tab; the result.

        Raises:
            DevToolsError: The browser rejected the call or sent no reply.
        """
        reply: Future[Message] = Future()
        with self._lock:
            if self._has_ended:
                raise DevToolsError(f"{method}: the browser has ended")
            self._last_id += 1
            id_ = self._last_id
            self._replies[id_] = reply
        message: Message = {"id": id_, "method": method, "params": params}
        if session:
            message["sessionId"] = session
        self._thread.run(self._socket.send_str(json.dumps(message)))
        try:
            answer = reply.result(limit_s)
        except TimeoutError:
            raise DevToolsError(f"no reply to {method} within {limit_s:g} s") from None
        if "error" in answer:
            raise DevToolsError(f"{method}: {answer['error'].get('message')}")
        result: Message = answer["result"]
        return result

    def set_handler(self, session: str, handler: Callable[[str, Message], None]) -> None:
        """Call a function with method and parameters of each event of a session (empty: browser).

        The function runs in the thread of the loop.
        """
        self._handlers[session] = handler

    def remove_handler(self, session: str) -> None:
        """Discard further events of a session."""
        self._handlers.pop(session, None)

    def wait_for_end(self) -> None:
        """Wait until the socket has closed and its last message is read."""
        self._reader.result(CALL_LIMIT_S)

    async def _receive(self) -> None:
        async for part in self._socket:
            if part.type is aiohttp.WSMsgType.TEXT:
                self._dispatch(json.loads(part.data))
        with self._lock:
            self._has_ended = True
            waiting, self._replies = list(self._replies.values()), {}
        for reply in waiting:
            reply.set_result({"error": {"message": "the browser has ended"}})

    def _dispatch(self, message: Message) -> None:
        if "id" in message:
            with self._lock:
                reply = self._replies.pop(message["id"], None)
            if reply is not None:
                reply.set_result(message)
        elif handler := self._handlers.get(message.get("sessionId", "")):
            handler(message["method"], message.get("params", {}))


@contextmanager
def connect_devtools(address: str) -> Iterator[DevTools]:
    """Connect to a browser for the length of a block.

    Args:
        address: ws://HOST:PORT/devtools/browser/ID.
    """
    with LoopThread() as thread:
        client, socket = thread.run(_open_socket(address))
        devtools = DevTools(thread, socket)
        try:
            yield devtools
        finally:
            thread.run(_close(client, socket))
            devtools.wait_for_end()


async def _open_socket(
    address: str,
) -> tuple[aiohttp.ClientSession, aiohttp.ClientWebSocketResponse]:
    client = aiohttp.ClientSession()
    try:
        # Without a limit: screenshots are messages of several MB.
        return client, await client.ws_connect(address, max_msg_size=0)
    except BaseException:
        await client.close()
        raise


async def _close(client: aiohttp.ClientSession, socket: aiohttp.ClientWebSocketResponse) -> None:
    await socket.close()
    await client.close()
