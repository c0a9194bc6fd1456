"""Recordings that end early: by kill -9, by Ctrl-C, on a full disk."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from mcap.exceptions import McapError
from mcap.stream_reader import StreamReader

from catoptra_client.recording import ros2_messages as ros
from catoptra_client.recording.mcap_file import RecordingWriter, read_records, repair_recording
from catoptra_protocol.errors import CatoptraError, RemoteProtocolError
from helpers.bags import read_bag
from helpers.killed_writer import NUM_KILLED, RATE_HZ, choose_num_messages
from helpers.server_process import DEADLINE_S, start_server

KILLED_WRITER = Path(__file__).parents[2] / "helpers/killed_writer.py"


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the files of killed processes."""
    folder = tmp_path_factory.mktemp("killed")
    # From a process of its own, since this one has threads.
    subprocess.run([sys.executable, KILLED_WRITER, str(folder)], check=True, timeout=DEADLINE_S)
    return folder


@pytest.mark.parametrize("seed", range(NUM_KILLED))
def test_killed_writer_loses_a_second_at_most(seed: int, killed: Path) -> None:
    path, num_messages = killed / f"{seed}" / "a.mcap", choose_num_messages(seed)
    with path.open("rb") as file:
        found = count_messages(file)
    assert num_messages - RATE_HZ <= found <= num_messages
    count, _ = repair_recording(path)
    assert count == found == sum(map(len, read_bag(path.parent).values()))


def count_messages(file: Any) -> int:
    """Messages that mcap's streaming reader finds before the end of the file."""
    count, records = 0, StreamReader(file).records
    while True:
        try:
            count += type(next(records)).__name__ == "Message"
        except (McapError, StopIteration):
            return count


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_command_when_interrupted_leaves_a_file(number: signal.Signals, tmp_path: Path) -> None:
    path = tmp_path / "bag" / "a.mcap"
    path.parent.mkdir()
    with start_server(tmp_path) as server, server.connect_stream() as client:
        client.spawn("USARBot.OmniP2AT", start_pose=client.get_start_poses()[0].name)
        command = [sys.executable, "-m", "catoptra_client", "record", str(path)]
        command += ["--stream-port", str(server.stream_port)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            end_s = time.monotonic() + DEADLINE_S
            while not (path.exists() and path.stat().st_size > 60_000):
                assert time.monotonic() < end_s
                with pytest.raises(subprocess.TimeoutExpired):
                    process.wait(0.02)
            process.send_signal(number)
            output, _ = process.communicate(timeout=DEADLINE_S)
    if number is signal.SIGINT:
        assert process.returncode == 0
        assert "0 dropped" in output
    else:
        with pytest.raises(CatoptraError, match="--repair"):
            list(read_records(path))
        assert repair_recording(path)[0] > 20
    assert len(read_bag(path.parent)["/ground_truth"]) > 1


class FullDisk:
    """A file on a disk with room for some bytes, and for those of the reserve once it is free."""

    def __init__(self, file: Any, reserve: Any, room: int) -> None:
        self._file, self._reserve, self._room = file, reserve, room
        self._reserved = os.fstat(reserve.fileno()).st_size

    def write(self, data: memoryview) -> int:
        room = self._room + (self._reserved if self._reserve.closed else 0) - self._file.tell()
        if room <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return int(self._file.write(data[:room]))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def test_file_on_a_full_disk_is_complete_up_to_there(tmp_path: Path) -> None:
    path, written = tmp_path / "a.mcap", 0
    with RecordingWriter(path) as writer:
        writer._file = FullDisk(writer._file, writer._reserve, 3 * 2**20)  # type: ignore[assignment]
        while not writer.is_full:
            image = ros.compressed_image_message(0.0, "a", "jpeg", os.urandom(40_000))
            type_name = "sensor_msgs/CompressedImage"
            writer.add_message("/image", type_name, image, log_ns=written, publish_ns=0)
            written += 1
    assert written > 70
    assert len(read_bag(tmp_path)["/image"]) == written


@pytest.mark.parametrize("time_s", [float("nan"), float("inf"), -1.0, 2.0**31])
def test_time_without_a_stamp_is_an_error(time_s: float) -> None:
    with pytest.raises(RemoteProtocolError, match="has no stamp"):
        ros.clock_message(time_s)
