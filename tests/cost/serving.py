"""What it costs to serve frames, beside drawing them.

Run: PYTHONPATH=tests .venv/bin/python -m cost.serving. Prints a table and writes
out/bench/serving.json; exit status 1 beyond a limit. Clients run in this process, the server in
another one. Costs are processor time of the server: of a frame beyond drawing, with a stand-in of 5
ms for the renderer and without what the server takes for its robots alone; of several clients of
one camera, as a ratio. Windows of both sides of a ratio alternate. Limits of times are those of a
machine where a process that sends the same bytes by bare sockets takes 0.22 ms for 640 px; here
they are the same multiple of that. Machines are noisy: compare rows of one run.
"""

from __future__ import annotations

import json
import os
import statistics
import struct
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from catoptra_client.robot_client import RobotClient
from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_studies.accuracy_cost.cost_command import describe_machine
from cost.bare_sockets import measure_bare_sockets
from cost.served_process import (
    FULL_REQUEST,
    ROBOT,
    ROOT,
    WORLD,
    CountedServer,
    Window,
    connect_watchers,
    make_stream_request,
    read_ports,
    spawn_robots,
    start_process,
    start_server,
)
from cost.trace_scenes import write_million_world
from helpers.zmtp import connect_with_handshake

OUTPUT = ROOT / "out/bench"
STREAM_REQUEST = ImageEncoding.RAW.value.encode()
TRANSPORTS = {"TCP": FULL_REQUEST, "ZeroMQ": STREAM_REQUEST}
SIZE_PX = 640
IMAGE_BYTES = 3 * SIZE_PX**2
ROUNDS, WINDOW_S = 5, 1.0
STAND_IN_MS = 5.0
CLIENTS, CAMERAS = 8, 16
# Sixteen frames that are drawn, and as many ahead, are those of clients that have paused.
CAMERAS_SETTLE_S = 1.5
LIMITED_HZ = 30.0
STARTS = 10
BARE_MS = 0.22
# Milliseconds beside drawing, by pixels of a side.
MAX_COST_MS = {360: 0.3, 640: 0.5, 1024: 0.9}
MAX_STREAM_RATIO, MAX_CLIENTS_RATIO = 1.25, 1.15
MIN_DELIVERED_SHARE, MIN_LIMITED_SHARE, MIN_CAMERAS_SHARE = 0.97, 0.95, 0.95
SMALL_PX, MAX_SMALL_MS = 16, 0.25
SILENT_VIEWERS, MIN_KEPT_SHARE = 256, 0.9
MAX_STANDING_CORES, MIN_DISTINCT_SHARE = 0.15, 0.95
FIRST_FRAMES = {
    "field": (ROBOT, WORLD, 0.35),
    "warehouse": (ROBOT, WORLD.with_name("warehouse.ini"), 0.6),
    "real camera": (ROBOT.with_name("p2at_omni_real.ini"), WORLD, 0.6),
}
MAX_MILLION_FIRST_FRAME_S = 1.5


@dataclass(frozen=True, slots=True)
class ServingRow:
    """One line of the table."""

    question: str
    value: float
    limit: str
    is_met: bool
    details: str = ""

    @classmethod
    def at_most(cls, question: str, value: float, limit: float, details: str = "") -> ServingRow:
        """Row of a value that has a largest one."""
        return cls(question, value, f"<= {limit:.2f}", value <= limit, details)

    @classmethod
    def at_least(cls, question: str, value: float, limit: float, details: str = "") -> ServingRow:
        """Row of a value that has a smallest one."""
        return cls(question, value, f">= {limit:.2f}", value >= limit, details)


