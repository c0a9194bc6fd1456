"""One attack on a server of its own: the honest clients before, during and after the attack."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from pathlib import Path

from load.attacker_process import run_attacks
from load.attacks import ATTACKS
from load.honest_clients import IMAGE_VIEWER
from load.intervals import Phase
from load.loaded_server import LoadedServer, start_loaded_server

_QUIET_S = 3.0
_SAMPLE_INTERVAL_S = 0.2
# Reports and frames are back once both have come regularly for this long.
_REGULAR_S = 2.0
_MAX_GAP_S = 1.0
_MAX_RECOVERY_S = 60.0


@dataclass(frozen=True, slots=True)
class AttackResult:
    """Figures of one attack."""

    attack: str
    exit_status: int | None
    """Of a server that the attack ended; None: the server survived."""
    longest_report_gap_s: tuple[float, float, float]
    """Before, during and after the attack."""
    image_rate_hz: tuple[float, float, float]
    """Frames per second of the viewer on the image port: before, during, after."""
    recovery_s: float
    """From the end of the attack until reports and frames are regular again."""
    resident_mb: tuple[float, float, float]
    """Before, at most, at the end."""
    descriptors: tuple[int, int, int]
    """Before, at most, at the end."""
    stop_s: float
    """From SIGTERM under attack to the end; infinite: killed; NaN: ended before."""
    faults: tuple[str, ...]
    """Errors and disconnections of honest clients."""


async def measure_attack(name: str, seconds: float, folder: Path) -> AttackResult:
    """Run one attack for some seconds on servers of its own.

    Two servers: one recovers after the attack, the other receives SIGTERM during the attack.
    """
    async with _start_server(name, folder) as loaded:
        begin_s = time.monotonic()
        await loaded.wait(_QUIET_S)
        async with run_attacks(loaded.ports, [name]) as attackers:
            attacked_s = time.monotonic()
            await loaded.wait(seconds)
            assert attackers.measure().num_processes == 1, f"{name} ended by itself"
        over_s = time.monotonic()
        recovery_s = await _wait_for_recovery(loaded)
        now_s = time.monotonic()
        phases = Phase(begin_s, attacked_s), Phase(attacked_s, over_s), Phase(over_s, now_s)
        stop_s = await _measure_stop(name, seconds, folder)
        return _summarize(name, loaded, phases, recovery_s=recovery_s, stop_s=stop_s)


async def _measure_stop(name: str, seconds: float, folder: Path) -> float:
    """Seconds from SIGTERM under attack to the end; NaN where the attack ended the server."""
    async with _start_server(name, folder) as loaded:
        async with run_attacks(loaded.ports, [name]):
            await loaded.wait(seconds)
            return await loaded.terminate() if loaded.exit_status is None else math.nan


def _start_server(name: str, folder: Path) -> AbstractAsyncContextManager[LoadedServer]:
    attack = ATTACKS[name]
    return start_loaded_server(
        folder / name,
        *attack.arguments,
        robot=attack.robot,
        max_descriptors=attack.max_descriptors,
        sample_interval_s=_SAMPLE_INTERVAL_S,
    )


async def _wait_for_recovery(loaded: LoadedServer) -> float:
    """Seconds until the begin of the first span of regular reports and frames."""
    begin_s = time.monotonic()
    while (now_s := time.monotonic()) - begin_s < _MAX_RECOVERY_S:
        if loaded.exit_status is not None:
            return float("inf")
        last = Phase(now_s - _REGULAR_S, now_s)
        arrivals = (loaded.record.reports_s, loaded.record.frames_s[IMAGE_VIEWER])
        if now_s - begin_s > _REGULAR_S and all(
            max(last.intervals_s(times_s)) < _MAX_GAP_S for times_s in arrivals
        ):
            return now_s - _REGULAR_S - begin_s
        await asyncio.sleep(0.05)
    return float("inf")


def _summarize(
    name: str, loaded: LoadedServer, phases: Sequence[Phase], *, recovery_s: float, stop_s: float
) -> AttackResult:
    record, attacked_s = loaded.record, phases[1].begin_s
    before = [sample for sample in loaded.samples if sample.time_s <= attacked_s][-1]
    since = [sample for sample in loaded.samples if sample.time_s > attacked_s] or [before]
    gaps = [max(phase.intervals_s(record.reports_s)) for phase in phases]
    rates = [phase.rate(record.frames_s[IMAGE_VIEWER]) for phase in phases]
    memory = before.resident_mb, max(s.resident_mb for s in since), since[-1].resident_mb
    descriptors = before.descriptors, max(s.descriptors for s in since), since[-1].descriptors
    return AttackResult(
        attack=name,
        exit_status=loaded.exit_status,
        longest_report_gap_s=(gaps[0], gaps[1], gaps[2]),
        image_rate_hz=(rates[0], rates[1], rates[2]),
        recovery_s=recovery_s,
        resident_mb=memory,
        descriptors=descriptors,
        stop_s=stop_s,
        faults=tuple(record.faults),
    )


HEADINGS = (
    *("attack", "server", "report gap s", "image frames/s", "recovery s", "MB", "descriptors"),
    *("SIGTERM s", "faults of honest clients"),
)


def format_row(result: AttackResult) -> tuple[str, ...]:
    """Cells of the table, under HEADINGS; three numbers are before, during, after."""
    return (
        result.attack,
        "alive" if result.exit_status is None else f"ended ({result.exit_status})",
        " / ".join(f"{gap_s:.2f}" for gap_s in result.longest_report_gap_s),
        " / ".join(f"{rate_hz:.1f}" for rate_hz in result.image_rate_hz),
        f"{result.recovery_s:.1f}",
        " / ".join(f"{size_mb:.0f}" for size_mb in result.resident_mb),
        " / ".join(map(str, result.descriptors)),
        f"{result.stop_s:.2f}",
        "; ".join(result.faults),
    )
