"""Live pages without a browser: WebSockets that send what static/feed.js sends, and count frames.

A browser that draws in software gets few frames a second in each of several tabs, and takes the
processors from the server: what pages cost the server is measured by these clients, in a process
of their own: python -m browser.page_clients URL ROBOT CAMERA COUNT. The process prints a line once
each client has had a frame, and after each line on standard input the frames of each since the
last one, as a JSON list.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import aiohttp

from browser.live_server import LiveServer
from browser.static_files import STATIC
from helpers.configs import REPOSITORY

_READY = "ready"
_START_LIMIT_S = 30.0


@dataclass(frozen=True, slots=True)
class FeedIntervals:
    """Intervals of the page's requests."""

    state_s: float
    landmarks_s: float


def read_feed_intervals() -> FeedIntervals:
    """Intervals in the script of the page, so that both cannot drift apart."""
    script = (STATIC / "feed.js").read_text(encoding="utf-8")

    def read_s(name: str) -> float:
        found = re.search(rf"^const {name} = (\d+);", script, re.MULTILINE)
        assert found, f"feed.js has no constant {name}"
        return int(found[1]) / 1000.0

    return FeedIntervals(read_s("STATE_INTERVAL_MS"), read_s("LANDMARKS_INTERVAL_MS"))


@dataclass(slots=True)
class PageClient:
    """The socket of one page that pulls pictures, states and landmarks of one camera."""

    websocket: aiohttp.ClientWebSocketResponse
    robot: str
    camera: str
    num_frames: int = 0
    has_frame: asyncio.Event = field(default_factory=asyncio.Event)
    _num_requests: int = 0
    _pending: set[str] = field(default_factory=set)

    async def run(self, intervals: FeedIntervals) -> None:
        """Pull until the socket closes or the task is cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._receive())
            tasks.create_task(self._poll("state", intervals.state_s))
            tasks.create_task(self._poll("landmarks", intervals.landmarks_s))
            await self._request("frame")

    async def _poll(self, kind: str, interval_s: float) -> None:
        while True:
            if kind not in self._pending:
                await self._request(kind)
            await asyncio.sleep(interval_s)

    async def _request(self, kind: str) -> None:
        self._pending.add(kind)
        self._num_requests += 1
        fields = {"kind": f"get_{kind}", "robot": self.robot, "id": self._num_requests}
        if kind != "state":
            fields["camera"] = self.camera
        if kind == "frame":
            fields["encoding"] = "jpeg"
        await self.websocket.send_str(json.dumps(fields))

    async def _receive(self) -> None:
        async for message in self.websocket:
            if message.type is aiohttp.WSMsgType.BINARY:
                self.num_frames += 1
                self.has_frame.set()
                await self._request("frame")
                continue
            kind = json.loads(message.data)["kind"]
            assert kind in ("state", "landmarks", "heartbeat"), message.data
            self._pending.discard(kind)
        raise ConnectionError("the server has closed the socket of a page")


@dataclass(frozen=True, slots=True)
class PageProcess:
    """Clients that run in a process of their own."""

    process: subprocess.Popen[str]

    def take_counts(self) -> list[int]:
        """Frames of each client since the last call."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print(file=self.process.stdin, flush=True)
        counts = json.loads(self.process.stdout.readline())
        assert isinstance(counts, list)
        return counts


@contextmanager
def start_page_clients(
    live: LiveServer, robot: str, camera: str, count: int
) -> Iterator[PageProcess]:
    """Run clients for the length of a block, which begins when each has had a frame."""
    command = [sys.executable, "-m", "browser.page_clients", live.url, robot, camera, str(count)]
    with subprocess.Popen(
        command, cwd=REPOSITORY / "tests", stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line == f"{_READY}\n", f"clients of the page did not start: {line!r}"
            yield PageProcess(process)
        finally:
            process.kill()


async def _connect(session: aiohttp.ClientSession, url: str) -> aiohttp.ClientWebSocketResponse:
    origin = url.rstrip("/")
    return await session.ws_connect(f"{origin}/socket", origin=origin)


async def _serve_counts(clients: Sequence[PageClient]) -> None:
    """Print the frames of each client for each line on standard input, to its end."""
    async with asyncio.timeout(_START_LIMIT_S):
        for client in clients:
            await client.has_frame.wait()
    print(_READY, flush=True)
    while await asyncio.to_thread(sys.stdin.readline):
        print(json.dumps([client.num_frames for client in clients]), flush=True)
        for client in clients:
            client.num_frames = 0


async def _run(url: str, robot: str, camera: str, count: int) -> None:
    intervals = read_feed_intervals()
    # Cookies of addresses, too: aiohttp's default keeps none of 127.0.0.1.
    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
        clients = [PageClient(await _connect(session, url), robot, camera) for _ in range(count)]
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(client.run(intervals)) for client in clients]
            await _serve_counts(clients)
            for task in running:
                task.cancel()


def main(arguments: Sequence[str]) -> None:
    """Run clients until standard input ends."""
    parser = argparse.ArgumentParser(description="Pull what live pages pull.")
    parser.add_argument("url")
    parser.add_argument("robot")
    parser.add_argument("camera")
    parser.add_argument("count", type=int)
    options = parser.parse_args(arguments)
    asyncio.run(_run(options.url, options.robot, options.camera, options.count))


if __name__ == "__main__":
    main(sys.argv[1:])
