"""First picture and pictures a second of a server whose client only reads, while its robot drives:
twice, with an empty cache and with a full one:
.venv/bin/python tests/measurements/live_frames.py [ROBOT [WORLD [SECONDS]]]
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

from catoptra_client.frame_sources.stream import StreamClient
from catoptra_client.server_process import start_server


def main(robot: str = "p2at_omni_live", world: str = "laboratory", seconds: float = 8.0) -> None:
    """Print a line for each cache."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        for cache in ("empty", "full"):
            first_s, rate = measure_server(robot, world, float(seconds), Path(folder) / "log")
            print(f"{cache:5} cache: first picture {first_s:.2f} s, {rate:.1f} pictures/s")


def measure_server(robot: str, world: str, seconds: float, log_file: Path) -> tuple[float, float]:
    """Seconds from the start to the first picture, and different pictures a second after that."""
    begin_s = time.perf_counter()
    ports = ("--control-port", "0", "--image-port", "0", "--stream-port", "0")
    arguments = ("--robot", robot, "--world", world, *ports)
    with (
        start_server(arguments, log_file=log_file) as address,
        StreamClient.connect("127.0.0.1", address.stream_port, timeout_s=60.0) as client,
    ):
        client.spawn("USARBot.OmniP2AT", start_pose="Centre")
        client.get_frame()
        first_s = time.perf_counter() - begin_s
        client.drive(2.0, 0.5)
        # What a cache lacks is made meanwhile.
        read_times(client, 2.0 * seconds)
        return first_s, len(read_times(client, seconds)) / seconds


def read_times(client: StreamClient, seconds: float) -> set[float]:
    """Times of the pictures that a client receives, simulation seconds."""
    end_s, times = time.perf_counter() + seconds, set()
    while time.perf_counter() < end_s:
        times.add(client.get_frame().time_s)
    return times


if __name__ == "__main__":
    main(*sys.argv[1:])
