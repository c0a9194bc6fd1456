"""Load test: 64 robots, 36 viewers and five adversarial clients on one server, for ten minutes.

Run: make soak, or .venv/bin/python tests/load/run.py --minutes 1. Writes out/soak/soak.json and
out/soak/report.md. The exit status is 0 only if every requirement holds: the regular clients keep
their period of 0.2 s within 20 %, frames are complete and in order, and the server's memory is
flat.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import re
import statistics
import subprocess
import sys
import time
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

sys.path.insert(0, str(Path(__file__).parents[1]))

from helpers.memory import resident_mb  # after the path above
from helpers.requirement_results import RequirementResult, print_requirements
from helpers.server_process import CHILD_SERVER
from load import load_clients

ROOT = Path(__file__).parents[2]
CONTROLLERS = 64
VIEWERS = 30  # of the image port; two adversarial ones besides
STREAM_VIEWERS = 4
PERIOD_S = 0.2
TOLERANCE = 0.2
SAMPLE_INTERVAL_S = 5.0
# The first tenth fills caches and pools; from then on memory may grow by this fraction.
WARM_UP_FRACTION = 0.1
MAX_MEMORY_GROWTH = 0.03


def main() -> int:
    """Run the load test, and print whether each requirement holds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--output", type=Path, default=ROOT / "out/soak")
    parsed = parser.parse_args()
    console = Console()
    memory_mb, record = asyncio.run(_run_soak(60.0 * parsed.minutes, console))
    results = _evaluate(record, memory_mb)
    _write_report(parsed.output, results, memory_mb, record)
    return print_requirements(results, console)


async def _run_soak(
    duration_s: float, console: Console
) -> tuple[list[float], load_clients.LoadRecord]:
    """Run the server with its clients; return its memory over time and their observations."""
    command = [sys.executable, "-P", str(CHILD_SERVER), "--control-port", "0", "--image-port", "0"]
    command += ["--stream-port", "0"]
    command += ["--robot", str(ROOT / "configs/robots/p2at_omni.ini")]
    command += ["--world", str(ROOT / "configs/worlds/four_legged_2006.ini")]
    with subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as server:
        assert server.stdout is not None
        ports = [int(port) for port in re.findall(r":(\d+)", server.stdout.readline())]
        address = load_clients.ServerEndpoints("127.0.0.1", *ports)
        record = load_clients.LoadRecord()
        tasks = [asyncio.create_task(client) for client in _start_clients(address, record)]
        memory_mb = await _sample_memory(server.pid, duration_s, console)
        faults = list(record.faults)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        # Those of the cancellation are no faults of the server.
        record.faults = faults
        server.terminate()
    return memory_mb, record


def _start_clients(
    address: load_clients.ServerEndpoints, record: load_clients.LoadRecord
) -> list[object]:
    return [
        *(load_clients.run_controller(address, number, record) for number in range(CONTROLLERS)),
        *(
            load_clients.run_viewer(address, number, record, pause_s=0.05 * (number % 8))
            for number in range(VIEWERS)
        ),
        *(
            load_clients.run_stream_viewer(
                address, number, record, robot=f"Soak{number}" if number else ""
            )
            for number in range(STREAM_VIEWERS)
        ),
        load_clients.run_unread_viewer(address),
        load_clients.run_resetting_viewer(address),
        load_clients.run_unterminated_controller(address),
        load_clients.run_unread_controller(address),
        load_clients.run_unterminated_stream_client(address),
    ]


async def _sample_memory(pid: int, duration_s: float, console: Console) -> list[float]:
    memory_mb: list[float] = []
    begin = time.monotonic()
    with Progress(console=console) as progress:
        task = progress.add_task("load", total=duration_s)
        while (elapsed_s := time.monotonic() - begin) < duration_s:
            await asyncio.sleep(min(SAMPLE_INTERVAL_S, duration_s - elapsed_s))
            memory_mb.append(resident_mb(pid))
            progress.update(task, completed=time.monotonic() - begin)
    return memory_mb


def _evaluate(record: load_clients.LoadRecord, memory_mb: list[float]) -> list[RequirementResult]:
    means, late = _status_periods(record)
    slowest = max(means)
    low, high = (1.0 - TOLERANCE) * PERIOD_S, (1.0 + TOLERANCE) * PERIOD_S
    frames = sorted(record.frames.values())
    settled = memory_mb[int(WARM_UP_FRACTION * len(memory_mb))]
    growth = max(memory_mb[-3:]) / settled - 1.0
    return [
        RequirementResult(
            f"{CONTROLLERS} robots report every 0.2 s within 20 %",
            f"mean period {min(means):.3f} to {slowest:.3f} s",
            low <= min(means) and slowest <= high and len(means) == CONTROLLERS,
        ),
        RequirementResult(
            "19 of 20 single periods stay within 20 % above 0.2 s",
            f"{late:.1%} are longer",
            late <= 0.05,
        ),
        RequirementResult(
            f"{VIEWERS} viewers and {STREAM_VIEWERS} of the stream receive whole frames in order",
            f"{frames[0]} to {frames[-1]} frames, {len(record.faults)} faults {record.faults[:2]}",
            frames[0] > 0 and not record.faults,
        ),
        RequirementResult(
            "the server's memory is flat",
            f"{settled:.0f} MB after the first tenth, {growth:+.1%} at the end",
            growth <= MAX_MEMORY_GROWTH,
        ),
    ]


def _status_periods(record: load_clients.LoadRecord) -> tuple[list[float], float]:
    """Mean period of each controller, and the fraction of periods that are too long."""
    means, periods = [], []
    for arrivals in record.status_times_s.values():
        own = [later - earlier for earlier, later in pairwise(arrivals)]
        if own:
            means.append(statistics.fmean(own))
            periods += own
    too_long = sum(period > (1.0 + TOLERANCE) * PERIOD_S for period in periods)
    return means or [float("inf")], too_long / max(1, len(periods))


def _write_report(
    folder: Path,
    results: list[RequirementResult],
    memory_mb: list[float],
    record: load_clients.LoadRecord,
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    document = {
        "results": [asdict(result) for result in results],
        "memory_mb": memory_mb,
        "frames": record.frames,
        "faults": record.faults,
    }
    (folder / "soak.json").write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    rows = [
        f"| {v.requirement} | {v.measurement} | {'yes' if v.is_met else 'no'} |" for v in results
    ]
    lines = ["# Load test", "", "| requirement | measured | holds |", "|---|---|---|", *rows, ""]
    (folder / "report.md").write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