def main() -> int:
    """Measure everything; exit status 1 if a limit is exceeded."""
    measurements: list[Callable[[], Iterable[ServingRow]]] = [
        *(partial(_measure_costs, size_px) for size_px in MAX_COST_MS),
        _measure_jpeg,
        _measure_small_frames,
        *(partial(_measure_clients, "trace", name) for name in TRANSPORTS),
        partial(_measure_clients, "raster", "TCP"),
        partial(_measure_limited_clients, "trace"),
        partial(_measure_limited_clients, "raster"),
        _measure_cameras,
        partial(_measure_cameras, stand_in_ms=STAND_IN_MS),
        _measure_standing_robot,
        _measure_distinct_frames,
        _measure_silent_viewers,
        *(partial(_measure_first_frame, world) for world in FIRST_FRAMES),
        _measure_first_frame_of_million,
    ]
    console, rows = Console(), []
    for measure in measurements:
        for row in measure():
            rows.append(row)
            console.print(str(row), highlight=False)
    console.print(_make_table(rows))
    OUTPUT.mkdir(parents=True, exist_ok=True)
    document = {"machine": describe_machine(), "rows": [asdict(row) for row in rows]}
    (OUTPUT / "serving.json").write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    return 0 if all(row.is_met for row in rows) else 1


def _measure_slowness() -> float:
    """Time of bare sockets here, over that on the machine of the limits."""
    times_s = [measure_bare_sockets(IMAGE_BYTES) for _ in range(ROUNDS)]
    return max(1.0, 1e3 * statistics.median(times_s) / BARE_MS)


def _measure_costs(size_px: int) -> Iterable[ServingRow]:
    """Processor time beside drawing, over both transports, and frames delivered for it."""
    costs_ms: dict[str, list[float]] = {name: [] for name in TRANSPORTS}
    slowness = []
    with ExitStack() as stack:
        options = ("--renderer", "trace")
        server = stack.enter_context(
            start_server(*options, size_px=size_px, stand_in_ms=STAND_IN_MS)
        )
        stack.enter_context(spawn_robots(server, 1))
        watchers = stack.enter_context(connect_watchers(server, *TRANSPORTS.values()))
        server.warm_up(watchers)
        for _ in range(ROUNDS):
            slowness.append(_measure_slowness())
            idle = server.measure([], WINDOW_S)
            for name, watcher in zip(TRANSPORTS, watchers, strict=True):
                busy = server.measure([watcher], WINDOW_S)
                costs_ms[name].append(_cost_beside_drawing_ms(busy, idle))
    tcp_ms = statistics.median(costs_ms["TCP"])
    limit_ms = MAX_COST_MS[size_px] * statistics.median(slowness)
    details = f"machine {statistics.median(slowness):.1f} times slower at bare sockets"
    beside = f"{size_px} px: processor time beside drawing"
    yield ServingRow.at_most(f"{beside}, RAW over TCP, ms", tcp_ms, limit_ms, details)
    ratios = [z / t for t, z in zip(*costs_ms.values(), strict=True)]
    yield ServingRow.at_most(
        f"{beside}, ZeroMQ over TCP", statistics.median(ratios), MAX_STREAM_RATIO
    )
    yield _measure_delivery(size_px, tcp_ms)


def _cost_beside_drawing_ms(busy: Window, idle: Window) -> float:
    beside_s = idle.serving_s * busy.elapsed_s / idle.elapsed_s
    return 1e3 * (busy.serving_s - beside_s) / sum(busy.delivered)


def _measure_delivery(size_px: int, cost_ms: float) -> ServingRow:
    """Frames delivered over those that all processors could draw and serve."""
    shares, rates = [], []
    with ExitStack() as stack:
        server = stack.enter_context(start_server("--renderer", "trace", size_px=size_px))
        stack.enter_context(spawn_robots(server, 1))
        watchers = stack.enter_context(connect_watchers(server, FULL_REQUEST))
        server.warm_up(watchers)
        for _ in range(ROUNDS):
            window = server.measure(watchers, WINDOW_S)
            draw_ms = 1e3 * (window.process_s - window.serving_s) / window.drawn
            possible_hz = 1e3 * len(os.sched_getaffinity(0)) / (draw_ms + cost_ms)
            rates.append(_rate_hz(window))
            shares.append(rates[-1] / possible_hz)
    return ServingRow.at_least(
        f"{size_px} px: frames delivered over those possible",
        *(statistics.median(shares), MIN_DELIVERED_SHARE),
        f"{statistics.median(rates):.0f} frames/s",
    )


