"""All attackers as processes at the lowest priority, on one processor together.

`python -m load.attacker_process CONTROL_PORT IMAGE_PORT STREAM_PORT PAGE_PORT ATTACK...` attacks
until standard input closes: no attacker outlives the test that started it.
"""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import os
import resource
import signal
import sys
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import zmq

from load.attack_tools import AttackedPorts
from load.attacks import ATTACKS, Attack

_TESTS = Path(__file__).parents[1]
_NICENESS = 19
# Between two tries, so that a refused attack does not spin.
_PAUSE_S = 0.02
_STARTED = b"attacking\n"
_START_DEADLINE_S = 60.0


@dataclass(frozen=True, slots=True)
class AttackerLoad:
    """Attackers that run, and the processor time that they have taken."""

    num_processes: int
    processor_s: float


@dataclass(frozen=True, slots=True)
class RunningAttackers:
    """Attackers as a group of processes."""

    group: int
    """Process group, which is the parent's process number."""

    def measure(self) -> AttackerLoad:
        """Count attackers and their processor time until now."""
        ticks = [
            int(fields[11]) + int(fields[12])
            for path in Path("/proc").glob("[0-9]*/stat")
            if (fields := _read_stat(path)) and int(fields[2]) == self.group
        ]
        # Without the parent, which only waits.
        return AttackerLoad(max(0, len(ticks) - 1), sum(ticks) / os.sysconf("SC_CLK_TCK"))


def _read_stat(path: Path) -> list[str]:
    """Fields of /proc/PID/stat behind the name; none of a process that has ended."""
    try:
        return path.read_text(encoding="utf-8").rpartition(")")[2].split()
    except OSError:
        return []


@asynccontextmanager
async def run_attacks(
    ports: AttackedPorts, names: Sequence[str]
) -> AsyncIterator[RunningAttackers]:
    """Attack a server for the length of a block; kill all attackers at its end.

    The block begins once all attackers have started.
    """
    command = [sys.executable, "-m", "load.attacker_process", *map(str, ports), *names]
    path = os.pathsep.join(filter(None, (str(_TESTS), os.environ.get("PYTHONPATH"))))
    process = await asyncio.create_subprocess_exec(
        *command,
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": path},
        # A group, to be killed as a whole, but no session: Linux shares the processors between
        # sessions first (autogroups), and a low priority would count within the attackers' alone.
        process_group=0,
    )
    try:
        assert process.stdout is not None, "stdout is a pipe"
        async with asyncio.timeout(_START_DEADLINE_S):
            started = await process.stdout.readline()
        assert started == _STARTED, f"the attackers did not start: {started!r}"
        yield RunningAttackers(process.pid)
    finally:
        # The whole group: killed attackers leave their connections as a crash does.
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        await process.wait()


def main(arguments: Sequence[str]) -> None:
    """Start the attackers, and wait until standard input closes."""
    ports = AttackedPorts(*map(int, arguments[:4]))
    os.setpriority(os.PRIO_PROCESS, 0, _NICENESS)
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    # Forked: thirty interpreters would take the processor for seconds before they attack.
    fork = multiprocessing.get_context("fork")
    for attack in [ATTACKS[name] for name in arguments[4:]]:
        fork.Process(target=_repeat_attack, args=(attack, ports), daemon=True).start()
    os.write(1, _STARTED)
    while os.read(0, 1):
        pass


def _repeat_attack(attack: Attack, ports: AttackedPorts) -> None:
    while True:
        with contextlib.suppress(OSError, zmq.ZMQError, AssertionError):
            attack.run(ports)
        time.sleep(_PAUSE_S)


if __name__ == "__main__":
    main(sys.argv[1:])
