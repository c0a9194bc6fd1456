"""One run of the honest load, with or without attackers, and the run's figures."""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from load.attacker_process import AttackerLoad, run_attacks
from load.intervals import Phase, late_fraction
from load.loaded_server import start_loaded_server
from load.process_sample import ProcessSample

# A report comes every 0.2 s; one that is later by a fifth is late.
LATE_INTERVAL_S = 0.24
# Of a run of ten minutes the first one fills caches and pools. It is compared by the second one
# with the last quarter; shorter runs are divided alike.
_SETTLED = (0.1, 0.2)
_FINAL = (0.75, 1.0)


@dataclass(frozen=True, slots=True)
class LoadResult:
    """Figures of one run."""

    duration_s: float
    late_fraction: float
    """Fraction of the honest robot's reports more than 20 % late."""
    longest_gap_s: float
    """Longest interval between two reports of the honest robot."""
    rates_hz: dict[str, float]
    """Frames per second of each honest viewer."""
    settled: ProcessSample
    """Means over the second tenth of the run."""
    final: ProcessSample
    """Means over the last quarter."""
    stop_s: float
    """From SIGTERM to the end of the process; infinite where it was killed, or ended before."""
    faults: tuple[str, ...]
    """Errors and disconnections of honest clients, and the end of the server before its time."""
    attackers: AttackerLoad
    samples: tuple[ProcessSample, ...]
    """Process of the server over time."""


async def run_load(
    folder: Path, duration_s: float, *arguments: str, attacks: Sequence[str] = ()
) -> LoadResult:
    """Run the honest load beside attackers; SIGTERM comes while they attack.

    Args:
        folder: Receives the server's log.
        duration_s: Length of the run, from the honest clients' first frames on.
        arguments: Further options of the server.
        attacks: Names of attacks; none: the control run.
    """
    interval_s = min(1.0, duration_s / 40.0)
    async with start_loaded_server(folder, *arguments, sample_interval_s=interval_s) as loaded:
        async with run_attacks(loaded.ports, attacks) as attackers:
            begin_s = time.monotonic()
            await loaded.wait(duration_s)
            phase = Phase(begin_s, time.monotonic())
            attacker_load = attackers.measure()
            faults = [*loaded.record.faults]
            stop_s = float("inf")
            if loaded.exit_status is None:
                stop_s = await loaded.terminate()
            else:
                faults.append(f"the server ended with status {loaded.exit_status}")
    intervals_s = phase.intervals_s(loaded.record.reports_s)
    samples = [sample for sample in loaded.samples if sample.time_s <= phase.end_s]
    return LoadResult(
        duration_s=phase.end_s - phase.begin_s,
        late_fraction=late_fraction(intervals_s, LATE_INTERVAL_S),
        longest_gap_s=max(intervals_s),
        rates_hz={name: phase.rate(at_s) for name, at_s in loaded.record.frames_s.items()},
        settled=_average(samples, phase, _SETTLED),
        final=_average(samples, phase, _FINAL),
        stop_s=stop_s,
        faults=tuple(faults),
        attackers=attacker_load,
        samples=tuple(samples),
    )


def _average(
    samples: Sequence[ProcessSample], phase: Phase, span: tuple[float, float]
) -> ProcessSample:
    """Means over a span of a phase; `span`: its begin and end as fractions of the phase."""
    length_s = phase.end_s - phase.begin_s
    begin_s, end_s = (phase.begin_s + fraction * length_s for fraction in span)
    within = [sample for sample in samples if begin_s <= sample.time_s <= end_s] or samples[-1:]
    return ProcessSample(
        *(
            statistics.fmean(values)
            for values in zip(
                *((s.time_s, s.resident_mb, s.descriptors, s.threads) for s in within), strict=True
            )
        )
    )
