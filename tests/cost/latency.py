"""Age of a frame at the client, and the cost of eight viewers of one camera.

Run: .venv/bin/python tests/cost/latency.py. Prints two tables. Each row has a server process of its
own, which writes the moment of exposure (the machine's monotonic clock) into the top of the image
as black and white squares, so that both transports are measured alike, JPEG too. Frame
time: mean interval of the frames that arrive. Cost: processor time of the server per rendered
frame; clients run in another process. Machines are noisy: compare rows of one run.
"""

from __future__ import annotations

import dataclasses
import itertools
import os
import re
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from catoptra_client.frame import FrameSource, Pixels
from catoptra_client.frame_sources.frame_source import open_frame_source
from catoptra_client.robot_client import RobotClient
from catoptra_server.frames.frame import Frame
from catoptra_server.frames.mailbox import Mailboxes

ROOT = Path(__file__).parents[2]
ARGUMENTS = (
    *("--robot", str(ROOT / "configs/robots/p2at_omni.ini")),
    *("--world", str(ROOT / "configs/worlds/four_legged_2006.ini")),
    *("--control-port", "0", "--image-port", "0", "--renderer", "trace", "--threads", "1"),
)
LISTENING = re.compile(r"listening control=\S+:(\d+) image=\S+:(\d+) stream=\S+:(\d+)")
SQUARE_PX = 8  # a block of JPEG: squares do not affect each other
SQUARES_PER_ROW = 32
BITS = 64
WARM_UP_FRAMES = 10
MEASURED_S = 5.0
CLIENT_COUNTS = (1, 8)
MAX_AGE_FRAMES = 1.5  # frame times
MAX_COST_RATIO = 1.3  # times the cost of one viewer


@dataclass(frozen=True, slots=True)
class ClientRecord:
    """Observations of one viewer: ages and arrival times of frames, seconds."""

    ages_s: list[float]
    arrival_times_s: list[float]


@dataclass(frozen=True, slots=True)
class LatencyRow:
    """One line of the table."""

    transport: str
    clients: int
    frame_ms: float
    age_ms: float
    cpu_ms_per_frame: float

    @property
    def age_in_frames(self) -> float:
        """Median age in frame times."""
        return self.age_ms / self.frame_ms


def main() -> int:
    """Measure both transports with one and eight viewers; exit status 1 beyond the limits."""
    rows = [_measure(name, count) for name in ("tcp", "zmq") for count in CLIENT_COUNTS]
    Console().print(_make_table(rows))
    cost = {row.transport: row.cpu_ms_per_frame for row in rows if row.clients == 1}
    is_good = all(
        row.cpu_ms_per_frame < MAX_COST_RATIO * cost[row.transport]
        and (row.clients > 1 or row.age_in_frames < MAX_AGE_FRAMES)
        for row in rows
    )
    return 0 if is_good else 1


def _measure(transport: str, clients: int) -> LatencyRow:
    with _start_server() as (process, ports), RobotClient.connect(port=ports[0]) as robot:
        robot.spawn("USARBot.OmniP2AT", start_pose="Centre")
        robot.drive(0.5, 1.0)
        address = f"{transport}://127.0.0.1:{ports[1 if transport == 'tcp' else 2]}"
        cpu_s, seen = _run_clients(
            process.pid, [open_frame_source(address) for _ in range(clients)]
        )
    first = seen[0]
    frame_s = (first.arrival_times_s[-1] - first.arrival_times_s[0]) / (
        len(first.arrival_times_s) - 1
    )
    drawn = max(len(observed.arrival_times_s) for observed in seen)
    ages = [age for observed in seen for age in observed.ages_s]
    return LatencyRow(
        *(transport, clients, 1e3 * frame_s, 1e3 * statistics.median(ages), 1e3 * cpu_s / drawn)
    )


def _run_clients(pid: int, sources: list[FrameSource]) -> tuple[float, list[ClientRecord]]:
    """Processor seconds of the server while all viewers receive frames, and their observations."""
    ready, begin = threading.Barrier(len(sources) + 1), threading.Event()
    seen = [ClientRecord([], []) for _ in sources]
    threads = [
        threading.Thread(target=_run_client, args=(source, observed, ready, begin))
        for source, observed in zip(sources, seen, strict=True)
    ]
    for thread in threads:
        thread.start()
    ready.wait()
    before_s = _read_cpu_s(pid)
    begin.set()
    for thread in threads:
        thread.join()
    return _read_cpu_s(pid) - before_s, seen


def _run_client(
    source: FrameSource, record: ClientRecord, ready: threading.Barrier, begin: threading.Event
) -> None:
    with source:
        for _ in itertools.islice(source.iter_frames(), WARM_UP_FRAMES):
            pass
        ready.wait()
        begin.wait()
        until_s = time.monotonic() + MEASURED_S
        for frame in source.iter_frames():
            now_s = time.monotonic()
            if now_s > until_s:
                return
            record.arrival_times_s.append(now_s)
            record.ages_s.append(now_s - _read_stamp(frame.rgb))


def _read_cpu_s(pid: int) -> float:
    """Processor time of a process, all threads together, seconds."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def _start_server() -> Iterator[tuple[subprocess.Popen[str], tuple[int, ...]]]:
    command = [sys.executable, __file__, "--serve", *ARGUMENTS]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        try:
            assert process.stdout is not None, "stdout is a pipe"
            found = LISTENING.match(process.stdout.readline())
            assert found, "the server did not start"
            yield process, tuple(map(int, found.groups()))
        finally:
            process.terminate()


def _serve_with_stamps(arguments: list[str]) -> int:
    """Run the server; every frame shows its time of exposure."""
    from catoptra_server.__main__ import main as serve

    put = Mailboxes.put

    def put_with_stamp(mailboxes: Mailboxes, frame: Frame) -> None:
        rgb = frame.rgb.copy()
        _write_stamp(rgb, frame.finished_at_s - frame.render_duration_s)
        put(mailboxes, dataclasses.replace(frame, rgb=rgb))

    Mailboxes.put = put_with_stamp  # type: ignore[method-assign] # every frame passes here
    return serve(arguments)


def _write_stamp(rgb: Pixels, time_s: float) -> None:
    bits = np.unpackbits(np.array([time_s], ">f8").view(np.uint8)).reshape(-1, SQUARES_PER_ROW)
    squares = np.kron(255 * bits, np.ones((SQUARE_PX, SQUARE_PX), np.uint8)).astype(np.uint8)
    rgb[: squares.shape[0], : squares.shape[1]] = squares[..., None]


def _read_stamp(rgb: Pixels) -> float:
    half, rows = SQUARE_PX // 2, BITS // SQUARES_PER_ROW
    middles = rgb[half::SQUARE_PX, half::SQUARE_PX, 1][:rows, :SQUARES_PER_ROW]
    return float(np.packbits(middles > 127).view(">f8")[0])


def _make_table(rows: list[LatencyRow]) -> Table:
    table = Table(title="Age of a frame at the client, and what viewers cost")
    for name in (
        "transport",
        "viewers",
        "frame ms",
        "age ms",
        "age, frames",
        "server cpu ms/frame",
    ):
        table.add_column(name, justify="right")
    for row in rows:
        numbers = (row.frame_ms, row.age_ms, row.age_in_frames, row.cpu_ms_per_frame)
        table.add_row(row.transport, str(row.clients), *(f"{number:.2f}" for number in numbers))
    return table


if __name__ == "__main__":
    serving = sys.argv[1:2] == ["--serve"]
    sys.exit(_serve_with_stamps(sys.argv[2:]) if serving else main())
