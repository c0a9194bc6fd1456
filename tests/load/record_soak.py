"""A recorder at full load: 30 pictures a second and eight sensors at 50 Hz, whose file is complete.

Recorder and server are processes; both are sampled each second. Afterwards a viewer of the same
frames shows what these cost the server alone. Prints figures; `make record-soak`.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

sys.path.insert(0, str(Path(__file__).parents[1]))

from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.stream.requests import FrameVariant, GetFrameRequest, ImageEncoding
from helpers.configs import OMNI_ROBOT, ROBOTS
from helpers.memory import resident_mb
from helpers.server_process import start_server

_CAMERA = "OmniCamPillar_Link4"
_HZ, _TICK_S = 30.0, 0.02
# Scanner, INS, odometry, ground truth, and these.
_SONARS = ("F1", "F4", "F5", "F8")
_START_S = 4.0


def write_robot(folder: Path, size_px: int) -> Path:
    """Write a robot of eight sensors, which are read in each tick."""

    def hasten(text: str) -> str:
        return re.sub(r"ScanInterval=[0-9.]+", f"ScanInterval={_TICK_S}", text)

    base = re.sub("Resolution([XY])=360", rf"Resolution\1={size_px}", OMNI_ROBOT.read_text())
    (folder / OMNI_ROBOT.name).write_text(hasten(base))
    lines = hasten((ROBOTS / "p2at_omni_full.ini").read_text()).splitlines()
    wanted = ("Scanner1", "INS", *_SONARS)
    robot = folder / "eight_sensors.ini"
    robot.write_text(
        "\n".join(
            line
            for line in lines
            if not line.startswith(("+Sensors", "+Cameras"))
            or any(f'ItemName="{name}"' in line for name in wanted)
        )
    )
    return robot


def processor_time_s(pid: int) -> float:
    """Processor time of a process until now."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def _start_recorder(path: Path, port: int, duration_s: float) -> Iterator[subprocess.Popen[bytes]]:
    words = ("record", str(path), "--camera", _CAMERA, "--stream-port", str(port))
    command = [sys.executable, "-m", "catoptra_client", *words, "--duration", f"{duration_s:g}"]
    with subprocess.Popen(command) as process:
        try:
            yield process
        finally:
            process.kill()


def _view_frames(port: int, duration_s: float) -> int:
    """Number of frames that a viewer gets at the same rate."""
    variant = FrameVariant(picture="flipped")
    request = GetFrameRequest(0, "", _CAMERA, ImageEncoding.JPEG, variant)
    with StreamClient.connect(port=port) as client:
        begin_s, count = time.monotonic(), 0
        while (left_s := begin_s + duration_s - time.monotonic()) > 0.0:
            client.get_encoded_frame(request)
            count += 1
            next_s = begin_s + duration_s - left_s + 1.0 / _HZ
            time.sleep(max(0.0, next_s - time.monotonic()))
    return count


