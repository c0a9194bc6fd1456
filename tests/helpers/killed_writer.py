"""Writers of recordings that kill themselves, each after a number of messages: kill -9.

python killed_writer.py FOLDER
"""

from __future__ import annotations

import os
import random
import signal
import sys
from pathlib import Path

from catoptra_client.recording import ros2_messages as ros
from catoptra_client.recording.mcap_file import RecordingWriter

NUM_KILLED, RATE_HZ = 20, 100.0


def choose_num_messages(seed: int) -> int:
    """Messages that a writer has written when it is killed."""
    return random.Random(seed).randrange(2, 1500)


def write_until_killed(path: Path, seed: int) -> None:
    """Write pictures and states by a clock of messages, then kill this process."""
    source, now_s = random.Random(seed), 0.0
    path.parent.mkdir()
    writer = RecordingWriter(path, clock=lambda: now_s)
    for number in range(choose_num_messages(seed)):
        now_s = number / RATE_HZ
        times = {"log_ns": round(now_s * 1e9), "publish_ns": round(now_s * 1e9)}
        if number % 3:
            writer.add_message("/clock", "rosgraph_msgs/Clock", ros.clock_message(now_s), **times)
        else:
            image = ros.compressed_image_message(now_s, "a", "jpeg", source.randbytes(40_000))
            writer.add_message("/image", "sensor_msgs/CompressedImage", image, **times)
    os.kill(os.getpid(), signal.SIGKILL)


def main(folder: Path) -> None:
    """Start the writers, one after the other."""
    for seed in range(NUM_KILLED):
        child = os.fork()
        if not child:
            try:
                write_until_killed(folder / f"{seed}" / "a.mcap", seed)
            finally:
                os._exit(1)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        assert status == -signal.SIGKILL, f"writer {seed} ended by itself: {status}"


if __name__ == "__main__":
    main(Path(sys.argv[1]))