def _measure_jpeg() -> Iterable[ServingRow]:
    """The same for JPEG, without the time of the encoder alone."""
    costs_ms, encode_ms = [], []
    with ExitStack() as stack:
        options = ("--renderer", "trace", "--image-type", "GOOD")
        server = stack.enter_context(start_server(*options, stand_in_ms=STAND_IN_MS))
        stack.enter_context(spawn_robots(server, 1))
        watchers = stack.enter_context(connect_watchers(server, FULL_REQUEST))
        server.warm_up(watchers)
        picture = cv2.imdecode(np.frombuffer(watchers[0].payload, np.uint8), cv2.IMREAD_COLOR)
        for _ in range(ROUNDS):
            idle = server.measure([], WINDOW_S)
            costs_ms.append(_cost_beside_drawing_ms(server.measure(watchers, WINDOW_S), idle))
            begin_s = time.thread_time()
            for _ in range(50):
                cv2.imencode(".jpg", picture)
            encode_ms.append(1e3 * (time.thread_time() - begin_s) / 50)
    alone_ms = statistics.median(encode_ms)
    yield ServingRow.at_most(
        f"{SIZE_PX} px: processor time beside drawing and cv2.imencode, JPEG over TCP, ms",
        *(statistics.median(costs_ms) - alone_ms, MAX_COST_MS[SIZE_PX] * _measure_slowness()),
        f"cv2.imencode alone {alone_ms:.2f} ms",
    )


def _measure_small_frames() -> Iterable[ServingRow]:
    """Processor time of all of a small frame."""
    costs_ms = []
    with ExitStack() as stack:
        server = stack.enter_context(start_server("--renderer", "trace", size_px=SMALL_PX))
        stack.enter_context(spawn_robots(server, 1))
        watchers = stack.enter_context(connect_watchers(server, FULL_REQUEST))
        server.warm_up(watchers)
        for _ in range(ROUNDS):
            idle, busy = server.measure([], WINDOW_S), server.measure(watchers, WINDOW_S)
            process_s = busy.process_s - idle.process_s * busy.elapsed_s / idle.elapsed_s
            costs_ms.append(1e3 * process_s / busy.drawn)
    yield ServingRow.at_most(
        f"{SMALL_PX} px: processor time of a whole frame, ms",
        *(statistics.median(costs_ms), MAX_SMALL_MS * _measure_slowness()),
    )


def _measure_clients(renderer: str, transport: str) -> Iterable[ServingRow]:
    """Processor time of a drawn frame with eight clients, over that with one."""
    ratios, shares = [], []
    with ExitStack() as stack:
        server = stack.enter_context(start_server("--renderer", renderer))
        stack.enter_context(spawn_robots(server, 1))
        requests = [TRANSPORTS[transport]] * CLIENTS
        watchers = stack.enter_context(connect_watchers(server, *requests))
        server.warm_up(watchers)
        for _ in range(ROUNDS):
            one = server.measure(watchers[:1], WINDOW_S)
            all_ = server.measure(watchers, WINDOW_S)
            ratios.append(_cost_s(all_) / _cost_s(one))
            shares.append(min(all_.delivered) / all_.drawn)
    bare_ms = BARE_MS * _measure_slowness()
    yield ServingRow.at_most(
        f"{renderer}, {transport}: processor time with {CLIENTS} clients over that with one",
        *(statistics.median(ratios), MAX_CLIENTS_RATIO),
        f"each gets {statistics.median(shares):.0%} of the drawn frames; {1e3 * _cost_s(one):.1f} "
        f"ms with one, bare sockets {bare_ms:.2f} ms for each",
    )


def _cost_s(window: Window) -> float:
    return window.process_s / window.drawn