def run_soak(folder: Path, duration_s: float, *, viewed_s: float = 60.0) -> dict[str, Any]:
    """Record for a time, and view for another; the figures."""
    path = folder / "soak.mcap"
    robot = write_robot(folder, 640)
    with start_server(folder, "--threads", "2", robot=robot) as server:
        pid, port = server.process.pid, server.stream_port
        with server.connect_stream() as client:
            client.spawn("USARBot.OmniP2AT", start_pose=client.get_start_poses()[0].name)
            client.drive(0.5, 1.5)
            with _start_recorder(path, port, duration_s) as recorder:
                # The camera is fitted to the models of calibration files first, for a second.
                time.sleep(_START_S)
                begin_s = time.monotonic()
                before = processor_time_s(recorder.pid), processor_time_s(pid)
                samples = []
                while recorder.poll() is None:
                    # A zombie has no memory.
                    with_memory = Path(f"/proc/{recorder.pid}/status").read_text()
                    if "VmRSS" in with_memory:
                        spent = processor_time_s(recorder.pid), processor_time_s(pid)
                        wall_s = time.monotonic() - begin_s
                        samples.append((resident_mb(recorder.pid), resident_mb(pid)))
                    time.sleep(min(1.0, duration_s / 20.0))
                assert recorder.returncode == 0
            viewer_before = processor_time_s(pid)
            num_viewed = _view_frames(port, viewed_s)
            idle_before = processor_time_s(pid)
            server_of_viewer = (idle_before - viewer_before) / viewed_s
            # The robot and its sensors alone.
            time.sleep(0.5 * viewed_s)
            server_idle = (processor_time_s(pid) - idle_before) / (0.5 * viewed_s)
            viewer_frame_s = (server_of_viewer - server_idle) / max(num_viewed / viewed_s, 1e-9)
    with path.open("rb") as file:
        reader = make_reader(file)
        counts: Counter[str] = Counter()
        stamps: dict[str, list[int]] = {}
        headers = []
        for _, channel, message in reader.iter_messages(log_time_order=False):
            counts[channel.topic] += 1
            stamps.setdefault(channel.topic, []).append(message.log_time)
            if channel.topic == "/catoptra/frame":
                text = message.data[8:].rstrip(b"\0")
                headers.append(json.loads(text))
        dropped = next(one.metadata for one in reader.iter_metadata()
            if one.name == "catoptra_dropped")  # fmt: skip
    span_s = (stamps["/ground_truth"][-1] - stamps["/ground_truth"][0]) / 1e9
    num_quarter = max(1, len(samples) // 4)

    def mean(part: list[tuple[float, float]], which: int) -> float:
        return sum(one[which] for one in part) / len(part)

    server_share, frames_per_s = (spent[1] - before[1]) / wall_s, len(headers) / span_s
    server_of_same_frames = server_idle + viewer_frame_s * frames_per_s
    return {
        "seconds": duration_s,
        "messages": sum(counts.values()),
        "dropped": {name: count for name, count in dropped.items() if count != "0"},
        "frames": len(headers),
        "frames_lost": headers[-1]["dropped_frames"],
        "frames_superseded": headers[-1]["sequence"] - headers[0]["sequence"] + 1 - len(headers),
        "frames_per_s": frames_per_s,
        "ticks_recorded": (counts["/ground_truth"] - 1) / (span_s / _TICK_S),
        "readings_per_s": {
            topic: round(counts[topic] / span_s, 1)
            for topic in sorted(counts)
            if topic.startswith(("/scan", "/range", "/imu", "/odom", "/reading"))
        },
        "recorder_share": (spent[0] - before[0]) / wall_s,
        "server_share": server_share,
        "server_share_of_a_viewer": server_of_viewer,
        "server_share_alone": server_idle,
        "frames_per_s_of_the_viewer": num_viewed / viewed_s,
        "server_extra_of_a_core": server_share - server_of_same_frames,
        "recorder_mb": [mean(samples[:num_quarter], 0), mean(samples[-num_quarter:], 0)],
        "server_mb": [mean(samples[:num_quarter], 1), mean(samples[-num_quarter:], 1)],
        "load": os.getloadavg(),
    }


def main() -> None:
    """Run, print, and fail where something was lost or memory grew."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    seconds = parser.parse_args().seconds
    with tempfile.TemporaryDirectory() as folder:
        figures = run_soak(Path(folder), seconds)
    for name, value in figures.items():
        print(f"{name:28} {value if not isinstance(value, float) else round(value, 3)}")
    grown_mb = figures["recorder_mb"][1] - figures["recorder_mb"][0]
    is_whole = not figures["dropped"] and not figures["frames_lost"]
    if not is_whole or figures["ticks_recorded"] < 0.999 or grown_mb > 10.0:
        sys.exit("messages were lost, or memory grew")


if __name__ == "__main__":
    main()
