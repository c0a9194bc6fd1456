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
# In the first minute attackers fill caches and pools: with a view for each number of samples, up
# to the limit of the view store. A tenth of the run from then on is compared with its last quarter.
_FILLING_S = 60.0
# A short run has less time to fill, and is compared with itself all the later.
_MAX_FILLING = 0.6
_SETTLED_LENGTH = 0.1
_FINAL_LENGTH = 0.25


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
    newcomer_s: float
    """Longest time from the connection of a newcomer to its first reply."""
    settled: ProcessSample
    """Means over a tenth of the run, after the first minute."""
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
        newcomer_s=max(loaded.record.newcomers_s, default=float("inf")),
        settled=_average(samples, settled_phase(phase)),
        final=_average(samples, Phase(phase.end_s - _FINAL_LENGTH * phase.length_s, phase.end_s)),
        stop_s=stop_s,
        faults=tuple(faults),
        attackers=attacker_load,
        samples=tuple(samples),
    )


def settled_phase(run: Phase) -> Phase:
    """Part of a run in which caches and pools are full."""
    begin_s = run.begin_s + min(_FILLING_S, _MAX_FILLING * run.length_s)
    return Phase(begin_s, begin_s + _SETTLED_LENGTH * run.length_s)


def _average(samples: Sequence[ProcessSample], phase: Phase) -> ProcessSample:
    """Means over a phase."""
    within = [s for s in samples if phase.begin_s <= s.time_s <= phase.end_s] or samples[-1:]
    return ProcessSample(
        *(
            statistics.fmean(values)
            for values in zip(
                *((s.time_s, s.resident_mb, s.descriptors, s.threads) for s in within), strict=True
            )
        )
    )