def _measure_limited_clients(renderer: str) -> Iterable[ServingRow]:
    """Frames that each of eight clients gets which request 30 a second."""
    with ExitStack() as stack:
        server = stack.enter_context(start_server("--renderer", renderer))
        stack.enter_context(spawn_robots(server, 1))
        requests = [FULL_REQUEST] * CLIENTS
        watchers = stack.enter_context(connect_watchers(server, *requests, rate_hz=LIMITED_HZ))
        server.warm_up(watchers)
        window = server.measure(watchers, ROUNDS * WINDOW_S)
    yield ServingRow.at_least(
        f"{renderer}: share of {LIMITED_HZ:g} frames/s that each of {CLIENTS} clients gets",
        *(min(window.delivered) / (LIMITED_HZ * window.elapsed_s), MIN_LIMITED_SHARE),
    )


def _measure_cameras(*, stand_in_ms: float | None = None) -> Iterable[ServingRow]:
    """Total rate of sixteen watched cameras over that of one, with sixteen robots in both."""
    tiles = [
        struct.pack(">cIIII", b"U", SIZE_PX * column, SIZE_PX * row, SIZE_PX, SIZE_PX)
        for row in range(4)
        for column in range(4)
    ]
    of_one, of_all = [], []
    with ExitStack() as stack:
        options = ("--renderer", "trace", "--multi-view", f"4x4:{SIZE_PX}x{SIZE_PX}")
        server = stack.enter_context(start_server(*options, stand_in_ms=stand_in_ms))
        stack.enter_context(spawn_robots(server, CAMERAS))
        watchers = stack.enter_context(connect_watchers(server, *tiles))
        server.warm_up(watchers)
        # Each alone: a camera in the middle has more robots near it than one in a corner.
        for watcher in watchers:
            alone = server.measure([watcher], WINDOW_S, settle_s=CAMERAS_SETTLE_S)
            of_one.append(_rate_hz(alone))
            of_all.append(_rate_hz(server.measure(watchers, WINDOW_S)))
    one_hz = statistics.mean(of_one)
    name = "stand-in" if stand_in_ms else "trace"
    yield ServingRow.at_least(
        f"{name}: total rate of {CAMERAS} watched cameras over that of one",
        *(statistics.mean(of_all) / one_hz, MIN_CAMERAS_SHARE),
        f"one: {one_hz:.1f} frames/s",
    )


def _rate_hz(window: Window) -> float:
    return sum(window.delivered) / window.elapsed_s


def _measure_standing_robot() -> Iterable[ServingRow]:
    """Frames drawn for, and processors taken by, eight viewers of a robot that stands."""
    with ExitStack() as stack:
        server = stack.enter_context(start_server("--renderer", "trace", size_px=360))
        robot = stack.enter_context(RobotClient.connect(port=server.control_port))
        robot.spawn("USARBot.OmniP2AT", location_m=(0.0, 0.0, 0.0))
        watchers = stack.enter_context(connect_watchers(server, *[FULL_REQUEST] * CLIENTS))
        server.warm_up(watchers)
        window = server.measure(watchers, ROUNDS * WINDOW_S)
    standing = f"standing robot, {CLIENTS} viewers of 360 px: "
    yield ServingRow.at_most(f"{standing}frames drawn", window.drawn, 0)
    yield ServingRow.at_most(
        f"{standing}processors",
        *(window.process_s / window.elapsed_s, MAX_STANDING_CORES * _measure_slowness()),
        f"each gets {min(window.delivered) / window.elapsed_s:.0f} frames/s",
    )


def _measure_distinct_frames() -> Iterable[ServingRow]:
    """Distinct pictures over drawn ones, of one viewer of a robot that drives."""
    seen = set()
    with ExitStack() as stack:
        server = stack.enter_context(start_server("--renderer", "trace", size_px=360))
        stack.enter_context(spawn_robots(server, 1))
        (watcher,) = stack.enter_context(connect_watchers(server, FULL_REQUEST))
        before, begin_s = server.read_counters(), time.monotonic()
        while time.monotonic() < begin_s + ROUNDS * WINDOW_S:
            watcher.receive_frame()
            seen.add(zlib.crc32(watcher.payload))
        after = server.read_counters()
    drawn = after.frames - before.frames
    elapsed_s = after.time_s - before.time_s
    yield ServingRow.at_least(
        "driving robot, 360 px: distinct frames over drawn ones",
        *(len(seen) / drawn, MIN_DISTINCT_SHARE),
        f"{len(seen) / elapsed_s:.0f} distinct frames/s, "
        f"{1e3 * (after.process_s - before.process_s) / len(seen):.2f} ms of processor time each",
    )


