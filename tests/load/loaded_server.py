"""A server process of the load test: shipped files, the honest load, and its timed end."""

from __future__ import annotations

import asyncio
import resource
import signal
import subprocess
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from helpers.configs import ROBOTS
from helpers.deadline import Deadline
from helpers.live_page import read_page_link
from helpers.server_process import RunningServer, start_server
from load.attack_tools import AttackedPorts
from load.honest_clients import HonestRecord, run_honest_clients
from load.process_sample import ProcessSample, collect_samples

_POLL_S = 0.02
# A server that has not ended by then is killed: thirty times what it may take.
STOP_DEADLINE_S = 30.0
# The first frame waits for the calibration of the renderers.
_FIRST_FRAME_DEADLINE_S = 60.0


@dataclass(frozen=True, slots=True)
class LoadedServer:
    """A server with honest clients, and all that is recorded of both."""

    server: RunningServer
    ports: AttackedPorts
    record: HonestRecord
    samples: list[ProcessSample]
    """Of the server's process, growing."""

    @property
    def exit_status(self) -> int | None:
        """Exit status of the server; None while the server runs."""
        return self.server.process.poll()

    async def wait(self, duration_s: float) -> None:
        """Wait for a time, or until the server ends."""
        end_s = time.monotonic() + duration_s
        while time.monotonic() < end_s and self.exit_status is None:
            await asyncio.sleep(_POLL_S)

    async def terminate(self) -> float:
        """Send SIGTERM, and kill a server that goes on.

        Returns:
            Seconds until the end of the process; infinite where it was killed.
        """
        begin_s = time.monotonic()
        self.server.process.send_signal(signal.SIGTERM)
        await self.wait(STOP_DEADLINE_S)
        if self.exit_status is None:
            self.server.process.kill()
            return float("inf")
        return time.monotonic() - begin_s


@asynccontextmanager
async def start_loaded_server(
    folder: Path,
    *arguments: str,
    robot: str = "p2at_omni",
    max_descriptors: int = 0,
    sample_interval_s: float,
) -> AsyncIterator[LoadedServer]:
    """Serve honest clients in a block, which begins when each has received something.

    Args:
        folder: Receives server.log.
        arguments: Further options of the command line.
        robot: Name of a shipped robot of the class OmniP2AT.
        max_descriptors: Limit of the server's descriptors; 0: the limit of this process.
        sample_interval_s: Interval of the samples of the process.
    """
    folder.mkdir(parents=True, exist_ok=True)
    # The server's own default, in place of that of the tests.
    options = ("--threads", "0", "--view", "0")
    with start_server(folder, *options, *arguments, robot=ROBOTS / f"{robot}.ini") as server:
        if max_descriptors:
            _limit_descriptors(server.process, max_descriptors)
        page_port = int(read_page_link(server).rpartition(":")[2])
        ports = AttackedPorts(server.control_port, server.image_port, server.stream_port, page_port)
        async with (
            run_honest_clients(ports, has_lockstep="lockstep" in arguments) as record,
            collect_samples(server.process.pid, interval_s=sample_interval_s) as samples,
        ):
            deadline = Deadline("first report and frames", _FIRST_FRAME_DEADLINE_S)
            while not record.has_started():
                assert server.process.poll() is None, f"the server ended: {record.faults}"
                deadline.check()
                await asyncio.sleep(_POLL_S)
            try:
                yield LoadedServer(server, ports, record, samples)
            finally:
                if server.process.poll() is None:
                    server.process.kill()


def _limit_descriptors(process: subprocess.Popen[str], limit: int) -> None:
    _, hard = resource.prlimit(process.pid, resource.RLIMIT_NOFILE)
    resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (limit, hard))