def _measure_silent_viewers() -> Iterable[ServingRow]:
    """Memory of viewers that request a frame and never read it, and what is left to others."""
    with ExitStack() as stack:
        server = stack.enter_context(start_server("--renderer", "trace"))
        stack.enter_context(spawn_robots(server, 1))
        watchers = stack.enter_context(connect_watchers(server, *TRANSPORTS.values()))
        server.warm_up(watchers)
        before, before_mb = server.measure(watchers, ROUNDS * WINDOW_S), server.resident_mb
        for _ in range(SILENT_VIEWERS):
            viewer = stack.enter_context(connect_with_handshake(server.stream_port))
            viewer.sendall(make_stream_request(1))
        after = server.measure(watchers, ROUNDS * WINDOW_S)
        grown_mb = server.resident_mb - before_mb
    silent = f"{SILENT_VIEWERS} viewers of {SIZE_PX} px that never read: "
    frames_mb = SILENT_VIEWERS * IMAGE_BYTES / 1e6
    yield ServingRow.at_most(f"{silent}memory, MB", grown_mb, frames_mb, "one frame each")
    share = _rate_hz(after) / _rate_hz(before)
    yield ServingRow.at_least(f"{silent}frames that two others keep", share, MIN_KEPT_SHARE)


def _measure_first_frame(name: str) -> Iterable[ServingRow]:
    """Time from the start of the process to the first frame."""
    robot, world, limit_s = FIRST_FRAMES[name]
    yield _measure_starts(f"{name}: first frame after the start, s", robot, world, limit_s)


def _measure_first_frame_of_million() -> Iterable[ServingRow]:
    """The same with a mesh file of a million triangles."""
    with tempfile.TemporaryDirectory() as folder:
        world = write_million_world(Path(folder))
        question = "a million triangles: first frame after the start, s"
        yield _measure_starts(question, ROBOT, world, MAX_MILLION_FIRST_FRAME_S)


def _measure_starts(question: str, robot: Path, world: Path, limit_s: float) -> ServingRow:
    """Median of several starts, with modules compiled as by pip, and files in the page cache."""
    with tempfile.TemporaryDirectory() as cache:
        _start_and_receive(cache, robot, world)  # compiles the modules
        times_s = [_start_and_receive(cache, robot, world) for _ in range(STARTS)]
    return ServingRow.at_most(
        question,
        *(statistics.median(times_s), limit_s * _measure_slowness()),
        f"{min(times_s):.2f} to {max(times_s):.2f} s",
    )


def _start_and_receive(cache: str, robot: Path, world: Path) -> float:
    begin_s = time.monotonic()
    command = [sys.executable, "-m", "catoptra_server"]
    compiled = {"PYTHONPYCACHEPREFIX": cache, "PYTHONDONTWRITEBYTECODE": ""}
    with start_process(command, "--world", str(world), robot=robot, **compiled) as process:
        server = CountedServer(process, read_ports(process))
        with RobotClient.connect(port=server.control_port) as client:
            client.spawn("USARBot.OmniP2AT", location_m=(0.0, 0.0, 0.0))
            with connect_watchers(server, FULL_REQUEST) as (watcher,):
                watcher.receive_frame()
                return time.monotonic() - begin_s


def _make_table(rows: list[ServingRow]) -> Table:
    table = Table(title=f"serving, {describe_machine()}")
    for head in ("", "measured", "limit", "", ""):
        table.add_column(head, justify="right" if head else "left")
    for row in rows:
        verdict = "met" if row.is_met else "MISSED"
        table.add_row(row.question, f"{row.value:.2f}", row.limit, verdict, row.details)
    return table


if __name__ == "__main__":
    sys.exit(main())
